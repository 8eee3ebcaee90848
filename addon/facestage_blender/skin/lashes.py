"""Eyelashes: thin tapering hairs that grow from the lids of a rig and follow them.

An object of its own, so that the rig keeps the vertices that a result counts; other programs get
none. Upper lashes are 8 to 12 mm long, lower ones 6 to 8, as told of people; here they are a little
shorter, 90 and 60 an eye instead of up to 160 and 80, and thicker for it.
"""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from ..pictures.images import image_pixels
from .hairs import SECTIONS, SIDES, write_hairs
from .lash_nodes import CORNERS, lash_group
from .lids import (
    BROWS_KEY,
    LIDS,
    along_curve,
    color_growth,
    group_members,
    grown,
    has_lids,
    lid_axes,
    lid_table,
    new_growth,
    opposite_pair,
    part_tree,
    remove_growth,
    require_lids,
    rest_points,
    triangle_weights,
)
from .material import plain_material
from .vector_nodes import BALL, OFFSET, ROOT, WEIGHTS

NAME = "Facestage Lashes"
BARE_ENDS = 0.07  # shares of a lid at its corners
ROUGHNESS = 0.45
DARKEST, UNKNOWN = 0.004, (0.022, 0.014, 0.010)  # linear color
OF_BROW = 0.25  # lashes are darker than brows, between whose hairs skin shows


@dataclass(frozen=True)
class Row:
    """The lashes of one lid; metres."""

    count: int
    length: float
    radius: float
    curl: float  # radians from root to tip, away from the opening
    tilt: float  # at the root, radians from straight ahead, away from the opening


UPPER = Row(90, 0.0088, 0.00007, 1.25, -0.25)
LOWER = Row(55, 0.0048, 0.00005, 0.7, 0.35)


def lashes_of(rig: bpy.types.Object) -> bpy.types.Object | None:
    """The rig's lashes, or None."""
    return grown(rig, NAME)


def grow_lashes(rig: bpy.types.Object) -> bpy.types.Object:
    """Give a rig lashes, in the color of its brows. Raises InputError for one whose lids are not
    known.
    """
    require_lids(rig)
    remove_lashes(rig)
    material = plain_material(NAME, UNKNOWN, ROUGHNESS)
    lashes = new_growth(rig, NAME, lash_group(rig), material)
    _fill(lashes.data, rig)
    color_lashes(rig)
    return lashes


def renew_lashes(rig: bpy.types.Object) -> None:
    """Let the lashes that a rig had before its mesh changed grow again, where it has lids."""
    if lashes_of(rig) is None:
        return
    if has_lids(rig):
        grow_lashes(rig)
    else:
        remove_lashes(rig)


def remove_lashes(rig: bpy.types.Object) -> None:
    """Take a rig's lashes away, and all that only they use."""
    remove_growth(lashes_of(rig))


def color_lashes(rig: bpy.types.Object) -> None:
    """Give a rig's lashes, if it has any, the color of its brows, darker."""
    lashes = lashes_of(rig)
    if lashes is not None:
        color_growth(lashes, brow_color(rig))


def brow_color(rig: bpy.types.Object) -> tuple[float, float, float]:
    """Of hair: the darkest quarter of the albedo about the brows' middle, darker."""
    image = rig.facestage_face.albedo_image
    if image is None or BROWS_KEY not in rig.data:
        return UNKNOWN
    pixels = image_pixels(image)[..., :3]
    height, width = pixels.shape[:2]
    vertex = np.array(rig.data[BROWS_KEY]).reshape(-1, 6)[:, 0].astype(int)
    loops = np.empty(len(rig.data.loops), np.int32)
    rig.data.loops.foreach_get("vertex_index", loops)
    layer = next(each for each in rig.data.uv_layers if each.active_render)
    uvs = np.empty(2 * len(loops), np.float32)
    layer.uv.foreach_get("vector", uvs)
    u, v = uvs.reshape(-1, 2)[np.isin(loops, vertex)].T
    reach = max(height // 64, 1)
    spread = np.arange(-reach, reach + 1)
    row = np.clip(((1 - v) * height).astype(int)[:, None] + spread, 0, height - 1)
    column = np.clip((u * width).astype(int), 0, width - 1)[:, None]
    found = pixels[row, column].reshape(-1, 3)
    dark = found[found.mean(axis=1) <= np.quantile(found.mean(axis=1), 0.25)]
    red, green, blue = np.maximum(OF_BROW * np.median(dark, axis=0), DARKEST).tolist()
    return red, green, blue


def _fill(mesh: bpy.types.Mesh, rig: bpy.types.Object) -> None:
    """The hairs' vertices with their attributes, and their faces."""
    points = rest_points(rig.data)
    skin, triangles = part_tree(rig.data, points)
    indices: dict[str, list[np.ndarray]] = {name: [] for name in (*ROOT, *BALL, *CORNERS)}
    weights, offsets, rest = [], [], []
    for (side, upper), rows in zip(LIDS, lid_table(rig.data), strict=True):
        row = UPPER if upper else LOWER
        corners = rows[[-1, 0]][np.arange(2), rows[[-1, 0], 3:].argmax(axis=1)].astype(int)
        ball = opposite_pair(points, group_members(rig, f"eye_{side}"))
        middle = points[list(ball)].mean(axis=0)
        lid = np.einsum("lk,lkc->lc", rows[:, 3:], points[rows[:, :3].astype(int)])
        rng = np.random.default_rng([side == "left", upper])
        share = np.sort(rng.uniform(BARE_ENDS, 1 - BARE_ENDS, row.count))
        for at, root in zip(share, along_curve(lid, share), strict=True):
            place, _, face, _ = skin.find_nearest(root.tolist())
            carriers = triangles[face]
            root_weights = triangle_weights(np.array(place), points[carriers])
            away, along, across = lid_axes(np.array(place), middle, points[corners])
            # Across the lid, away from the opening.
            outwards = 1.0 if (across[2] > 0) == upper else -1.0
            hair = _hair(row, at, outwards, rng)
            for name, value in zip(
                (*ROOT, *BALL, *CORNERS), (*carriers, *ball, *corners), strict=True
            ):
                indices[name].append(np.full(len(hair), value, np.int32))
            weights.append(np.tile(root_weights, (len(hair), 1)))
            offsets.append(hair)
            rest.append(np.array(place) + hair @ np.stack([along, away, across]))
    write_hairs(
        mesh,
        np.concatenate(rest),
        {name: np.concatenate(values) for name, values in indices.items()},
        {WEIGHTS: np.concatenate(weights), OFFSET: np.concatenate(offsets)},
    )


def _hair(row: Row, at: float, outwards: float, rng: np.random.Generator) -> np.ndarray:
    """(SECTIONS * SIDES, 3) a hair's vertices from its root: along the eye, away from the eyeball,
    across. ``at``: 0 at the outer corner, 1 at the inner one, where lashes are short.
    """
    length = row.length * (0.55 + 0.45 * np.sin(np.pi * at**0.66)) * rng.uniform(0.8, 1.1)
    fan = 0.9 * (0.6 - at) + rng.normal(0, 0.12)  # to the side
    s = np.linspace(0, 1, SECTIONS)
    turn = row.tilt + rng.normal(0, 0.08) + row.curl * s
    step = length / (SECTIONS - 1) * np.stack([fan * s, np.cos(turn), outwards * np.sin(turn)], 1)
    line = np.concatenate([np.zeros((1, 3)), np.cumsum(step[:-1], axis=0)])
    line[:, 1] -= 0.0004  # the root is below the skin
    angle = 2 * np.pi * np.arange(SIDES) / SIDES
    ring = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=1)
    thick = row.radius * (1 - s) ** 0.6 + 0.1 * row.radius
    return (line[:, None] + thick[:, None, None] * ring).reshape(-1, 3)

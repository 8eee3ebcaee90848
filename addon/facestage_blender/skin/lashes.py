"""Eyelashes: thin tapering hairs that grow from the lids of a rig and follow them.

An object of its own, so that the rig keeps the vertices that a result counts; other programs get
none. Upper lashes are 8 to 12 mm long, lower ones 6 to 8, as told of people; here they are a little
shorter, 90 and 60 an eye instead of up to 160 and 80, and thicker for it.
"""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np
from mathutils.bvhtree import BVHTree

from facestage.contract.errors import InputError
from facestage.contract.face_model import PARTS, SKIN, FaceModel

from ..pictures.images import image_pixels
from ..scene.several import home
from .lash_nodes import BALL, CORNERS, OFFSET, ROOT, WEIGHTS, lash_group
from .material import plain_material

NAME = "Facestage Lashes"
SCHEME = "mediapipe478"
LIDS_KEY, BROWS_KEY = "facestage_lids", "facestage_brows"  # of the rig's mesh
# Each lid from the outer to the inner corner of the eye.
_LIDS = {
    ("right", True): (33, 246, 161, 160, 159, 158, 157, 173, 133),
    ("right", False): (33, 7, 163, 144, 145, 153, 154, 155, 133),
    ("left", True): (263, 466, 388, 387, 386, 385, 384, 398, 362),
    ("left", False): (263, 249, 390, 373, 374, 380, 381, 382, 362),
}
_BROWS = (70, 63, 105, 66, 107, 336, 296, 334, 293, 300)
SECTIONS, SIDES = 6, 3  # of a hair: along it, and round it
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


def remember_lids(mesh: bpy.types.Mesh, model: FaceModel) -> None:
    """Note on a rig's mesh where its face model has lids and brows; a model that does not say gets
    no lashes.
    """
    table = model.landmarks.get(SCHEME)
    if table is None:
        return
    rows = np.concatenate([table[list(lid)] for lid in _LIDS.values()])
    mesh[LIDS_KEY] = np.asarray(rows, np.float64).ravel().tolist()
    mesh[BROWS_KEY] = np.asarray(table[list(_BROWS)], np.float64).ravel().tolist()


def lashes_of(rig: bpy.types.Object) -> bpy.types.Object | None:
    """The rig's lashes, or None."""
    return next((each for each in rig.children if each.get(NAME)), None)


def grow_lashes(rig: bpy.types.Object) -> bpy.types.Object:
    """Give a rig lashes, in the color of its brows. Raises InputError for one whose lids are not
    known.
    """
    if not has_lids(rig):
        raise InputError(
            "Nobody said where this rig's lids are; build the rig of a face model again."
        )
    remove_lashes(rig)
    mesh = bpy.data.meshes.new(NAME)
    lashes = bpy.data.objects.new(NAME, mesh)
    lashes[NAME] = True
    home(rig).objects.link(lashes)
    lashes.parent = rig
    _fill(mesh, rig)
    modifier = lashes.modifiers.new(NAME, "NODES")
    modifier.node_group = lash_group(rig)
    mesh.materials.append(plain_material(NAME, UNKNOWN, ROUGHNESS))
    color_lashes(rig)
    return lashes


def has_lids(rig: bpy.types.Object) -> bool:
    """Whether lashes could grow on a rig."""
    return LIDS_KEY in rig.data and {"eye_left", "eye_right"} <= set(rig.vertex_groups.keys())


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
    lashes = lashes_of(rig)
    if lashes is None:
        return
    mesh, groups = lashes.data, [each.node_group for each in lashes.modifiers]
    materials = list(mesh.materials)
    bpy.data.objects.remove(lashes)
    bpy.data.meshes.remove(mesh)
    for group in groups:
        if group is not None and not group.users:
            bpy.data.node_groups.remove(group)
    for material in materials:
        if material is not None and not material.users:
            bpy.data.materials.remove(material)


def color_lashes(rig: bpy.types.Object) -> None:
    """Give a rig's lashes, if it has any, the color of its brows, darker."""
    lashes = lashes_of(rig)
    if lashes is None:
        return
    surface = next(
        each for each in lashes.data.materials[0].node_tree.nodes if "Base Color" in each.inputs
    )
    surface.inputs["Base Color"].default_value = (*brow_color(rig), 1.0)


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
    points = np.empty(3 * len(rig.data.vertices), np.float32)
    rig.data.vertices.foreach_get("co", points)
    points = points.reshape(-1, 3).astype(np.float64)
    skin, triangles = _skin_tree(rig.data, points)
    table = np.array(rig.data[LIDS_KEY]).reshape(len(_LIDS), -1, 6)
    indices: dict[str, list[np.ndarray]] = {name: [] for name in (*ROOT, *BALL, *CORNERS)}
    weights, offsets, rest = [], [], []
    for (side, upper), rows in zip(_LIDS, table, strict=True):
        row = UPPER if upper else LOWER
        corners = rows[[-1, 0]][np.arange(2), rows[[-1, 0], 3:].argmax(axis=1)].astype(int)
        ball = _opposite(points, _members(rig, f"eye_{side}"))
        middle = points[list(ball)].mean(axis=0)
        lid = np.einsum("lk,lkc->lc", rows[:, 3:], points[rows[:, :3].astype(int)])
        rng = np.random.default_rng([side == "left", upper])
        share = np.sort(rng.uniform(BARE_ENDS, 1 - BARE_ENDS, row.count))
        for at, root in zip(share, _along(lid, share), strict=True):
            place, _, face, _ = skin.find_nearest(root.tolist())
            carriers = triangles[face]
            root_weights = _weights(np.array(place), points[carriers])
            away, along, across = _axes(np.array(place), middle, points[corners])
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
    _write(mesh, np.concatenate(rest))
    for name, values in indices.items():
        attribute = mesh.attributes.new(name, "INT", "POINT")
        attribute.data.foreach_set("value", np.concatenate(values))
    for name, vectors in ((WEIGHTS, weights), (OFFSET, offsets)):
        attribute = mesh.attributes.new(name, "FLOAT_VECTOR", "POINT")
        attribute.data.foreach_set("vector", np.concatenate(vectors).astype(np.float32).ravel())


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


def _write(mesh: bpy.types.Mesh, points: np.ndarray) -> None:
    """Vertices (hairs * SECTIONS * SIDES, 3), and the quads round each hair."""
    hairs = len(points) // (SECTIONS * SIDES)
    section, side = np.mgrid[: SECTIONS - 1, :SIDES]
    after = (side + 1) % SIDES
    quad = np.stack(
        [
            section * SIDES + side,
            section * SIDES + after,
            (section + 1) * SIDES + after,
            (section + 1) * SIDES + side,
        ],
        axis=-1,
    ).reshape(-1, 4)
    quads = (np.arange(hairs)[:, None, None] * SECTIONS * SIDES + quad).reshape(-1, 4)
    mesh.from_pydata(points.tolist(), [], quads.tolist())
    mesh.update()
    mesh.shade_smooth()


def _axes(root: np.ndarray, middle: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(3, 3) away from the eyeball, along the eye, across both: as the nodes have them."""
    away = root - middle
    away /= np.linalg.norm(away)
    across = np.cross(away, corners[1] - corners[0])
    across /= np.linalg.norm(across)
    return np.stack([away, np.cross(across, away), across])


def _along(lid: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Points at shares of the way along a lid (k, 3), on a curve through it."""
    before = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(lid, axis=0), axis=1))])
    at = share * before[-1]
    segment = np.clip(np.searchsorted(before, at, side="right") - 1, 0, len(lid) - 2)
    t = ((at - before[segment]) / np.diff(before)[segment])[:, None]
    padded = np.concatenate([[2 * lid[0] - lid[1]], lid, [2 * lid[-1] - lid[-2]]])
    a, b, c, d = (padded[segment + k] for k in range(4))  # Catmull and Rom 1974
    curve: np.ndarray = 0.5 * (
        2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t**2 + (3 * b - a - 3 * c + d) * t**3
    )
    return curve


def _weights(point: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(3,) barycentric weights of a point of a triangle (3, 3)."""
    edges = (corners[:2] - corners[2]).T
    first = np.linalg.lstsq(edges, point - corners[2], rcond=None)[0]
    return np.array([*first, 1 - first.sum()])


def _opposite(points: np.ndarray, ball: np.ndarray) -> tuple[int, int]:
    """Two opposite vertices of an eyeball, so that their middle is its own."""
    middle = 0.5 * (points[ball].min(axis=0) + points[ball].max(axis=0))
    first = int(ball[points[ball, 0].argmin()])
    other = np.linalg.norm(points[ball] + points[first] - 2 * middle, axis=1).argmin()
    return first, int(ball[other])


def _members(rig: bpy.types.Object, group: str) -> np.ndarray:
    """The vertices of a vertex group."""
    index = rig.vertex_groups[group].index
    found = [v.index for v in rig.data.vertices if any(each.group == index for each in v.groups)]
    return np.array(found)


def _skin_tree(mesh: bpy.types.Mesh, points: np.ndarray) -> tuple[BVHTree, np.ndarray]:
    """What finds the nearest point of the skin, and its triangles' vertices."""
    mesh.calc_loop_triangles()
    count = len(mesh.loop_triangles)
    corners, material = np.empty(3 * count, np.int32), np.empty(count, np.int32)
    mesh.loop_triangles.foreach_get("vertices", corners)
    mesh.loop_triangles.foreach_get("material_index", material)
    names = [None if each is None else each.name for each in mesh.materials]
    is_skin = [str(name).startswith(f"Facestage {PARTS[SKIN].capitalize()}") for name in names]
    triangles = corners.reshape(-1, 3)[np.array(is_skin)[material]]
    return BVHTree.FromPolygons(points.tolist(), triangles.tolist()), triangles

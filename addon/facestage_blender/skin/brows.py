"""Brow hair: as dense as the albedo is dark about the brows, each hair in the color of its place.

An object of its own, as lashes are; geometry nodes carry each hair with the triangle that it grows
from. Hairs rise at the inner end, lie along the brow from its middle on, and converge from its
upper and lower border. About 0.7 hairs a square millimetre where it is dense, 6 to 9 mm long.
"""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np
from mathutils.bvhtree import BVHTree

from facestage.contract.errors import InputError
from facestage.contract.face_model import SKIN

from ..pictures.images import image_pixels
from .brow_paint import restore_paint, thin_paint
from .eye_material import render_uvs
from .hairs import SECTIONS, SIDES, write_hairs
from .lids import (
    BORDERS_KEY,
    along_curve,
    color_growth,
    grown,
    new_growth,
    part_slots,
    part_tree,
    remove_growth,
    rest_points,
    triangle_weights,
)
from .material import node_at, plain_material
from .vector_nodes import OFFSET, ROOT, WEIGHTS, RiggedVectors

NAME = "Facestage Brows"
ROUGHNESS, UNKNOWN = 0.45, (0.03, 0.02, 0.014)
# The band that is looked through for hair: cells along and across, and how far it reaches, of
# the brow's own height, to either side of its middle; metres a brow's band goes past its ends.
ALONG, ACROSS, REACH, PAST = 56, 25, 2.2, 0.006
# Darkness (of the logarithm, below the skin about it) at which hair begins, and is dense.
BEGINS, DENSE = 0.15, 0.6
NEAR = 0.7  # how far from its line hair grows, of the band's half
OTHER_SIDE = 0.6  # of the other brow's density, for what hair or shadow hides in the photo
PER_MM2 = 0.7
THICK = 0.006  # metres across a full brow
LENGTH, RADIUS, HEIGHT = 0.0078, 0.00004, 0.0007  # metres; how high a hair's tip lies
# How much a hair's own place counts beside the whole brow for its color, and how far hairs vary.
OWN_PLACE, VARIES = 0.5, 0.15
DARKEST = 0.004
COLOR = "facestage_hair_color"  # attribute of the hairs' vertices
# Below hair: how much of the paint bare skin takes the place of where hair is dense, so that what
# is below is so many times as light as the paint at most; how far from a place of the band a vertex
# follows it (metres), and how dense bare skin may be.
THINNED, LIGHTER, FOLLOWS, BARE = 0.6, 1.8, 0.0015, 0.05


@dataclass(frozen=True)
class Band:
    """The band of one brow: places (along, across, 3) from its inner end and from below, how dense
    hair is there (along, across), how dense it is seen, and linear albedo (along, across, 3).
    """

    places: np.ndarray
    density: np.ndarray
    seen: np.ndarray
    albedo: np.ndarray


def has_brows(rig: bpy.types.Object) -> bool:
    """Whether it is known where a rig has its brows."""
    return BORDERS_KEY in rig.data


def brows_of(rig: bpy.types.Object) -> bpy.types.Object | None:
    """The rig's brow hair, or None."""
    return grown(rig, NAME)


def grow_brows(rig: bpy.types.Object) -> bpy.types.Object:
    """Give a rig brow hair where its albedo shows some. Raises InputError for one whose brows are
    not known.
    """
    if not has_brows(rig):
        raise InputError(
            "Nobody said where this rig's brows are; build the rig of a face model again."
        )
    remove_brows(rig)
    brows = new_growth(rig, NAME, _group(rig), plain_material(NAME, UNKNOWN, ROUGHNESS))
    _fill(brows, rig)
    return brows


def renew_brows(rig: bpy.types.Object) -> None:
    """Let the brow hair that a rig had before its mesh or textures changed grow again, where it has
    brows.
    """
    if brows_of(rig) is None:
        return
    if has_brows(rig):
        grow_brows(rig)
    else:
        remove_brows(rig)


def remove_brows(rig: bpy.types.Object) -> None:
    """Take a rig's brow hair away, and all that only it uses."""
    if brows_of(rig) is not None:
        restore_paint(rig)
    remove_growth(brows_of(rig))


def _group(rig: bpy.types.Object) -> bpy.types.NodeTree:
    """New nodes that put each vertex at its offset from its root, in axes of the root's
    triangle: along its first side, and out of the skin.
    """
    build = RiggedVectors(NAME, rig)
    first, second, third = (build.point_of(name) for name in ROOT)
    side = build.math("SUBTRACT", second, first)
    normal = build.math("CROSS_PRODUCT", side, build.math("SUBTRACT", third, first))
    along, out = build.math("NORMALIZE", side), build.math("NORMALIZE", normal)
    axes = along, out, build.math("CROSS_PRODUCT", along, out)
    offset = build.split(build.named(OFFSET, "FLOAT_VECTOR"))
    moved = [build.scaled(axis, s) for axis, s in zip(axes, offset, strict=True)]
    place = build.sum([build.root(), *moved])
    build.tree.links.new(build.placed(build.given, place), build.result)
    return build.tree


def _fill(brows: bpy.types.Object, rig: bpy.types.Object) -> None:
    points = rest_points(rig.data)
    skin, triangles = part_tree(rig.data, points)
    bands = _bands(rig, points, skin)
    colors = _colors(bands)
    lines = [hair for k, band in enumerate(bands) for hair in _hairs(band, colors[k], skin, k)]
    roots, weights, offsets, rest, shades = [], [], [], [], []
    for line, face, color in lines:
        corners = triangles[face]
        tube = _tube(line)
        axes = _axes(points[corners])
        roots.append(np.tile(corners, (len(tube), 1)))
        weights.append(np.tile(triangle_weights(line[0], points[corners]), (len(tube), 1)))
        offsets.append((tube - line[0]) @ axes.T)
        rest.append(tube)
        shades.append(np.tile(color, (len(tube), 1)))
    if not lines:
        return
    _show_colors(brows, np.concatenate(shades).mean(axis=0))
    thin_paint(rig, *_below(bands, points))
    write_hairs(
        brows.data,
        np.concatenate(rest),
        dict(zip(ROOT, np.concatenate(roots).T, strict=True)),
        {
            WEIGHTS: np.concatenate(weights),
            OFFSET: np.concatenate(offsets),
            COLOR: np.concatenate(shades),
        },
    )


def _show_colors(brows: bpy.types.Object, mean: np.ndarray) -> None:
    """Let each hair show the color of its vertices, ``mean`` where nothing else can be shown."""
    red, green, blue = mean.tolist()
    color_growth(brows, (red, green, blue))
    tree = brows.data.materials[0].node_tree
    surface = next(each for each in tree.nodes if "Base Color" in each.inputs)
    own = node_at(tree.nodes, "ShaderNodeAttribute", -300, 0)
    own.attribute_name = COLOR
    tree.links.new(own.outputs["Color"], surface.inputs["Base Color"])


def _colors(bands: list[Band]) -> list[np.ndarray]:
    """Of each band the linear color (along, across, 3) of a hair that grows there, by how far the
    albedo is from bare skin there and in the whole of both brows.
    """
    bare = [_bare(band)[:, None] for band in bands]
    less = [
        np.log(np.maximum(band.albedo, 1e-4) / np.maximum(skin, 1e-4))
        for band, skin in zip(bands, bare, strict=True)
    ]
    seen = np.concatenate([each.seen.ravel() for each in bands])
    chosen = seen >= 0.7 * seen.max()
    whole = np.concatenate([each.reshape(-1, 3) for each in less])[chosen].mean(axis=0)
    found = []
    for band, skin, own in zip(bands, bare, less, strict=True):
        share = OWN_PLACE * band.seen[..., None]
        hair = skin * np.exp(share * own + (1 - share) * whole)
        found.append(np.clip(hair, DARKEST, 1.0))
    return found


def _below(bands: list[Band], points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of each vertex (n, 3): the albedo (n, 3) of the skin about the brow that it lies below, and
    the share (n,) of it that shows.
    """
    color, share = np.zeros(points.shape), np.zeros(len(points))
    for band in bands:
        places = band.places.reshape(-1, 3)
        low, high = places.min(axis=0) - 2 * FOLLOWS, places.max(axis=0) + 2 * FOLLOWS
        near = np.flatnonzero(((points > low) & (points < high)).all(axis=1))
        square = ((points[near, None] - places) ** 2).sum(axis=2)
        weight = np.exp(-square / FOLLOWS**2)
        total = weight.sum(axis=1)
        near, weight, total = near[total > 0.1], weight[total > 0.1], total[total > 0.1]
        if not len(near):
            continue
        skin = np.repeat(_bare(band), ACROSS, axis=0)
        color[near] = weight @ skin / total[:, None]
        share[near] = weight @ (_thinned(band) * band.seen).ravel() / total
    return color, share


def _thinned(band: Band) -> np.ndarray:
    """(along, across) the share of a brow's paint that bare skin takes the place of."""
    paint = band.albedo.mean(axis=2)
    lack = np.maximum(_bare(band).mean(axis=1)[:, None] - paint, 1e-6)
    return np.minimum(THINNED, (LIGHTER - 1) * paint / lack)


def _bare(band: Band) -> np.ndarray:
    """(along, 3) the mean albedo of bare skin above and below a brow, smoothly along it."""
    bare = (band.seen < BARE) + 1e-6
    light = (bare[..., None] * band.albedo).sum(axis=1)
    wide = np.ones(15)

    def blurred(values: np.ndarray) -> np.ndarray:
        return np.convolve(np.pad(values, 7, "edge"), wide, "valid")

    total = blurred(bare.sum(axis=1))
    return np.stack([blurred(light[:, k]) / total for k in range(3)], axis=1)


def _axes(corners: np.ndarray) -> np.ndarray:
    """(3, 3) rows: the axes of a triangle (3, 3), as the nodes have them."""
    side = corners[1] - corners[0]
    normal = np.cross(side, corners[2] - corners[0])
    along, out = side / np.linalg.norm(side), normal / np.linalg.norm(normal)
    return np.stack([along, out, np.cross(along, out)])


def _bands(rig: bpy.types.Object, points: np.ndarray, skin: BVHTree) -> list[Band]:
    """The bands of the right brow and of the left one."""
    rows = np.array(rig.data[BORDERS_KEY]).reshape(2, 2, -1, 6)  # side, upper and lower, place
    marks = np.einsum("sulk,sulkc->sulc", rows[..., 3:], points[rows[..., :3].astype(int)])
    found = []
    for upper, lower in marks:
        middle, high = 0.5 * (upper + lower), upper - lower
        before = np.linalg.norm(np.diff(middle, axis=0), axis=1).sum()
        share = np.linspace(-PAST / before, 1 + PAST / before, ALONG)
        line, rise = along_curve(middle, share), along_curve(high, share)
        across = 0.5 * REACH * np.linspace(-1, 1, ACROSS)
        grid = line[:, None] + across[:, None] * rise[:, None]
        near = [skin.find_nearest(each.tolist()) for each in grid.reshape(-1, 3)]
        places = np.array([each[0] for each in near])
        albedo = _albedo(rig, points, places, [each[2] for each in near])
        found.append((places.reshape(grid.shape), albedo.reshape(grid.shape)))
    seen = [_darkness(albedo) for _, albedo in found]
    return [
        Band(places, np.maximum(seen[k], OTHER_SIDE * seen[1 - k]), seen[k], albedo)
        for k, (places, albedo) in enumerate(found)
    ]


def _darkness(albedo: np.ndarray) -> np.ndarray:
    """(along, across) 0..1, how dense hair is that makes albedo (along, across, 3) as dark as it
    is beside the skin above and below.
    """
    light = np.log(np.maximum(albedo.mean(axis=2), 1e-4))
    kernel = np.ones(9) / 9
    skin = np.quantile(light, 0.8, axis=1)
    skin = np.convolve(np.pad(skin, 4, "edge"), kernel, "valid")
    dense = np.clip((skin[:, None] - light - BEGINS) / (DENSE - BEGINS), 0, 1)
    across, along = np.linspace(-1, 1, dense.shape[1]), np.linspace(-1, 1, dense.shape[0])
    # Hair lies about one line near the middle; what is dark elsewhere is the eye's socket, or the
    # shade of hair of the head.
    likely = np.convolve(np.pad(dense.sum(axis=0), 2), np.ones(5), "valid")
    centre = across[np.argmax(likely * np.exp(-((across / 0.5) ** 2)))]
    near = dense * np.clip((NEAR - np.abs(across - centre)) / 0.3, 0, 1)
    weight = near.sum(axis=1)
    line = (near * across).sum(axis=1) + centre
    line = np.convolve(np.pad(line, 4, "edge"), kernel, "valid")
    line /= np.convolve(np.pad(weight + 1, 4, "edge"), kernel, "valid")
    about = np.clip((NEAR - np.abs(across - line[:, None])) / 0.25, 0, 1)
    ends = np.clip((1 - np.abs(along)) / 0.06, 0, 1)[:, None]
    return np.asarray(dense * about * ends)


def _albedo(
    rig: bpy.types.Object, points: np.ndarray, places: np.ndarray, faces: list[int]
) -> np.ndarray:
    """(n, 3) what the rig's albedo shows at places (n, 3) of its skin's triangles."""
    image, layer = rig.facestage_face.albedo_image, render_uvs(rig.data)
    if image is None or layer is None:
        return np.ones((len(places), 3))
    pixels = image_pixels(image)[..., :3]
    height, width = pixels.shape[:2]
    uvs = np.empty(2 * len(rig.data.loops), np.float32)
    layer.uv.foreach_get("vector", uvs)
    loops = _skin_loops(rig.data)[faces]
    corner = np.empty(len(rig.data.loops), np.int32)
    rig.data.loops.foreach_get("vertex_index", corner)
    weights = np.array(
        [triangle_weights(p, points[corner[c]]) for p, c in zip(places, loops, strict=True)]
    )
    u, v = np.einsum("nk,nkc->cn", weights, uvs.reshape(-1, 2)[loops])
    row = np.clip(((1 - v) * height).astype(int), 0, height - 1)
    return np.asarray(pixels[row, np.clip((u * width).astype(int), 0, width - 1)])


def _skin_loops(mesh: bpy.types.Mesh) -> np.ndarray:
    """(triangles, 3) the corners of the skin's triangles, in the order of part_tree."""
    count = len(mesh.loop_triangles)
    loops, material = np.empty(3 * count, np.int32), np.empty(count, np.int32)
    mesh.loop_triangles.foreach_get("loops", loops)
    mesh.loop_triangles.foreach_get("material_index", material)
    return loops.reshape(-1, 3)[np.isin(material, part_slots(mesh, SKIN))]


def _hairs(
    band: Band, colors: np.ndarray, skin: BVHTree, side: int
) -> list[tuple[np.ndarray, int, np.ndarray]]:
    """Lines (SECTIONS, 3) of hairs, the triangle that each grows from, and its color (3,), about
    that of its place in ``colors`` (along, across, 3).
    """
    rng = np.random.default_rng([7, side])
    places, density = band.places, band.density
    step = np.linalg.norm(np.diff(places, axis=0), axis=2).mean()
    rise = np.linalg.norm(np.diff(places, axis=1), axis=2).mean()
    expected = (PER_MM2 * 1e6 * step * rise) * density
    total = rng.poisson(expected.sum())
    if not total:
        return []
    cell = rng.choice(expected.size, total, p=(expected / expected.sum()).ravel())
    i, j = np.unravel_index(cell, expected.shape)
    i, j = np.clip(i, 1, ALONG - 2), np.clip(j, 1, ACROSS - 2)
    forward, up = places[i + 1, j] - places[i - 1, j], places[i, j + 1] - places[i, j - 1]
    jitter = rng.uniform(-0.5, 0.5, (2, total, 1))
    start = places[i, j] + 0.5 * jitter[0] * forward + 0.5 * jitter[1] * up
    share = i / (ALONG - 1)
    aside = 2 * j / (ACROSS - 1) - 1
    # Up at the inner end, along from the middle, down towards the outer end; from either border
    # towards the middle.
    angle = np.interp(share, (0, 0.2, 0.5, 1), (1.25, 0.8, 0.25, -0.05))
    # A thin brow has short hairs that lie flat.
    thick = np.clip(rise * (density.sum(axis=1)[i]) / THICK, 0.4, 1.0)
    angle = angle * thick - 0.7 * aside * np.clip(share / 0.3, 0, 1) + rng.normal(0, 0.13, total)
    length = LENGTH * np.interp(share, (0, 0.3, 0.7, 1), (0.8, 1.1, 1.0, 0.7))
    length = length * (0.4 + 0.6 * thick) * rng.uniform(0.7, 1.15, total)
    ahead = _unit(forward) * np.cos(angle)[:, None] + _unit(up) * np.sin(angle)[:, None]
    own = np.clip(colors[i, j] * np.exp(rng.normal(0, VARIES, (total, 1))), DARKEST, 1.0)
    drawn = []
    for root, direction, long, color in zip(start, ahead, length, own, strict=True):
        line, normals = [], []
        place, _, face, _ = skin.find_nearest(root.tolist())
        for s in np.linspace(0, 1, SECTIONS):
            ahead_of = np.array(place) + s * long * direction
            spot, out, _, _ = skin.find_nearest(ahead_of.tolist())
            line.append(np.array(spot))
            normals.append(np.array(out))
        heights = HEIGHT * np.linspace(0, 1, SECTIONS) ** 0.7 * rng.uniform(0.5, 1.4)
        drawn.append((np.array(line) + heights[:, None] * np.array(normals), face, color))
    return drawn


def _unit(vectors: np.ndarray) -> np.ndarray:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12))


def _tube(line: np.ndarray) -> np.ndarray:
    """(SECTIONS * SIDES, 3) the vertices of a hair along a line (SECTIONS, 3)."""
    ahead = line[-1] - line[0]
    one = np.cross(ahead, [0.0, 0.0, 1.0])
    one /= max(np.linalg.norm(one), 1e-12)
    two = np.cross(ahead, one)
    two /= max(np.linalg.norm(two), 1e-12)
    angle = 2 * np.pi * np.arange(SIDES) / SIDES
    ring = np.cos(angle)[:, None] * one + np.sin(angle)[:, None] * two
    s = np.linspace(0, 1, SECTIONS)
    thick = RADIUS * ((1 - s) ** 0.6 + 0.1)
    return (line[:, None] + thick[:, None, None] * ring).reshape(-1, 3)

"""Wet eyes: a clear shell over each eyeball with the cornea's bulge, and the tears along the lids.

An object of its own, as lashes are: the rig keeps the vertices that a result counts. What is seen
through the cornea is in ``iris_depth.py``.

The cornea's front is a sphere of 7.8 mm radius that leaves the white at a radius of 5.9 mm; tears
between eyeball and lid stand about 0.3 mm high (Bron, Tripathi and Tripathi 1997, "Wolff's Anatomy
of the Eye and Orbit"). Both reflect as water does.
"""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Vector
from mathutils.bvhtree import BVHTree

from facestage.contract.face_model import EYES

from .iris_depth import flatten_iris, sink_iris
from .lids import (
    LIDS,
    along_curve,
    group_members,
    grown,
    has_lids,
    lid_table,
    new_growth,
    opposite_pair,
    part_tree,
    remove_growth,
    require_lids,
    rest_points,
    triangle_weights,
)
from .wet_grids import WetGrids
from .wet_nodes import TEAR_ROUGHNESS, TEAR_SHINE, wet_group, wet_material

NAME = "Facestage Wet Eyes"
CORNEA, LIMBUS = 0.0078, 0.0059  # radii, metres
FILM = 0.00006  # of tears on the eyeball, which hides how coarse the mesh is
SOFT = 0.0004  # over which the cornea's bulge goes over into the white
REACH = np.radians(72.0)  # of the shell, from the eye's axis
RINGS, AROUND = 36, 64
PLACES, ACROSS = 48, 7  # of a lid's tears: along it, and from the lid to the eyeball
BARE_ENDS = 0.05  # shares of a lid at its corners
# From the lid's border down behind it, and up over the eyeball, metres; how they thin out there,
# and how far from the eyeball they begin, at least and at most.
TEAR_DOWN, TEAR_UP, HOLLOW, GAP = 0.00015, 0.00045, 2.0, (0.00018, 0.0005)
LOOK_DOWN, LOOK_UP, LOOKS = 0.002, 0.004, 121  # for the border, from a lid's landmarks
SIDES = ("left", "right")
FRONT = np.array([0.0, -1.0, 0.0])  # where eyes look, in the rig's axes


def wet_eyes_of(rig: bpy.types.Object) -> bpy.types.Object | None:
    """What makes the rig's eyes wet, or None."""
    return grown(rig, NAME)


def wet_eyes(rig: bpy.types.Object) -> bpy.types.Object:
    """Give the eyes of a rig cornea and tears. Raises InputError where lids are not known."""
    require_lids(rig)
    dry_eyes(rig)
    growth = new_growth(rig, NAME, wet_group(rig), wet_material(NAME))
    growth.data.materials.append(wet_material(f"{NAME}, Tears", TEAR_ROUGHNESS, TEAR_SHINE))
    growth.visible_shadow = False
    _fill(growth.data, rig)
    sink_iris(rig)
    return growth


def keep_wet(rig: bpy.types.Object) -> None:
    """Let wet eyes stay so under new textures."""
    if wet_eyes_of(rig) is not None:
        sink_iris(rig)


def renew_wet_eyes(rig: bpy.types.Object) -> None:
    """Make eyes that were wet before the rig's mesh changed wet again, if it has such eyes."""
    if wet_eyes_of(rig) is None:
        return
    if has_lids(rig):
        wet_eyes(rig)
    else:
        dry_eyes(rig)


def dry_eyes(rig: bpy.types.Object) -> None:
    """Take cornea and tears away."""
    remove_growth(wet_eyes_of(rig))
    flatten_iris(rig)


def _fill(mesh: bpy.types.Mesh, rig: bpy.types.Object) -> None:
    """The vertices with their attributes, and their faces: two shells, then the tears of each
    lid.
    """
    points, grids = rest_points(rig.data), WetGrids()
    eyes, triangles = part_tree(rig.data, points, EYES)
    pairs = {side: opposite_pair(points, group_members(rig, f"eye_{side}")) for side in SIDES}
    for pair in pairs.values():
        centre, half = _ball(points, pair)
        place, face, radius = _shell(eyes, centre)
        roots = triangles[face]
        weights = [triangle_weights(p, points[t]) for p, t in zip(place, roots, strict=True)]
        grids.add(place, roots, weights, pair, (RINGS, AROUND), wraps=True)
        grids.attributes(radius / half, *np.zeros((3, len(place))))
    skin, triangles = part_tree(rig.data, points)
    for (side, upper), rows in zip(LIDS, lid_table(rig.data), strict=True):
        lid = np.einsum("lk,lkc->lc", rows[:, 3:], points[rows[:, :3].astype(int)])
        share = np.linspace(BARE_ENDS, 1 - BARE_ENDS, PLACES)
        found = [skin.find_nearest(each.tolist()) for each in along_curve(lid, share)]
        place, roots = np.array([each[0] for each in found]), triangles[[each[2] for each in found]]
        weights = [triangle_weights(p, points[t]) for p, t in zip(place, roots, strict=True)]
        grids.add(
            np.repeat(place, ACROSS, axis=0),
            np.repeat(roots, ACROSS, axis=0),
            np.repeat(weights, ACROSS, axis=0),
            pairs[side],
            (PLACES, ACROSS),
            wraps=False,
            flips=upper == (side == "right"),
        )
        centre, half = _ball(points, pairs[side])
        surface = _front_radius(eyes, centre)
        rise, lift = _meniscus(skin, place, centre, surface, -1.0 if upper else 1.0)
        ones = np.ones(rise.size)
        grids.attributes(surface / half * ones, ones, rise.ravel(), lift.ravel())
    grids.write(mesh)


def _meniscus(
    skin: BVHTree, place: np.ndarray, centre: np.ndarray, surface: float, opening: float
) -> tuple[np.ndarray, np.ndarray]:
    """Of tears at places on a lid (n, 3), how far up they are from there and how far from the
    eyeball: (n, ACROSS) each, metres.
    """
    edge, gap = _borders(skin, place, centre, surface, opening)
    across = np.linspace(0.0, 1.0, ACROSS)
    high = TEAR_DOWN + TEAR_UP * np.sin(np.pi * np.linspace(0, 1, len(place))) ** 0.5
    rise = edge[:, None] + opening * (across * high[:, None] - TEAR_DOWN)
    return rise, gap[:, None] * (1 - across) ** HOLLOW


def _ball(points: np.ndarray, pair: tuple[int, int]) -> tuple[np.ndarray, float]:
    """An eyeball's centre (3,) and half the distance of its pair."""
    first, other = points[list(pair)]
    return 0.5 * (first + other), 0.5 * float(np.linalg.norm(first - other))


def _shell(eyes: BVHTree, centre: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The vertices of a shell before they are lifted: where they lie on the eyeball (n, 3), on
    which triangle (n,), and how far from the centre they go (n,).
    """
    polar = REACH * (np.arange(RINGS) + 0.02) / (RINGS - 1 + 0.02)
    turn = 2 * np.pi * np.arange(AROUND) / AROUND
    ring = np.stack([np.cos(turn), 0 * turn, np.sin(turn)], axis=1)
    directions = np.sin(polar)[:, None, None] * ring + np.cos(polar)[:, None, None] * FRONT
    flat = directions.reshape(-1, 3)
    found = [_outermost(eyes, centre, each) for each in flat]
    place, face = np.array([each[0] for each in found]), np.array([each[1] for each in found])
    radius = np.linalg.norm(place - centre, axis=1).reshape(RINGS, AROUND)
    profile = np.median(radius, axis=1)
    white = np.maximum(profile, np.convolve(np.pad(profile, 2, "edge"), np.ones(5) / 5, "valid"))
    white = white + FILM
    return place, face, np.repeat(_bulging(polar, white), AROUND)


def _bulging(polar: np.ndarray, white: np.ndarray) -> np.ndarray:
    """(rings,) radii of the eyeball with its cornea: ``white`` (rings,) at polar angles (rings,),
    or the cornea's where that is farther out.
    """
    limbus = np.interp(LIMBUS, white * np.sin(polar), polar)
    level = np.interp(limbus, polar, white) * np.cos(limbus)
    middle = level - np.sqrt(CORNEA**2 - LIMBUS**2)
    # The far intersection of each direction with the cornea's sphere.
    along = middle * np.cos(polar)
    inside = CORNEA**2 - (middle * np.sin(polar)) ** 2
    cornea = np.where(inside > 0, along + np.sqrt(np.maximum(inside, 0)), 0.0)
    gap = np.clip(0.5 + 0.5 * (cornea - white) / SOFT, 0, 1)  # a smooth maximum
    blended: np.ndarray = white + gap * (cornea - white) + SOFT * gap * (1 - gap)
    return blended


def _borders(
    skin: BVHTree, place: np.ndarray, centre: np.ndarray, radius: float, opening: float
) -> tuple[np.ndarray, np.ndarray]:
    """How far up from places (n, 3) on a lid its border is, (n,), and how far from the eyeball,
    (n,), metres: where the lid covers the eyeball no more, towards the ``opening``.
    """
    looks = np.linspace(-LOOK_DOWN, LOOK_UP, LOOKS) * opening
    found = [_border(skin, each, centre, radius, looks) for each in place]
    edges, gaps = np.array([each[0] for each in found]), np.array([each[1] for each in found])
    kernel = np.ones(5) / 5  # as smooth as a lid is
    smooth = [np.convolve(np.pad(v, 2, "edge"), kernel, "valid") for v in (edges, gaps)]
    return smooth[0], smooth[1]


def _border(
    skin: BVHTree, place: np.ndarray, centre: np.ndarray, radius: float, looks: np.ndarray
) -> tuple[float, float]:
    """The same for one place (3,), looking at heights; its own where no border is."""
    rise, gap, covered = 0.0, GAP[0], False
    for look in looks:
        away = place - centre + np.array([0.0, 0.0, look])
        away /= np.linalg.norm(away)
        start = centre + (radius + 1e-5) * away
        hit, _, _, distance = skin.ray_cast(start.tolist(), away.tolist(), 0.008)
        if hit is None and covered:
            return rise, gap
        if hit is not None:
            rise, gap, covered = float(look), float(np.clip(distance, *GAP)), True
    return 0.0, GAP[0]


def _front_radius(eyes: BVHTree, centre: np.ndarray) -> float:
    """How far the white's surface is from the centre, beside the cornea, metres."""
    angle = np.radians(40.0)
    directions = [(s * np.sin(angle), -np.cos(angle), 0.0) for s in (-1, 1)]
    places = [_outermost(eyes, centre, np.array(each))[0] for each in directions]
    return float(np.mean([np.linalg.norm(np.array(each) - centre) for each in places]))


def _outermost(eyes: BVHTree, centre: np.ndarray, direction: np.ndarray) -> tuple[Vector, int]:
    """The eyeball's outermost point in a direction (3,), and its triangle."""
    start = centre + 0.03 * direction
    place, _, face, _ = eyes.ray_cast(start.tolist(), (-direction).tolist(), 0.03)
    if place is None:  # between two faces
        place, _, face, _ = eyes.find_nearest((centre + 0.012 * direction).tolist())
    return place, face

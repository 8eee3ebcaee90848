"""What a sculptor adds to the plain head: the angle and lower border of the jaw, the plane below
it, larynx and muscles of the neck, the nape and the trapezius, and the folds of the ears.

Modes, regions, landmarks and the atlas are read off the plain head (`assemble`); only the neutral
shape is sculpted, and not the face that photos explain: what was fitted before keeps its meaning.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.interpolate import PchipInterpolator
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from facestage.contract.face_model import SKIN
from facestage.models.head.assemble import SIDES, HeadMesh, window_chart
from facestage.models.head.base_surface import BaseSurface
from facestage.models.head.caruncle import fleshed
from facestage.models.head.ear import folded_ear
from facestage.models.head.ear_height import ears_lowered
from facestage.models.head.eyes import MARGIN
from facestage.models.head.features import EYE_RADIUS, smoothstep, to_segment
from facestage.models.head.masks import eye_center
from facestage.models.mesh.surface_harmonics import laplacian_and_mass

# Moves (x outward, y, z) in mm of the chart's nodes: for each level the stations 0 to 10, from the
# front midline round the left side to the back midline. They make the neck 355 mm round below the
# larynx, the mean of men and women (Gordon et al. 1989, "1988 Anthropometric Survey of U.S. Army
# Personnel"), and leave the jaw's angle 115 mm from the other (Zhuang and Bradtmiller 2005).
_MOVES = {
    # The neck's base falls from the seventh vertebra over the trapezius to the breastbone's notch.
    0.0: ((0, -9, -12), (-1.5, -8, -9.5), (-1.5, -6, -6.5), (0, -3, -6.5), (3, 1, -6.5),
          (7.5, 6, -8), (12, 10, -8.5), (15.5, 14, -6.5), (11.5, 19, -9), (6, 23, -11.5),
          (0, 25, -11)),
    1.0: ((0, -9, -6.5), (-0.5, -9, -4.5), (0.5, -8, -3.5), (0.5, -6, -2.5), (0, -3, -1.5),
          (-0.5, 0.5, -1.5), (0.5, 4.5, -3), (6, 8.5, -5), (6.5, 14, -6), (2.5, 18, -5.5),
          (0, 20, -3.5)),
    2.0: ((0, -3, -1), (0.5, -3, -1.5), (0.5, -2, -2), (0.5, -1.5, -2), (0, 0, -1.5),
          (-0.5, 1.5, -1.5), (-1, 4, -0.5), (-0.5, 7.5, -1), (0.5, 11.5, -3), (0.5, 15, -2),
          (0, 17, 0)),
    3.0: ((0, 0, -3), (0, 0, -3), (0, 1, -3), (-1, 1, -3), (-2.5, 1, -1.5), (-3, 0.5, -0.5),
          (-3.5, -1, 0), (-1.5, -3.5, -0.5), (0.5, -5.5, -1), (-0.5, -6, 0), (0, -5.5, 1)),
    # The plane below the jaw's border, and the hollow behind its angle.
    4.0: ((0, -1, -3), (0, -1, -3.5), (0, -0.5, -4.5), (-1.5, 0, -5), (-3.5, -0.5, -2.5),
          (-4, -2, -1), (-4, -4.5, -1.5), (-4.5, -3.5, -4), (0, -2.5, -0.5), (0.5, -1, 0.5),
          (0, -0.5, 0.5)),
    4.5: ((0, 0, 0), (0, 0, 0), (0, 0, 0), (0, 0, 0), (-0.5, 0, 0), (-1, -1.5, 0), (-2.2, -2, -2.2),
          (-2.5, -1.5, -5.5), (0, 0, 0.5), (-0.5, 0, 0), (0, -0.5, 0)),
    # The angle of the jaw, at station 6.
    5.0: ((0, 0, 0), (0, 0, 0), (0, 0, 0), (0, 0, 0), (0, 0, 0), (0, -0.5, 0.5), (0.3, -0.8, -1),
          (0.5, 4, 1.5), (0, 0, 0), (0, 0, 0), (0, 0, 0)),
    6.0: ((0, 0, 0),) * 11,
    26.0: ((0, 0, 0),) * 11,
}  # fmt: skip
# Ridges and hollows of the neck: two ends (x, y, z), width, height away from the neck's axis; mm.
_CORDS = (
    # sternocleidomastoid, from behind the ear to the breastbone, and the hollows on both its sides
    ((60, -56, -24), (13, -208, 28), 8.0, 3.2),
    ((52, -92, 6), (24, -170, 38), 9.0, -1.8),
    ((58, -100, -38), (56, -185, -8), 10.0, -1.5),
    # trapezius beside the furrow of the nape
    ((15, -55, -76), (20, -165, -86), 9.0, 1.8),
    ((0, -60, -78), (0, -150, -80), 7.0, -1.4),
    # thyroid cartilage, and the hollow above the notch of the breastbone
    ((0, -148, 48), (0, -157, 46), 8.0, 2.6),
    ((0, -196, 32), (0, -216, 24), 10.0, -1.5),
)
_NECK_AXIS_Z = -20.0
_EVENING_MM = 9.0
LID_OVER_EYE = 0.3  # mm, at the bottom of its fold: less lets the eyeball through where lids move


def sculpted(mesh: HeadMesh) -> np.ndarray:
    """(n, 3) mm, the vertices of the plain head with jaw, neck and ears sculpted."""
    station, level = mesh.chart.T
    skin = np.unique(mesh.polygons[mesh.polygon_part == SKIN])
    skin = skin[skin >= 0]
    skin = skin[level[skin] < 6.0]
    points = mesh.vertices[skin]
    side = np.where(station[skin] < 0, -1.0, 1.0)
    mirror = np.stack([side, np.ones_like(side), np.ones_like(side)], axis=-1)
    local = points * mirror + _moves(np.abs(station[skin]), level[skin])
    result = mesh.vertices.copy()
    result[skin] = _corded(local) * mirror
    shell = folded_ear(BaseSurface(), window_chart("ear_left"))
    # The order of the loops on the right is the left one's mirrored, as `eyes.mirrored` lays it.
    order = -np.arange(shell.shape[1]) + shell.shape[1] // 2
    result[mesh.loops["ear_left"][1:]] = shell
    result[mesh.loops["ear_right"][1:]] = shell[:, order] * [-1, 1, 1]
    for eye in SIDES:
        loops = mesh.loops[f"eye_{eye}"]
        result = _covering(fleshed(result, loops, eye), loops[: MARGIN + 1], eye)
    return ears_lowered(mesh, _evened(mesh, result))


def _covering(vertices: np.ndarray, lids: np.ndarray, side: str) -> np.ndarray:
    """Vertices with the ``lids`` (rings, m) nowhere nearer to the eyeball than `LID_OVER_EYE`."""
    center = eye_center(side)
    relative = vertices[lids] - center
    radius = np.linalg.norm(relative, axis=-1, keepdims=True)
    result = vertices.copy()
    result[lids] = center + relative * np.maximum(1.0, (EYE_RADIUS + LID_OVER_EYE) / radius)
    return result


def _evened(mesh: HeadMesh, vertices: np.ndarray) -> np.ndarray:
    """Vertices with the skull behind the ears, the nape and the skin around the ears smooth over
    `_EVENING_MM`: an implicit step of the squared Laplacian, which takes away creases and leaves
    the form (Desbrun et al. 1999, "Implicit Fairing of Irregular Meshes", section 3).
    """
    inner = mesh.grid[1:][mesh.grid[1:] >= 0]
    seams = np.concatenate([vertices[mesh.loops[f"ear_{side}"][1]] for side in SIDES])
    distance, _ = cKDTree(seams).query(vertices[inner])
    z = mesh.vertices[inner, 2]
    around = smoothstep((18.0 - distance) / 10.0) * smoothstep((4.0 - z) / 8.0)
    weight = np.zeros(len(vertices))
    weight[inner] = np.maximum(around, smoothstep((-8.0 - z) / 20.0))
    # What stands off the head does not bend it. Both ways to split a quad, so that the two halves
    # of the head stay each other's mirror image.
    polygons = mesh.polygons[mesh.polygon_part == SKIN]
    shell = np.concatenate([mesh.loops[f"ear_{side}"][2:].ravel() for side in SIDES])
    polygons = polygons[~np.isin(polygons, shell).any(axis=1)]
    used, corners = np.unique(
        np.where(polygons < 0, polygons[:, :1], polygons), return_inverse=True
    )
    corners = corners.reshape(-1, 4)
    faces = np.concatenate([np.roll(corners, -k, axis=1)[:, :3] for k in range(4)])
    laplacian, mass = laplacian_and_mass(vertices[used], faces)
    mass = np.maximum(mass, 1e-9)
    bending = laplacian @ sp.diags(1.0 / mass) @ laplacian
    step = sp.diags(mass) + _EVENING_MM**4 * sp.diags(weight[used]) @ bending
    result = vertices.copy()
    result[used] = splu(step.tocsc()).solve(mass[:, None] * vertices[used])
    return result


def _moves(station: np.ndarray, level: np.ndarray) -> np.ndarray:
    """(m, 3) mm at stations 0..10 and levels."""
    table = np.array(list(_MOVES.values()), np.float64)
    # Breadths are odd about both midlines, heights and depths even.
    unfolded = np.concatenate([table[:, :0:-1] * [-1, 1, 1], table], axis=1)
    across = PchipInterpolator(np.arange(-10, 11), unfolded, axis=1)(station)
    moves = np.empty((len(level), 3))
    for value in np.unique(level):
        here = level == value
        moves[here] = PchipInterpolator(list(_MOVES), across[:, here], axis=0)(value)
    return moves


def _corded(local: np.ndarray) -> np.ndarray:
    """Points (m, 3) of the left half with the cords of the neck raised."""
    outward = np.stack([local[:, 0], np.zeros(len(local)), local[:, 2] - _NECK_AXIS_Z], axis=-1)
    outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-9)
    height = np.zeros(len(local))
    for start, end, width, amount in _CORDS:
        for flip in (1.0, -1.0):
            distance, _ = to_segment(local * [flip, 1, 1], np.array(start), np.array(end))
            height += (
                amount * (1.0 if start[0] or flip > 0 else 0.0) * np.exp(-((distance / width) ** 2))
            )
    return local + height[:, None] * outward

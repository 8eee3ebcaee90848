"""Mean albedo of the head: pigment maps on the skin, brows, lips, a shade of hair, eyes and
teeth.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.interpolate import CubicSpline
from scipy.sparse.linalg import splu

from facestage.contract.face_model import MOUTH, SKIN
from facestage.models.anatomy.regions import GUM, PALATE, TONGUE
from facestage.models.anatomy.skin import HAEMOGLOBIN_MEAN, MELANIN_MEAN, skin_albedo
from facestage.models.head import caruncle, eyes, mouth, teeth
from facestage.models.head.assemble import SIDES, HeadMesh
from facestage.models.head.features import BROW_LINE
from facestage.models.head.masks import Masks, eye_center, smoothstep
from facestage.models.mesh.surface_harmonics import laplacian_and_mass

SCLERA, IRIS, IRIS_RIM, PUPIL = (
    (0.62, 0.57, 0.54),
    (0.15, 0.095, 0.055),
    (0.035, 0.028, 0.024),
    (0.008, 0.008, 0.008),
)
# GAP: relative to the crown
TOOTH, GAP = (0.62, 0.57, 0.48), (0.76, 0.67, 0.59)
FLESH = (0.50, 0.23, 0.20)  # in the corners of the eyes
HAIR = (0.045, 0.030, 0.022)
HAIRLINE_MM = 5.0  # over which hair thins
# Blood relative to the mean: front view centre (|x|, y), radii, gain. After the zones of Jimenez et
# al. 2010, "A practical appearance model for dynamic facial color".
_BLOOD = (
    ((38.0, -32.0), (20.0, 18.0), 0.75), ((0.0, -43.0), (11.0, 9.0), 0.8), ((15.0, -47.0),
    (7.0, 7.0), 0.6),
    ((0.0, -103.0), (16.0, 10.0), 0.25), ((30.0, 2.0), (20.0, 9.0), 0.25), ((0.0, 55.0),
    (50.0, 25.0), -0.15),
)  # fmt: skip
# Blood of the ears, likewise: those of people in photographs are redder than their cheeks by about
# 0.05 in log red over green (docs/textures.md).
EAR_BLOOD = 0.35


def mean_albedo(mesh: HeadMesh, masks: Masks) -> np.ndarray:
    """(n, 3) float64 linear RGB."""
    x, y, z = masks.points.T
    blood, melanin = np.ones(masks.count), np.ones(masks.count)
    for center, radii, gain in _BLOOD:
        bell = np.exp(
            -(((np.abs(x) - center[0]) / radii[0]) ** 2) - ((y - center[1]) / radii[1]) ** 2
        )
        blood += gain * bell * masks.front
    for side in SIDES:
        ear = np.unique(mesh.loops[f"ear_{side}"][3:])
        blood[ear] += EAR_BLOOD
        # Thin skin below and above the eye: more blood shows, and a little pigment.
        near = np.exp(-(((masks.eye_distance(side) - 13.0) / 6.0) ** 2))
        melanin += 0.22 * near * masks.front
        blood += 0.25 * near * masks.front
    color = skin_albedo(MELANIN_MEAN * melanin, HAEMOGLOBIN_MEAN * blood)
    color = _blend(color, (0.30, 0.115, 0.10), _lip_weight(mesh, masks))
    color = _blend(color, (0.36, 0.15, 0.13), _lid_edge_weight(mesh, masks))
    color = _fleshed(color, mesh)
    color = _blend(color, HAIR, 0.76 * brow_weight(masks))
    color = _blend(color, HAIR, 0.42 * hair_weight(masks))
    nostril = np.exp(
        -((((np.stack([np.abs(x), y, z], -1) - [6.6, -48.0, 103.0]) / [3.2, 4.5, 5.0]) ** 2).sum(1))
    )
    color = _blend(color, (0.06, 0.02, 0.016), 0.85 * np.minimum(1.6 * nostril, 1.0) * masks.skin)
    _paint_part(color, mesh, MOUTH, masks.mouth_bag, PALATE)
    for name, row in (("upper", teeth.UPPER), ("lower", teeth.LOWER)):
        color[mesh.teeth[name]] = _teeth_color(row).reshape(-1, 3)
    for side in SIDES:
        color[mesh.eyeballs[side]] = _eye_color(
            masks.points[mesh.eyeballs[side]] - eye_center(side)
        )
    return color


def brow_weight(masks: Masks) -> np.ndarray:
    """(n,) how much brow hair covers the skin."""
    x, y, z = masks.points.T
    line_x, line_y = np.array(BROW_LINE).T
    middle = CubicSpline(line_x, line_y)(np.clip(np.abs(x), line_x[0] - 2.0, line_x[-1] + 3.0))
    along = np.clip((np.abs(x) - line_x[0]) / (line_x[-1] - line_x[0]), 0.0, 1.0)
    thickness = 1.9 + 1.9 * (1 - along) ** 0.7 * smoothstep(0.55 + 3.0 * along)
    across = np.exp(-(np.abs((y - middle) / thickness) ** 3))
    ends = smoothstep((np.abs(x) - line_x[0] + 4.0) / 5.0) * smoothstep(
        (line_x[-1] + 5.0 - np.abs(x)) / 12.0
    )
    return across * ends * masks.skin * (z > 50)


def hair_weight(masks: Masks) -> np.ndarray:
    """(n,) 1 where hair grows on the head, 0 on face, ears and neck; softer than the mesh is
    fine, so that no edge of it shows.
    """
    x, y, z = np.abs(masks.points[:, 0]), masks.points[:, 1], masks.points[:, 2]
    # The hairline: lowest at the forehead's middle, back above its corners, down the temples ...
    front = np.interp(
        x, (0.0, 18.0, 36.0, 46.0, 54.0, 61.0, 67.0, 72.0), (64, 67, 76, 72, 58, 42, 26, 12)
    )
    # ... behind the ears, to the nape.
    back = np.interp(z, (-95.0, -70.0, -38.0, -28.0, -6.0, 14.0), (-72, -68, -40, 12, 14, 16))
    line = back + smoothstep((z - 6.0) / 16.0) * (front - back)
    weight = smoothstep((y - line) / 18.0 + 0.5) * masks.skin
    for side in SIDES:
        weight[np.unique(masks.mesh.loops[f"ear_{side}"][2:])] = 0.0
    polygons = masks.mesh.polygons[masks.mesh.polygon_part == SKIN]
    polygons = np.where(polygons < 0, polygons[:, :1], polygons)
    used, corners = np.unique(polygons, return_inverse=True)
    corners = corners.reshape(-1, 4)
    faces = np.concatenate([corners[:, :3], corners[:, [0, 2, 3]]])
    faces = faces[(faces[:, 0] != faces[:, 2]) & (faces[:, 1] != faces[:, 2])]
    laplacian, mass = laplacian_and_mass(masks.points[used], faces)
    step = splu((sp.diags(mass) + HAIRLINE_MM**2 * laplacian).tocsc())
    weight[used] = step.solve(mass * weight[used])
    return weight


def _eye_color(relative: np.ndarray) -> np.ndarray:
    radius = np.hypot(relative[:, 0], relative[:, 1])
    color = np.where((radius < eyes.PUPIL_RADIUS)[:, None], PUPIL, IRIS)
    rim = smoothstep((radius - 4.6) / 1.0)[:, None]
    color = color + rim * (np.array(IRIS_RIM) - color)
    outside = (relative[:, 2] < 0) | (radius > eyes.IRIS_RADIUS)
    color[outside] = SCLERA
    # Vessels towards the corners and the back.
    red = 0.35 * smoothstep((radius - 7.0) / 6.0)[:, None] * outside[:, None]
    return color * (1 - red * np.array([0.25, 0.55, 0.55]))


def _teeth_color(row: teeth.Row) -> np.ndarray:
    """(rows, m, 3): crowns that darken in the gaps and yellow towards the gum, and the gum."""
    positions, gap = teeth.strip(row)
    color = np.empty_like(positions)
    color[:] = TOOTH
    color[teeth.GUM_ROWS] *= (0.86, 0.78, 0.66)
    color[teeth.GUM_ROWS :] *= (1 - gap[:, None] * (1 - np.array(GAP)))[None]
    color[: teeth.GUM_ROWS] = GUM
    # Less light reaches the back of the mouth.
    deep = np.clip((positions[:1, :, 2] - 50.0) / 32.0, 0.0, 1.0)
    return color * (0.45 + 0.55 * deep)[..., None]


def _lip_weight(mesh: HeadMesh, masks: Masks) -> np.ndarray:
    loops = mesh.loops["mouth"]
    weight = np.zeros(masks.count)
    border = len(mouth.OUTER_LOOPS) + 1
    weight[loops[border]] = 0.45
    weight[loops[border + 1 :]] = 0.85
    return weight


def _lid_edge_weight(mesh: HeadMesh, masks: Masks) -> np.ndarray:
    weight = np.zeros(masks.count)
    for side in SIDES:
        weight[mesh.loops[f"eye_{side}"][eyes.MARGIN]] = 0.35
        weight[mesh.loops[f"eye_{side}"][eyes.MARGIN + 1 :]] = 0.8
    return weight


def _fleshed(color: np.ndarray, mesh: HeadMesh) -> np.ndarray:
    """Colors with the flesh in the corners of the eyes, red to white."""
    white = caruncle.whiteness(mesh)[:, None]
    flesh = np.array(FLESH) + white * (np.array(SCLERA) - FLESH)
    return color + caruncle.flesh(mesh)[:, None] * (flesh - color)


def _blend(color: np.ndarray, target: tuple[float, float, float], weight: np.ndarray) -> np.ndarray:
    """Towards the target in log space, as pigments mix."""
    return np.exp(np.log(color) * (1 - weight[:, None]) + np.log(target) * weight[:, None])


def _paint_part(
    color: np.ndarray,
    mesh: HeadMesh,
    part: int,
    mask: np.ndarray,
    target: tuple[float, float, float],
) -> None:
    color[mask] = target
    if part == MOUTH:
        color[mesh.tongue] = TONGUE

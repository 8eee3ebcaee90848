"""Identity modes named after measurements: smooth displacements of unit variance, in mm per
standard deviation.

Each mode is a sum of pulls. A pull is a bell-shaped weight in space times a displacement;
half-widths of breadths move by half of the published standard deviation (see anthropometry.py),
single points by the whole of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from facestage.models.head import gaussian_process, lids
from facestage.models.head.anthropometry import MEASUREMENTS
from facestage.models.head.assemble import SIDES
from facestage.models.head.masks import Masks, eye_center, smoothstep

MODE_COUNT = 80
_LOCK_INNER, _LOCK_OUTER = 15.5, 30.0
# The length of the lips decides how much of the teeth shows: teeth hardly follow it.
_LIP_HEIGHTS = ("upper_lip_height", "mouth_height", "lip_thickness_upper", "lip_thickness_lower")
_TEETH_FOLLOW_LIPS = 0.35
# mm. The means of men and women of what lips show of the upper incisors at rest, 1.9 and 3.4, lie
# as far apart (Vig and Brundo 1978).
_TEETH_HEIGHT_SD = 1.6
_EAR_SCALING = ("head_size", "ear_size", "ear_protrusion")


@dataclass(frozen=True)
class Pull:
    """Displacement `move` (outward, up, forward) times a Gaussian about `center` (|x|, y, z) of
    `radii`; mm.

    An infinite radius leaves that axis out. Breadth moves fade to zero at the midline over
    `midline` mm.
    """

    center: tuple[float, float, float]
    radii: tuple[float, float, float]
    move: tuple[float, float, float]
    midline: float = 12.0


INF = float("inf")
Field = Callable[[np.ndarray], np.ndarray]  # positions (m, 3) in mm -> displacements (m, 3) in mm


def _sd(name: str) -> float:
    return MEASUREMENTS[name].sd


PULLS: dict[str, tuple[Pull, ...]] = {
    "minimum_frontal_breadth": (
        Pull((52, 32, 55), (INF, 32, 40), (_sd("minimum_frontal_breadth") / 2, 0, 0), 40),
    ),
    "bizygomatic_breadth": (
        Pull((68, -18, 26), (INF, 34, 42), (_sd("bizygomatic_breadth") / 2, 0, 0), 45),
    ),
    "jaw_angle_width": (
        Pull((57, -78, 10), (INF, 34, 44), (_sd("bigonial_breadth") / 2, 0, 0), 40),
    ),
    "jaw_angle_height": (Pull((57, -78, 12), (30, 28, 30), (0, -5.0, 0)),),
    "chin_width": (Pull((20, -107, 80), (24, 18, 24), (2.6, 0, 0), 18),),
    "chin_projection": (Pull((0, -106, 90), (26, 18, 40), (0, 0, 3.2)),),
    "midface_projection": (Pull((12, -42, 95), (30, 26, 40), (0, 0, 2.4)),),
    "cheekbone_prominence": (Pull((46, -20, 70), (17, 14, 24), (1.4, 0, 1.9)),),
    "cheek_fullness": (Pull((44, -56, 62), (20, 22, 30), (2.6, 0, 2.2)),),
    "submental_fullness": (Pull((10, -126, 52), (36, 16, 28), (0.4, -3.2, 1.0)),),
    "temple_fullness": (Pull((60, 22, 45), (16, 24, 24), (2.2, 0, 0.6)),),
    "eye_spacing": (
        Pull((31, 0, 70), (INF, 20, 30), (_sd("interpupillary_distance") / 2, 0, 0), 24),
    ),
    "eye_height": (Pull((31, 0, 72), (22, 15, 30), (0, 1.7, 0)),),
    "eye_depth": (Pull((31, 0, 72), (20, 16, 30), (0, 0, 1.8)),),
    "brow_height": (Pull((30, 20, 86), (26, 10, 30), (0, 2.3, 0)),),
    "brow_ridge": (Pull((22, 18, 92), (26, 9, 30), (0, 0, 2.2)),),
    "brow_tilt": (
        Pull((45, 18, 78), (14, 10, 25), (0, 2.2, 0)),
        Pull((12, 20, 95), (10, 9, 25), (0, -1.4, 0)),
    ),
    "nose_protrusion": (Pull((0, -42, 116), (13, 17, 20), (0, 0, _sd("nose_protrusion"))),),
    "nose_breadth": (Pull((16, -47, 97), (9, 11, 18), (_sd("nose_breadth") / 2, 0, 0), 11),),
    "nose_tip_height": (Pull((0, -43, 114), (11, 12, 18), (0, 2.3, 0)),),
    "nose_tip_breadth": (Pull((8, -42, 110), (8, 9, 14), (1.2, 0, 0), 7),),
    "nose_bridge_height": (Pull((0, -8, 96), (9, 18, 25), (0, 0, 2.1)),),
    "nose_root_breadth": (
        Pull((9, -8, 88), (8, 18, 20), (_sd("nasal_root_breadth") / 2, 0, 0), 7),
    ),
    "nose_dorsum_hump": (
        Pull((0, -19, 104), (8, 9, 16), (0, 0, 1.5)),
        Pull((0, -36, 112), (9, 7, 16), (0, 0, -0.7)),
    ),
    "sellion_depth": (Pull((0, 2, 93), (10, 9, 22), (0, 0, -1.8)),),
    "nostril_flare": (Pull((15, -49, 98), (6, 6, 12), (0.8, 1.2, 0), 8),),
    "mouth_width": (Pull((26, -73, 86), (14, 14, 24), (_sd("lip_length") / 2, 0, 0), 22),),
    "mouth_height": (Pull((0, -73, 95), (34, 13, 40), (0, 1.8, 0)),),
    "mouth_corner_height": (Pull((25, -73, 86), (10, 9, 22), (0, 1.4, 0)),),
    "lip_thickness_upper": (Pull((0, -65.5, 99), (20, 3.6, 20), (0, 1.1, 0.9)),),
    "lip_thickness_lower": (Pull((0, -82, 96), (20, 4.5, 20), (0, -1.3, 0.9)),),
    "lip_protrusion": (Pull((0, -73, 97), (22, 12, 30), (0, 0, 2.0)),),
    "philtrum_depth": (
        Pull((0, -58.5, 98), (3.2, 5, 12), (0, 0, -0.8)),
        Pull((6, -59, 97), (3, 5, 12), (0, 0, 0.5)),
    ),
    "mentolabial_depth": (Pull((0, -93, 91), (15, 6, 16), (0, 0, -1.5)),),
    "nasolabial_fold": (
        Pull((25, -57, 88), (5, 13, 16), (0, 0, -1.2)),
        Pull((35, -52, 82), (8, 13, 16), (0, 0, 0.9)),
    ),
    "larynx_prominence": (Pull((0, -150, 46), (10, 13, 25), (0, 0, 2.5)),),
    "occiput_fullness": (Pull((0, 10, -98), (50, 34, 40), (0, 0, -5.0)),),
    "crown_height": (Pull((0, 112, -5), (60, 45, 70), (0, 5.0, 0)),),
}


def identity_modes(masks: Masks) -> tuple[tuple[str, ...], np.ndarray]:
    """Names and displacements (80, n, 3) float64 in mm per standard deviation."""
    fields: dict[str, Field] = dict(_GLOBAL)
    for name, pulls in PULLS.items():
        fields[name] = partial(_all_pulled, pulls)
    # Each field is evaluated on the vertices and in front of both eyes, whose motion the eyes then
    # follow.
    probes = np.concatenate(
        [masks.points, [eye_center(side) + np.array([0.0, 0.0, 6.0]) for side in SIDES]]
    )
    modes = {name: _eyes_rigid(masks, field(probes)) for name, field in fields.items()}
    modes |= _eye_shapes(masks) | _ears(masks)
    modes |= {name: _eyes_rigid(masks, field(probes)) for name, field in _ASYMMETRIC.items()}
    smooth = gaussian_process.smooth_modes(masks, probes, MODE_COUNT - 1 - len(modes))
    modes |= {name: _eyes_rigid(masks, values) for name, values in smooth.items()}
    for name, values in modes.items():
        _ears_whole(masks, values, 0.0 if name in _EAR_SCALING else 0.8)
        _teeth_whole(masks, values, _TEETH_FOLLOW_LIPS if name in _LIP_HEIGHTS else 1.0)
    modes["teeth_height"] = _teeth_height(masks)
    return tuple(modes), np.stack(list(modes.values()))


def _ears_whole(masks: Masks, values: np.ndarray, share: float) -> None:
    """Move each ear more nearly as a whole, with the skin it grows from: breadths bend heads, not
    ears.
    """
    for side in SIDES:
        loops = masks.mesh.loops[f"ear_{side}"]
        mean = values[loops[0]].mean(axis=0)
        follow = share * np.concatenate([[0.0, 0.15, 0.45, 0.75], np.ones(len(loops) - 4)])
        values[loops[1:]] += follow[1:, None, None] * (mean - values[loops[1:]])


def _teeth_whole(masks: Masks, values: np.ndarray, share: float) -> None:
    """Crowns keep their shape: each row of teeth rises and falls by an affine map, by `share` of
    what surrounds it.
    """
    for index in masks.mesh.teeth.values():
        points = np.concatenate([masks.points[index], np.ones((len(index), 1))], axis=1)
        fitted, *_ = np.linalg.lstsq(points, values[index, 1], rcond=None)
        values[index, 1] = share * (points @ fitted)


def _teeth_height(masks: Masks) -> np.ndarray:
    """(n, 3) both rows of teeth and their gums, higher behind the same lips."""
    values = np.zeros((masks.count, 3))
    for index in masks.mesh.teeth.values():
        values[index, 1] = _TEETH_HEIGHT_SD
    return values


def _eye_shapes(masks: Masks) -> dict[str, np.ndarray]:
    shapes: dict[str, Callable[[str], np.ndarray]] = {
        "eye_fissure_length": lambda side: lids.widen(masks, side, _sd("eye_fissure_length")),
        "eye_fissure_height": lambda side: lids.close_lids(masks, side, -0.09, -0.05),
        "eye_tilt": lambda side: lids.tilt(masks, side, 1.6),
    }
    return {name: shape("left") + shape("right") for name, shape in shapes.items()}


def _all_pulled(pulls: tuple[Pull, ...], points: np.ndarray) -> np.ndarray:
    return np.sum([_pulled(points, pull) for pull in pulls], axis=0)


def _pulled(points: np.ndarray, pull: Pull) -> np.ndarray:
    side = np.sign(points[:, 0])
    local = np.stack([np.abs(points[:, 0]), points[:, 1], points[:, 2]], axis=-1)
    weight = np.exp(-(((local - pull.center) / pull.radii) ** 2).sum(axis=1))
    if pull.center[0] > 0:
        # Two bells, one per side; without the second the weight would have a crease on the midline.
        mirrored = np.stack([-local[:, 0], local[:, 1], local[:, 2]], axis=-1)
        if np.isfinite(pull.radii[0]):
            weight = weight + np.exp(-(((mirrored - pull.center) / pull.radii) ** 2).sum(axis=1))
    outward = side * np.tanh(local[:, 0] / pull.midline)
    return weight[:, None] * _vector(pull.move[0] * outward, pull.move[1], pull.move[2])


def _eyes_rigid(masks: Masks, values: np.ndarray) -> np.ndarray:
    """A field on all vertices (n, 3), with each eyeball and its lids moving as one; the last rows
    are the eyes'.
    """
    result = values[: masks.count]
    for side, move in zip(SIDES, values[masks.count :], strict=True):
        weight = 1.0 - smoothstep(
            (masks.eye_distance(side) - _LOCK_INNER) / (_LOCK_OUTER - _LOCK_INNER)
        )
        weight[masks.mesh.eyeballs[side]] = 1.0
        result = result + weight[:, None] * (move - result)
    return result


def _vector(x: np.ndarray | float, y: np.ndarray | float, z: np.ndarray | float) -> np.ndarray:
    return np.stack(np.broadcast_arrays(x, y, z), axis=-1).astype(np.float64)


def _between(y: np.ndarray, low: float, high: float) -> np.ndarray:
    return smoothstep((y - low) / (high - low))


def _head_size(p: np.ndarray) -> np.ndarray:
    return 0.028 * (p - [0.0, -40.0, 40.0])


def _head_length(p: np.ndarray) -> np.ndarray:
    return _vector(
        0.0,
        0.0,
        -_sd("head_length") * _between(-p[:, 2], -50.0, 90.0) * _between(p[:, 1], -130.0, -20.0),
    )


def _head_breadth(p: np.ndarray) -> np.ndarray:
    return _vector(
        _sd("head_breadth") / 2 * p[:, 0] / 76.0 * _between(p[:, 1], -40.0, 35.0), 0.0, 0.0
    )


def _face_height(p: np.ndarray) -> np.ndarray:
    return _vector(0.0, -_sd("menton_sellion_length") * np.clip(-p[:, 1] / 116.0, -0.15, 1.0), 0.0)


def _nose_length(p: np.ndarray) -> np.ndarray:
    down = _between(-p[:, 1], 0.0, 50.0) * (1 - _between(-p[:, 1], 52.0, 116.0))
    return _vector(
        0.0, -_sd("subnasale_sellion_length") * down * _between(p[:, 2], 10.0, 60.0), 0.0
    )


def _chin_height(p: np.ndarray) -> np.ndarray:
    return _vector(
        0.0, -2.8 * _between(-p[:, 1], 78.0, 112.0) * _between(p[:, 2], -30.0, 50.0), 0.0
    )


def _upper_lip_height(p: np.ndarray) -> np.ndarray:
    down = _between(-p[:, 1], 48.0, 68.0) * (1 - _between(-p[:, 1], 84.0, 116.0))
    return _vector(0.0, -_sd("upper_lip_height") * down * _between(p[:, 2], 40.0, 80.0), 0.0)


def _forehead_height(p: np.ndarray) -> np.ndarray:
    return _vector(0.0, 5.5 * _between(p[:, 1], 15.0, 110.0), 0.0)


def _forehead_slope(p: np.ndarray) -> np.ndarray:
    bell = _between(p[:, 1], 15.0, 75.0) * (1 - 0.8 * _between(p[:, 1], 75.0, 115.0))
    return _vector(0.0, 0.0, -4.5 * bell * _between(p[:, 2], 0.0, 80.0))


def _jaw_projection(p: np.ndarray) -> np.ndarray:
    weight = (
        _between(-p[:, 1], 55.0, 95.0)
        * _between(p[:, 2], 0.0, 75.0)
        * (1 - _between(-p[:, 1], 118.0, 150.0))
    )
    return _vector(0.0, 0.0, 2.8 * weight)


def _face_flatness(p: np.ndarray) -> np.ndarray:
    face = (
        _between(p[:, 2], 20.0, 60.0)
        * _between(p[:, 1], -115.0, -70.0)
        * (1 - _between(p[:, 1], 25.0, 70.0))
    )
    return _vector(0.0, 0.0, 2.4 * face * (np.tanh(np.abs(p[:, 0]) ** 2 / 900.0) - 0.45))


def _face_taper(p: np.ndarray) -> np.ndarray:
    weight = np.clip((p[:, 1] + 55.0) / 60.0, -1.0, 1.0) * _between(p[:, 2], -60.0, 10.0)
    weight = weight * (1 - _between(p[:, 1], 25.0, 70.0)) * (1 - _between(-p[:, 1], 115.0, 140.0))
    return _vector(2.5 * weight * np.tanh(p[:, 0] / 45.0), 0.0, 0.0)


def _neck_girth(p: np.ndarray) -> np.ndarray:
    neck = 1 - _between(p[:, 1] - 0.45 * p[:, 2], -165.0, -75.0)
    radial = np.stack([p[:, 0], np.zeros(len(p)), p[:, 2] + 18.0], axis=-1)
    return 0.075 * neck[:, None] * radial


_GLOBAL = {
    "head_size": _head_size,
    "head_length": _head_length,
    "head_breadth": _head_breadth,
    "face_height": _face_height,
    "nose_length": _nose_length,
    "upper_lip_height": _upper_lip_height,
    "chin_height": _chin_height,
    "forehead_height": _forehead_height,
    "forehead_slope": _forehead_slope,
    "jaw_projection": _jaw_projection,
    "face_flatness": _face_flatness,
    "face_taper": _face_taper,
    "neck_girth": _neck_girth,
}


def _ears(masks: Masks) -> dict[str, np.ndarray]:
    """Ear size and protrusion: scaling and turning the loops of the ears about their attachment."""
    size, protrusion = np.zeros((masks.count, 3)), np.zeros((masks.count, 3))
    for side in SIDES:
        loops = masks.mesh.loops[f"ear_{side}"]
        sign = 1.0 if side == "left" else -1.0
        center = masks.points[loops[1]].mean(axis=0)
        hinge = center + np.array([0.0, 0.0, 14.0])
        follow = np.concatenate([[0.0, 0.25, 0.7], np.ones(len(loops) - 3)])
        for ring, row in enumerate(loops):
            relative = masks.points[row] - center
            size[row] = 0.06 * follow[ring] * relative
            behind = np.clip((hinge - masks.points[row])[:, 2], 0.0, None)
            protrusion[row, 0] = sign * 0.06 * follow[ring] * behind
    return {"ear_size": size, "ear_protrusion": protrusion}


def _bend(
    amount: float,
    axis: int,
    center: tuple[float, float, float],
    radii: tuple[float, float, float],
    odd: bool,
) -> Field:
    def field(p: np.ndarray) -> np.ndarray:
        weight = amount * np.exp(-(((p - center) / radii) ** 2).sum(axis=1))
        if odd:
            weight = weight * np.tanh(p[:, 0] / 20.0)
        result = np.zeros((len(p), 3))
        result[:, axis] = weight
        return result

    return field


_ASYMMETRIC = {
    "asymmetry_jaw_sideways": _bend(2.0, 0, (0, -95, 70), (60, 34, 60), False),
    "asymmetry_nose_sideways": _bend(1.3, 0, (0, -40, 108), (16, 22, 25), False),
    "asymmetry_eye_height": _bend(0.8, 1, (0, 4, 75), (60, 22, 40), True),
    "asymmetry_mouth_corner": _bend(1.1, 1, (0, -73, 90), (38, 14, 30), True),
    "asymmetry_cheek_depth": _bend(1.4, 2, (0, -40, 70), (70, 40, 60), True),
}

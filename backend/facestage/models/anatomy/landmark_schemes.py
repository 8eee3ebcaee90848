"""What is known of each landmark scheme, whatever the face model: which points do what, and how
sharp they are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from types import MappingProxyType

import numpy as np

from facestage.contract.landmarks import SCHEME_SIZES
from facestage.models.anatomy.shipped_landmarks import read_deviations

# The jaw's landmarks are on no feature of the skin; only across the outline are they sharp.
_JAW_DEVIATION = 1.5
# How many times more the borders of lips and lids count than their neighbors' correlation, which is
# that of the whole face, lets them: on pictures of known heads the gap of the lips is off by 1.0 %
# and 1.3 % too wide, that of the lids off by 1.1 %, of the distance of the eyes' outer corners;
# without it they would pass for off by 3.1 % and 4.4 %.
_BORDER_GAIN = 4.0
# Relative height of an eye's opening below which its iris is a guess.
_CLOSED = 0.12
# Around the face from the middle of the hairline, over the subject's left temple and the chin, and
# back.
_OVAL = (
    10, 338, 297, 332, 284, 251, 389, 356, 454, 323, 361, 288, 397, 365, 379, 378, 400, 377, 152,
    148, 176, 149, 150,
    136, 172, 58, 132, 93, 234, 127, 162, 21, 54, 103, 67, 109,
)  # fmt: skip
_JAW = _OVAL[8:29]
_BROWS = (70, 63, 105, 66, 107, 336, 296, 334, 293, 300)
_LIPS = (61, 291, 0, 17)
_OUTER_LIPS = (
    61, 146, 91, 181, 84, 17, 314, 405, 321, 375, 291, 409, 270, 269, 267, 0, 37, 39, 40, 185,
)  # fmt: skip
# Once around between the lips, and between the lids of the subject's right and left eye.
_OPENINGS = (
    (78, 95, 88, 178, 87, 14, 317, 402, 318, 324, 308, 415, 310, 311, 312, 13, 82, 81, 80, 191),
    (33, 7, 163, 144, 145, 153, 154, 155, 133, 173, 157, 158, 159, 160, 161, 246),
    (263, 249, 390, 373, 374, 380, 381, 382, 362, 398, 384, 385, 386, 387, 388, 466),
)
_NOSE = (168, 6, 197, 195, 5, 4, 98, 97, 2, 326, 327)


@dataclass(frozen=True)
class Eye:
    """An iris and the lids that can hide it, as indices of a scheme."""

    iris: tuple[int, ...]
    upper: int
    lower: int
    corners: tuple[int, int]  # of an upright face seen from the front, from left to right
    lids: tuple[tuple[int, int], ...]  # the upper and the lower lid at one place


@dataclass(frozen=True)
class Scheme:
    """Indices into the m points of a scheme, and how far its points are off.

    ``deviation`` (m,) is relative to a sharp point such as the corner of an eye. ``share`` (m,):
    neighbors err together, so each point counts for so much of an independent one.
    """

    deviation: np.ndarray
    share: np.ndarray
    contour: np.ndarray  # (k,) the outline of the face, in order
    # whether the outline is marked where the face ends in the picture, rather than on the skin
    slides: bool
    # what spans the face from chin to brows, without the forehead, in profile too
    outline: np.ndarray
    # Factors on the deviation of the outline's points where the face ends in the picture, across
    # the outline and along.
    across: float
    along: float
    skin: np.ndarray  # their hull is bare skin: cheeks, nose and chin
    brows: np.ndarray
    chin: np.ndarray  # the lowest of the jaw
    lips: np.ndarray  # their outer border, once around
    # the inner border of the lips, then those of the lids, in order: what shows between is no skin
    openings: tuple[np.ndarray, ...]
    eyes: tuple[Eye, ...] = ()
    # (b, 2) points of the outline on either side, from the temples to the chin
    breadths: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), int))

    def behind_closed_lids(self, points: np.ndarray) -> np.ndarray:
        """(m,) bool, the iris points of the eyes that are closed in ``points`` (m, 2) pixels."""
        result = np.zeros(len(points), bool)
        for eye in self.eyes:
            width = np.linalg.norm(points[eye.corners[1]] - points[eye.corners[0]])
            height = np.linalg.norm(points[eye.upper] - points[eye.lower])
            result[list(eye.iris)] = not height > _CLOSED * width
        return result


def _across(eye: tuple[int, ...]) -> tuple[tuple[int, int], ...]:
    """Pairs of the upper and the lower lid, of an opening from its outer corner once around."""
    half = len(eye) // 2
    return tuple(zip(eye[:half:-1], eye[1:half], strict=True))


@cache
def _schemes() -> Mapping[str, Scheme]:
    deviation = np.ones(SCHEME_SIZES["ibug68"])
    deviation[:17] = _JAW_DEVIATION
    ibug68 = Scheme(
        deviation,
        np.ones(len(deviation)),
        contour=np.arange(17),
        slides=True,
        across=1.0,
        along=1.0,
        outline=np.arange(68),
        skin=np.array([*range(2, 15), *range(27, 36)]),
        brows=np.arange(17, 27),
        chin=np.arange(6, 11),
        lips=np.arange(48, 60),
        openings=(np.arange(60, 68), np.arange(36, 42), np.arange(42, 48)),
    )
    deviation, independent = read_deviations()
    share = np.full(len(deviation), independent / len(deviation))
    share[list({*_OUTER_LIPS, *(index for ring in _OPENINGS for index in ring)})] *= _BORDER_GAIN
    mediapipe478 = Scheme(
        deviation,
        share,
        contour=np.array(_OVAL),
        # On pictures of known heads the network follows the skin: it finds a hidden temple behind
        # the nose. Where the skin turns away it finds the outline, but not where along it.
        slides=False,
        across=0.6,
        along=1.7,
        outline=np.array([*_JAW, *_BROWS, *_NOSE, *_LIPS]),
        skin=np.array([*_JAW[1:-1], *_NOSE]),
        brows=np.array(_BROWS),
        chin=np.array(_JAW[7:14]),
        lips=np.array(_OUTER_LIPS),
        openings=tuple(map(np.array, _OPENINGS)),
        eyes=(
            Eye(tuple(range(468, 473)), 159, 145, (33, 133), _across(_OPENINGS[1])),
            Eye(tuple(range(473, 478)), 386, 374, (362, 263), _across(_OPENINGS[2])),
        ),
        breadths=np.stack([_OVAL[5:16], _OVAL[-5:-16:-1]], axis=1),
    )
    return MappingProxyType({"ibug68": ibug68, "mediapipe478": mediapipe478})


def scheme_of(name: str) -> Scheme:
    """The scheme of that name, one of the contract's."""
    return _schemes()[name]

"""Which landmarks of a scheme a person edits, what they are called, and how the others follow. No
bpy.

Left and right are the person's own: the right eye is on the left of the picture.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from facestage.contract.landmarks import IBUG, MEDIAPIPE, SCHEME_SIZES

# The 68 points of the ibug scheme, in its order.
IBUG_NAMES = (
    "right temple",
    *["right jaw"] * 7,
    "chin",
    *["left jaw"] * 7,
    "left temple",
    "right brow outer end",
    *["right brow"] * 3,
    "right brow inner end",
    "left brow inner end",
    *["left brow"] * 3,
    "left brow outer end",
    "nose root",
    "nose bridge",
    "nose bridge",
    "nose tip",
    "right nose wing",
    "right nostril",
    "nose base",
    "left nostril",
    "left nose wing",
    "right eye outer corner",
    "right upper lid",
    "right upper lid",
    "right eye inner corner",
    "right lower lid",
    "right lower lid",
    "left eye inner corner",
    "left upper lid",
    "left upper lid",
    "left eye outer corner",
    "left lower lid",
    "left lower lid",
    "right mouth corner",
    *["upper lip"] * 5,
    "left mouth corner",
    *["lower lip"] * 5,
    "right inner mouth corner",
    *["upper lip inside"] * 3,
    "left inner mouth corner",
    *["lower lip inside"] * 3,
)

# Lines through the ibug points, as a face is drawn with them: first and last point, and whether
# they close.
IBUG_LINES = (
    (0, 16, False),
    (17, 21, False),
    (22, 26, False),
    (27, 30, False),
    (31, 35, False),
    (36, 41, True),
    (42, 47, True),
    (48, 59, True),
    (60, 67, True),
)

# Points of MediaPipe's 478 that lie where the ibug points do, in the order of the ibug scheme.
MEDIAPIPE_AS_IBUG = (
    127, 234, 93, 132, 58, 136, 150, 176, 152, 400, 379, 365, 288, 361, 323, 454, 356,
    70, 63, 105, 66, 107, 336, 296, 334, 293, 300,
    168, 197, 5, 4, 75, 97, 2, 326, 305,
    33, 160, 158, 133, 153, 144, 362, 385, 387, 263, 373, 380,
    61, 39, 37, 0, 267, 269, 291, 405, 314, 17, 84, 181,
    78, 82, 13, 312, 308, 317, 14, 87,
)  # fmt: skip
MEDIAPIPE_EXTRA = {
    10: "hairline",
    67: "right forehead",
    297: "left forehead",
    468: "right pupil",
    473: "left pupil",
}

# Softens the spline where two handles nearly coincide, as the lids of a closed eye do.
STIFFNESS = 1e-4


@dataclass(frozen=True)
class Handle:
    """A landmark that can be dragged: its place in the scheme's list, and the name it is shown
    by.
    """

    index: int
    name: str


def handles(scheme: str, count: int) -> tuple[Handle, ...]:
    """The landmarks of ``scheme`` (``count`` points) that a person edits; of an unknown scheme all
    of them.

    Names carry the number that the scheme's own figure shows: ibug counts from 1, MediaPipe from 0.
    """
    if scheme == IBUG and count == SCHEME_SIZES[IBUG]:
        return tuple(
            Handle(index, f"Landmark {index + 1} {name}") for index, name in enumerate(IBUG_NAMES)
        )
    if scheme == MEDIAPIPE and count == SCHEME_SIZES[MEDIAPIPE]:
        named = [*zip(MEDIAPIPE_AS_IBUG, IBUG_NAMES, strict=True), *MEDIAPIPE_EXTRA.items()]
        return tuple(Handle(index, f"Landmark {index} {name}") for index, name in named)
    return tuple(Handle(index, f"Landmark {index + 1}") for index in range(count))


def lines(scheme: str) -> tuple[tuple[int, ...], ...]:
    """Chains of point indices that draw the face; none for an unknown scheme."""
    if scheme not in (IBUG, MEDIAPIPE):
        return ()
    place = tuple(range(len(IBUG_NAMES))) if scheme == IBUG else MEDIAPIPE_AS_IBUG
    return tuple(
        tuple(place[index] for index in [*range(first, last + 1), *([first] if closed else [])])
        for first, last, closed in IBUG_LINES
    )


def follow(points: np.ndarray, indices: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """All points (m, 2) after those at ``indices`` (k,) were dragged to ``moved`` (k, 2), in
    pixels.

    The dragged ones are where they were dragged; the others follow by the thin-plate spline of the
    drags (Bookstein 1989), which bends the least. Points without a position (NaN) neither pull nor
    follow.
    """
    result = np.array(points, np.float64)
    result[indices] = moved
    held = np.isfinite(points[indices]).all(axis=1) & np.isfinite(moved).all(axis=1)
    sources, drag = points[indices][held], (moved - points[indices])[held]
    others = np.setdiff1d(np.flatnonzero(np.isfinite(points).all(axis=1)), indices)
    if len(sources) and len(others) and drag.any():
        result[others] += _thin_plate(sources, drag, points[others])
    return result


def nearest_handle(points: np.ndarray, indices: np.ndarray) -> np.ndarray:
    """(m,) for every point the entry of ``indices`` (k,) that lies nearest to it; points without a
    position: the first.

    What is marked hidden at a handle is hidden around it.
    """
    known = np.flatnonzero(np.isfinite(points[indices]).all(axis=1))
    if not len(known):
        return np.zeros(len(points), int)
    distance = np.linalg.norm(points[:, None] - points[indices][None, known], axis=2)
    return known[np.argmin(np.where(np.isfinite(distance), distance, np.inf), axis=1)]


def _thin_plate(sources: np.ndarray, values: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Values (m, 2) at ``points`` (m, 2) of the spline that takes ``values`` (k, 2) at ``sources``
    (k, 2).
    """
    centre = sources.mean(axis=0)
    size = max(float(np.abs(sources - centre).max()), 1e-9)
    knots, wanted = (sources - centre) / size, (points - centre) / size
    k = len(knots)
    system = np.zeros((k + 3, k + 3))
    system[:k, :k] = _kernel(knots, knots) + STIFFNESS * np.eye(k)
    system[:k, k:] = np.c_[np.ones(k), knots]
    system[k:, :k] = system[:k, k:].T
    right = np.zeros((k + 3, 2))
    right[:k] = values
    # Least squares: two or three points, or points on a line, do not determine the affine part.
    weights = np.linalg.lstsq(system, right, rcond=1e-10)[0]
    return _kernel(wanted, knots) @ weights[:k] + np.c_[np.ones(len(wanted)), wanted] @ weights[k:]


def _kernel(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """r^2 log r of all distances between ``a`` (m, 2) and ``b`` (k, 2)."""
    square = ((a[:, None] - b[None]) ** 2).sum(axis=2)
    return 0.5 * square * np.log(np.maximum(square, 1e-30))

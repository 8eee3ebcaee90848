"""Where the openings of the eyes and the line of the lips are on a face mesh, seen from the front.

Surfaces alone say little about them: a face slides over another one by millimetres without leaving
it. The corners of the eyes and of the mouth stop that.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from facestage.models.mesh.surface import vertex_normals

PIXEL = 0.6e-3  # metres
_LEFT, _BOTTOM, _WIDTH, _HEIGHT = -0.075, -0.095, 250, 280
_DEEP = 3e-3  # metres behind a closed eye: an opening
# In the ibug68 scheme: corners, upper and lower lid.
_EYES = (((36, 39), (37, 38), (40, 41)), ((42, 45), (43, 44), (46, 47)))
_MOUTH = (48, 54)
_CARUNCLE = 2.5e-3  # metres by which the pink corner of the eye fills the opening's inner end
_MOUTH_WIDTH = (0.025, 0.075)
_EYE_AREA, _EYE_WIDTH = (50e-6, 900e-6), (0.012, 0.045)
# change of the normals' height across a crease, and half the distance over which, pixels
_CREASE, _STEP = 0.8, 2


class FrontView:
    """The foremost surface of a mesh (vertices (n, 3) metres in the model frame, triangles (t, 3))
    on a grid.
    """

    def __init__(self, vertices: np.ndarray, triangles: np.ndarray) -> None:
        normals = vertex_normals(vertices, triangles)
        low = np.array([_LEFT, _BOTTOM])
        high = low + PIXEL * np.array([_WIDTH, _HEIGHT])
        corners = vertices[triangles]
        seen = (corners[..., :2] > low).all(axis=2).any(axis=1) & (corners[..., :2] < high).all(
            axis=2
        ).any(axis=1)
        seen &= corners[..., 2].max(axis=1) > -0.08
        corners, normal_y = corners[seen], normals[triangles[seen]][..., 1]
        side = np.sqrt(((corners - np.roll(corners, 1, axis=1)) ** 2).sum(axis=2).max(axis=1))
        count = np.clip(np.ceil(side / (0.7 * PIXEL)), 1, 60).astype(int)
        self.depth = np.full(_WIDTH * _HEIGHT, -np.inf)
        self.normal_y = np.zeros(_WIDTH * _HEIGHT)
        for step in np.unique(count):
            chosen = count == step
            weights = _grid(int(step))
            x, y = (_spread(weights, corners[chosen][..., axis]) for axis in (0, 1))
            column = np.floor((x - _LEFT) / PIXEL).astype(int)
            row = np.floor((y - _BOTTOM) / PIXEL).astype(int)
            inside = (column >= 0) & (row >= 0) & (column < _WIDTH) & (row < _HEIGHT)
            index = column[inside] + _WIDTH * row[inside]
            z = _spread(weights, corners[chosen][..., 2])[inside]
            slope = _spread(weights, normal_y[chosen])[inside]
            before = self.depth[index]
            np.maximum.at(self.depth, index, z)
            front = (z > before) & (z == self.depth[index])
            self.normal_y[index[front]] = slope[front]
        self.depth = self.depth.reshape(_HEIGHT, _WIDTH)
        self.normal_y = self.normal_y.reshape(_HEIGHT, _WIDTH)

    def lifted(self, place: np.ndarray) -> np.ndarray:
        """(3,) the surface's foremost point within a millimetre or so of a place (2,) seen from the
        front.
        """
        x, y = np.floor((place - [_LEFT, _BOTTOM]) / PIXEL).astype(int)
        near = self.depth[max(y - 2, 0) : y + 3, max(x - 2, 0) : x + 3]
        return np.array([*place, near.max(initial=-np.inf)])


def face_features(
    mesh: FrontView, whole: FrontView, landmarks: np.ndarray
) -> dict[int, np.ndarray]:
    """Landmarks of a mesh that its openings show: those of the eyes, and the corners of the mouth.

    mesh: the skin of the mesh; whole: the default face with its eyeballs, roughly fitted to it;
    landmarks (68, 3) of the latter, metres, all in the model frame. Returns index in the ibug68
    scheme -> (3,), only for what was found.
    """
    found: dict[int, np.ndarray] = {}
    for corners, upper, lower in _EYES:
        middle = landmarks[list(corners), :2].mean(axis=0)
        opening = _eye_opening(mesh, whole, middle)
        if opening is None:
            continue
        ends, edges = opening
        inner = int(np.abs(ends[:, 0]).argmin())
        ends[inner, 0] -= np.sign(ends[inner, 0]) * _CARUNCLE
        ours = landmarks[list(corners), 0]
        for index in corners:
            found[index] = ends[int(landmarks[index, 0] > middle[0])]
        for points, row in ((upper, 1), (lower, 0)):
            for index in points:
                share = (landmarks[index, 0] - ours.min()) / np.ptp(ours)
                x = (1 - share) * ends[0, 0] + share * ends[1, 0]
                column = np.abs(edges[2] - x).argmin()
                found[index] = np.array([x, edges[row, column]])
    ends_of_lips = _lip_line(mesh, landmarks[list(_MOUTH), :2].mean(axis=0))
    if ends_of_lips is not None:
        found |= dict(zip(_MOUTH, ends_of_lips, strict=True))
    return {index: mesh.lifted(place) for index, place in found.items()}


def _eye_opening(
    view: FrontView, whole: FrontView, middle: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """The two ends (2, 2) of an eye's opening, lower x first, and its lower edge, upper edge and x
    (3, columns).
    """
    rows, columns = _window(middle, 0.030, 0.018)
    opening = view.depth[rows, columns] < whole.depth[rows, columns] - _DEEP
    opening = ndimage.binary_opening(opening, iterations=1)
    labels, count = ndimage.label(opening)
    if not count:
        return None
    chosen = labels == int(np.bincount(labels.ravel())[1:].argmax()) + 1
    y, x = np.nonzero(chosen)
    touches = (
        y.min() == 0
        or x.min() == 0
        or y.max() == chosen.shape[0] - 1
        or x.max() == chosen.shape[1] - 1
    )
    area, width = len(x) * PIXEL**2, np.ptp(x) * PIXEL
    if touches or not (
        _EYE_AREA[0] < area < _EYE_AREA[1] and _EYE_WIDTH[0] < width < _EYE_WIDTH[1]
    ):
        return None
    span = np.arange(x.min(), x.max() + 1)
    low = chosen[:, span].argmax(axis=0)
    high = chosen.shape[0] - 1 - chosen[::-1, span].argmax(axis=0)
    ends = np.array([[span[k], 0.5 * (low[k] + high[k])] for k in (0, -1)])
    lower, upper = (
        _places(np.stack([span, edge], axis=1).astype(float), rows, columns) for edge in (low, high)
    )
    return _places(ends, rows, columns), np.stack([lower[:, 1], upper[:, 1], lower[:, 0]])


def _lip_line(view: FrontView, middle: np.ndarray) -> np.ndarray | None:
    """(2, 2) the ends of the crease between closed lips, lower x first; None without one."""
    rows, columns = _window(middle, 0.042, 0.014)
    slope = ndimage.gaussian_filter(view.normal_y[rows, columns], 0.7)
    # the lower lip's edge looks up, the upper one's down
    crease = slope[: -2 * _STEP] - slope[2 * _STEP :]
    best = crease.argmax(axis=0)
    found = ndimage.binary_closing(crease.max(axis=0) > _CREASE, iterations=3)
    labels, _ = ndimage.label(found)
    label = labels[len(found) // 2]
    x = np.flatnonzero(labels == label) if label else np.zeros(0, int)
    if not len(x) or not _MOUTH_WIDTH[0] < np.ptp(x) * PIXEL < _MOUTH_WIDTH[1]:
        return None
    ends = np.array([[x[k], best[x[k]] + _STEP] for k in (0, -1)], float)
    return _places(ends, rows, columns)


def _window(middle: np.ndarray, half_width: float, half_height: float) -> tuple[slice, slice]:
    """Rows and columns of the grid around a point."""
    x, y = np.floor((middle - [_LEFT, _BOTTOM]) / PIXEL).astype(int)
    wide, high = int(half_width / PIXEL), int(half_height / PIXEL)
    rows = slice(max(y - high, 0), min(y + high + 1, _HEIGHT))
    return rows, slice(max(x - wide, 0), min(x + wide + 1, _WIDTH))


def _places(cells: np.ndarray, rows: slice, columns: slice) -> np.ndarray:
    return (cells + np.array([columns.start + 0.5, rows.start + 0.5])) * PIXEL + np.array(
        [_LEFT, _BOTTOM]
    )


def _spread(weights: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(t s,) values at the barycentric ``weights`` (s, 3) of triangles with ``corners`` (t, 3)."""
    first, second, third = (np.multiply.outer(corners[:, k], weights[:, k]) for k in range(3))
    first += second
    first += third
    return first.ravel()


def _grid(step: int) -> np.ndarray:
    """Barycentric points of a triangle, ``step`` intervals on each side, corners included."""
    i, j = np.meshgrid(np.arange(step + 1), np.arange(step + 1))
    kept = (i + j) <= step
    beta, gamma = i[kept] / step, j[kept] / step
    return np.stack([1 - beta - gamma, beta, gamma], axis=1)

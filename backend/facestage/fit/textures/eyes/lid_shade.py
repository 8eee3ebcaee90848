"""The shade of the upper lid and its lashes on the eye.

Neither lashes nor the light that they keep away are in the fitted mesh: without this shade an eye
is evenly white up to the lid. It is drawn into the eyes' own picture, where it turns with the gaze;
the upper lid follows the gaze up and down, and its border is nearly level, so that it stays below.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from facestage.contract.arrays import Float
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.state import State
from facestage.models.anatomy.landmark_schemes import scheme_of
from facestage.models.anatomy.regions import IRIS_RADIUS
from facestage.models.mesh.similarity import procrustes

SCHEME = "mediapipe478"
REGIONS = ("eye_left", "eye_right")
# In radii of the iris: over which the shade fades away below the lid, on five photographs.
FADES = 0.25
# Of the logarithm at the lid's border: what is usual, how much that varies, and the deepest.
USUAL, VARIES, DEEPEST = 1.2, 0.6, 2.5
# Of one pixel's logarithm; and how many neighbors say the same.
PIXEL_SIGMA, NEIGHBORS = 0.5, 4.0


def faded(below: Float[np.ndarray, " ..."]) -> Float[np.ndarray, " ..."]:
    """0..1 of the shade's depth, so far ``below`` the lid's border in radii of the iris."""
    return np.asarray(np.exp(-np.maximum(below, 0.0) / FADES))


def shade_depth(darker: Float[np.ndarray, " pixels"], below: Float[np.ndarray, " pixels"]) -> float:
    """How deep the shade is at the lid's border, of the logarithm.

    ``darker``: by how much log radiance of the white lies below that of the lit white.
    """
    shape = faded(below)
    noise = NEIGHBORS * PIXEL_SIGMA**2
    depth = USUAL / VARIES**2 + (shape * np.clip(darker, -1.0, 4.0)).sum() / noise
    depth /= 1 / VARIES**2 + np.square(shape).sum() / noise
    return float(np.clip(depth, 0.0, DEEPEST))


@dataclass(frozen=True)
class LidShade:
    """The shade on a fitted face's eyes."""

    depth: float  # of the logarithm
    # Of each of REGIONS the border of the upper lid over the eyeball, seen along the axis that the
    # eye has at rest: metres to the left and up from the axis, from right to left.
    borders: tuple[Float[np.ndarray, "points 2"], Float[np.ndarray, "points 2"]]

    @classmethod
    def of(cls, geometry: FaceGeometry, state: State, depth: float) -> LidShade | None:
        """None for models that do not know where lids or eyeballs are."""
        model = geometry.model
        if SCHEME not in model.landmarks or any(name not in model.regions for name in REGIONS):
            return None
        vertices, weights = model.landmark_vertices(SCHEME)
        now = geometry.at(state)
        borders = []
        # Of the photo's eyes, the first is the subject's right one.
        for name, eye in zip(REGIONS, scheme_of(SCHEME).eyes[::-1], strict=True):
            ball = geometry.new_index[model.regions[name]]
            ball = ball[ball >= 0]
            upper = np.array([pair[0] for pair in eye.lids])
            lid = np.einsum("mi,mix->mx", weights[upper], now[geometry.new_index[vertices[upper]]])
            rest = geometry.mean[ball]
            axis = 0.5 * (rest.min(axis=0) + rest.max(axis=0))
            border = (procrustes(now[ball], rest).apply(lid) - axis)[:, :2]
            borders.append(border[np.argsort(border[:, 0])])
        return cls(depth, (borders[0], borders[1]))

    def log_change(
        self, across: Float[np.ndarray, "texels 2"], side: int
    ) -> Float[np.ndarray, " texels"]:
        """Of the log albedo, at points of an eyeball; see :func:`eye_albedo`."""
        border = self.borders[side]
        height = np.interp(across[:, 0], *border.T)
        return -self.depth * faded((height - across[:, 1]) / IRIS_RADIUS)

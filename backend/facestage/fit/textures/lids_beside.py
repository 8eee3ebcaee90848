"""How far the photo's lids lie beside the fitted ones, so that their skin is read where it shows.

The border of a lid is a line of lashes beside a gap: read a pixel off, skin of the lid is painted
with the white of the eye, or with the other side of the line. Landmarks of the lids are among the
surest of all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from facestage.contract.arrays import Float
from facestage.contract.landmarks import Landmarks
from facestage.models.anatomy.landmark_schemes import scheme_of

# In shares of the face: how far around the border of a lid pixels are shifted, over what distance
# shifts of landmarks are averaged, what of a shift is a landmark's own error, and the most
# that any pixel is shifted.
REACH, SMOOTH, NOISE, FARTHEST = 0.05, 0.012, 0.003, 0.025
LASHES = 0.012  # of the face: how far lashes darken the skin around the upper lid's border
# Depth of the line of the lashes in the photo from which on its lids may, and surely do, have one:
# shadows of bare lids are as deep as the first.
LINE = 0.4, 0.7
BETWEEN, NEAREST = 4, 12  # points drawn per side of a ring, and that are averaged


@dataclass(frozen=True)
class LidsBeside:
    """The lids of a photo beside the fitted ones, at pixels of the fitted face."""

    shift: Float[np.ndarray, "pixels 2"]  # by how much the photo shows the same beside the pixel
    lashes: Float[np.ndarray, " pixels"]  # 0..1, how much lashes may darken the skin


def lids_beside(
    pixels: Float[np.ndarray, "pixels 2"],
    landmarks: Landmarks,
    fitted: Float[np.ndarray, "landmarks 2"],
    face_px: float,
    lash_depth: float,
) -> LidsBeside:
    """Where ``landmarks`` of the lids see what lies at ``pixels`` of the fitted face.

    ``fitted``: where the ``landmarks`` lie on the fitted face; a face is ``face_px`` large.
    ``lash_depth``: of the photo, see lash_depth.py; lids that show no line need no place for it,
    which is as sure by the fit as by landmarks.
    """
    shift, lashes = np.zeros((len(pixels), 2)), np.zeros(len(pixels))
    scheme = scheme_of(landmarks.scheme)
    share = np.interp(lash_depth, LINE, (0.0, 1.0))
    # The first opening is the mouth's; a scheme without irises has lids that say little.
    for ring in scheme.openings[1:] if scheme.eyes and share > 0 else ():
        if not landmarks.counted[ring].all():
            continue
        border = _between(fitted[ring]) / face_px
        beside = _between(landmarks.points[ring] - fitted[ring]) / face_px
        length = np.maximum(np.linalg.norm(beside, axis=1, keepdims=True), 1e-9)
        beside *= np.clip(1.0 - (NOISE / length) ** 2, 0.0, 1.0)
        beside *= np.minimum(1.0, FARTHEST / length)
        place = pixels / face_px
        inside = (place > border.min(axis=0) - REACH) & (place < border.max(axis=0) + REACH)
        near = np.flatnonzero(inside.all(axis=1))
        apart, nearest = cKDTree(border).query(place[near], k=NEAREST)
        weight = np.exp(-0.5 * ((apart - apart[:, :1]) / SMOOTH) ** 2)
        mean = np.einsum("pk,pkx->px", weight, beside[nearest]) / weight.sum(axis=1, keepdims=True)
        shift[near] += face_px * mean * np.clip(1.0 - (apart[:, :1] / REACH) ** 2, 0.0, None) ** 2
        # Rings begin at the outer corner and come back to it along the upper lid.
        upper = nearest[:, 0] > len(border) // 2
        lashes[near] = np.maximum(lashes[near], upper & (apart[:, 0] < LASHES))
    return LidsBeside(share * shift, share * lashes)


def _between(ring: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "more 2"]:
    after = np.roll(ring, -1, axis=0)
    share = np.arange(BETWEEN)[:, None] / BETWEEN
    return (ring[:, None] * (1 - share) + after[:, None] * share).reshape(-1, 2)

"""Stubble in place of an even shade where a face model paints hair on its scalp: of a shaved head,
made up, and no gloss where it stands.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import map_coordinates

from facestage.contract.arrays import Float, Float32
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.textures.atlas import Atlas

SPACING = 0.0007  # metres from a follicle to the next, about; no finer than texels
PERIOD = 64  # of them, after which their pattern begins again
CONTRAST = 0.8  # by how much of it how much of the skin hair covers varies from place to place
DENSE_CONTRAST = 0.7  # by how much of it what hair leaves varies, at most: dense hair has no gaps
MATTE = 0.6  # the share of gloss that dense stubble takes away


def grow_stubble(
    log_albedo: Float[np.ndarray, "size size 3"],
    atlas: Atlas,
    geometry: FaceGeometry,
    shade: Float[np.ndarray, "vertices 3"],
) -> None:
    """Let ``log_albedo`` vary about what it is where it has a ``shade`` of hair, 0 or less, the
    logarithm of what hair leaves of the skin's albedo. What it is on average stays.
    """
    hairy = np.flatnonzero(shade.min(axis=1) < 0)
    if not len(hairy):
        return
    points = geometry.mean
    for rows, there in atlas.baked(np.hstack([shade, points])):
        covered = np.flatnonzero(there[:, :3].min(axis=1) < -1e-3)
        if not len(covered):
            continue
        row, column = np.nonzero(atlas.covered[rows])
        row, column = row[covered] + rows.start, column[covered]
        left = np.exp(there[covered, :3])
        most = np.minimum(CONTRAST * (1 - left) / left, DENSE_CONTRAST)
        log_albedo[row, column] += np.log1p(most * noise_at(there[covered, 3:] / SPACING)[:, None])


def matted(shade: Float[np.ndarray, "vertices 3"]) -> Float[np.ndarray, " vertices"]:
    """The share of gloss that a ``shade`` of hair takes away."""
    covers = 1 - np.exp(shade.mean(axis=1))
    return np.asarray(MATTE * covers / max(float(covers.max()), 1e-9))


def noise_at(places: Float[np.ndarray, "places 3"]) -> Float32[np.ndarray, " places"]:
    """-1..1: random values of a lattice of unit width that repeats itself, interpolated."""
    values = np.random.default_rng(0).uniform(-1, 1, (PERIOD,) * 3).astype(np.float32)
    at = np.ascontiguousarray(places.T, np.float32)
    found = map_coordinates(values, at, np.float32, order=1, mode="grid-wrap")
    return np.asarray(found)

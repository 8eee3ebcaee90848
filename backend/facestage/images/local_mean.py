"""Weighted means of what is around each pixel of a picture."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter

from facestage.contract.arrays import Float, Float32
from facestage.images.image_io import resize

# Cells of pixels that are taken together: the deviation is at least so many of them.
CELLS = 4.0
TRUNCATE = 2.5  # deviations


def local_mean(
    values: Float[np.ndarray, "rows columns channels"],
    weight: Float[np.ndarray, "rows columns"],
    sigma: float,
) -> Float32[np.ndarray, "rows columns channels"]:
    """Means by a Gaussian of ``sigma`` pixels times the ``weight``, 0 where there is none of it:
    normalized convolution (Knutsson and Westin 1993).

    A wide Gaussian is one over cells of pixels, between which it is interpolated.
    """
    rows, columns, channels = values.shape
    cell = max(int(sigma / CELLS), 1)
    # A cell more on each side, so that all pixels lie between centers of cells.
    size = tuple((-(-side // cell) + 2) * cell for side in (rows, columns))
    inside = slice(cell, cell + rows), slice(cell, cell + columns)
    sums = np.zeros((*size, channels + 1), np.float32)
    sums[..., :-1][inside] = weight[..., None] * values
    sums[..., -1][inside] = weight
    if cell > 1:
        sums = resize(sums, size[1] // cell, size[0] // cell)
        # Cells and what is interpolated between them have deviations of their own.
        sigma = np.sqrt(sigma**2 - cell**2 / 4) / cell
    sums = gaussian_filter(sums, (sigma, sigma, 0), mode="constant", truncate=TRUNCATE)
    if cell > 1:
        sums = resize(sums, size[1], size[0])
    sums = sums[inside]
    return np.asarray(sums[..., :-1] / np.maximum(sums[..., -1:], 1e-6))

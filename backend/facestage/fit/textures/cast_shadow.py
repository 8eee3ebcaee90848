"""How dark the shadow is that something beside the face throws on bare skin, or that its own
sockets throw and the fit lacks: the smooth part of it is light and no pigment.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter

from facestage.contract.arrays import Bool, Float, Float32
from facestage.fit.textures.creases import bottom_hat
from facestage.images.image_io import resize

# As shares of the face: what is narrower than a brow is skin's own; over what is seen together.
BROW, GRAIN, SMOOTH = 0.1, 0.01, 0.03
# Log radiance below that of the rest of the face from which on more and more is shadow, and beyond
# which what is seen is no skin in a shadow.
DARKER, DARKEST = 0.1, 2.0
FACE_PX = 128.0  # of a larger face pixels are put together: nothing finer is left


def shadow_depth(
    pixels: Float[np.ndarray, "pixels 2"],
    residual: Float[np.ndarray, " pixels"],
    weight: Float[np.ndarray, " pixels"],
    shadowed: Bool[np.ndarray, "height width"],
    face_px: float,
    edge_px: float,
) -> tuple[Float32[np.ndarray, "height width"], Float[np.ndarray, " pixels"]]:
    """0 or more, by how much log radiance has to be lifted there to be out of the shadow, with soft
    edges over ``edge_px``; and of each of the pixels, which is not lifted where it is as light as
    the rest of the face, or shines.

    ``residual``: log of the photo over what is rendered at ``pixels``; ``weight``: 0..1 how well
    they show skin. A closing (Serra 1982) over the width of a BROW leaves what lies on both sides
    of it: below the brim of a cap nothing says that the darkest is a brow.
    """
    height, width = shadowed.shape
    column, row = pixels.astype(int).T
    rest = weight * ~shadowed[row, column]
    if not (shadowed.any() and rest.any()):
        return np.zeros((height, width), np.float32), np.zeros(len(pixels))
    darker = np.average(residual, weights=rest) - residual
    cell = max(1.0, face_px / FACE_PX)
    rows, columns = int(np.ceil(height / cell)), int(np.ceil(width / cell))
    where = (row / cell).astype(int) * columns + (column / cell).astype(int)

    def summed(values: np.ndarray) -> np.ndarray:
        return np.bincount(where, values, rows * columns).reshape(rows, columns)

    def mean(values: np.ndarray, weights: np.ndarray, share: float) -> np.ndarray:
        over = share * face_px / cell
        known = gaussian_filter(weights, over, truncate=6.0)
        seen = gaussian_filter(weights * values, over, truncate=6.0)
        return np.asarray(seen / np.maximum(known, float(np.finfo(float).tiny)))

    seen = summed(weight)
    values = summed(weight * np.clip(darker, -DARKEST, DARKEST))
    level = mean(values / np.maximum(seen, 1e-9), seen, GRAIN)
    depth = level - bottom_hat(-level, seen > 0, max(3, round(BROW * face_px / cell)))
    inside = resize(shadowed.astype(np.float32), columns, rows) > 0
    depth = np.maximum(mean(depth, 1.0 * ((seen > 0) & inside), SMOOTH), 0.0)
    depth -= DARKER * np.tanh(depth / DARKER)
    soft = gaussian_filter(shadowed.astype(np.float32), edge_px)
    lifted = soft * resize(depth, width, height)
    return lifted, np.clip(darker + DARKER, 0.0, lifted[row, column])

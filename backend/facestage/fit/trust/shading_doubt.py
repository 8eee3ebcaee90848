"""How much of a pixel's shading is in doubt: what the albedo detail must not take for paint.

Where the shape is uncertain (beside the nose, at the lids and lips) or the surface shines, a
residual is more likely wrong shading than pigment.
"""

from __future__ import annotations

import numpy as np

from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.energy.noise import HIGHLIGHT_SHARE
from facestage.fit.energy.photo_jacobian import Jacobian
from facestage.fit.face.layout import Layout
from facestage.fit.face.unknowns import SHAPE
from facestage.fit.forward.shading import ForwardModel

# With an unknown lens, distance and focal length are uncertain together and cancel in the picture.
# Beyond this there is nothing left to tell.
DOUBT_MAX = 2.0


def shading_doubt(
    forward: ForwardModel, evaluation: Evaluation, layout: Layout, covariance: np.ndarray
) -> np.ndarray:
    """(h, w) standard deviation of each pixel's radiance, relative to its diffuse part; DOUBT_MAX
    where no skin is.

    ``covariance`` (size, size) of the parameters, zero where held: the shape's part of it is
    carried through the photometric Jacobian. Of a highlight the share that the noise model doubts
    is added.
    """
    image = evaluation.image
    free = layout.mask(SHAPE) & (np.diag(covariance) > 0) & np.isfinite(np.diag(covariance))
    if not len(image.terms.diffuse_by_depth):
        free[:] = False  # the last phase moved no shape and asked for no derivative by it
    jacobian = Jacobian(forward, evaluation.state, image, layout, free)
    columns = jacobian.dense_columns
    shape = covariance[np.ix_(columns, columns)].astype(np.float32)
    variance = np.zeros(len(image.color))
    for block in jacobian.blocks():
        variance[block.pixels] = np.einsum("cbi,cbi->b", block.dense @ shape, block.dense) / len(
            block.dense
        )
    diffuse = image.skin.matte(image.diffuse).mean(axis=1)
    gloss = image.skin.gloss(image.specular).mean(axis=1)
    doubt = np.sqrt(np.maximum(variance, 0.0) + (HIGHLIGHT_SHARE * gloss) ** 2) / np.maximum(
        diffuse, 1e-9
    )
    result = np.full(evaluation.base_weight.shape, DOUBT_MAX)
    x, y = image.surface.pixels.astype(int).T
    result[y, x] = np.minimum(doubt, DOUBT_MAX)
    return result

"""What the photo adds to what the landmarks tell of the shape: how much surer it is with both.

The landmark phases end with a covariance of the shape, the whole fit with another. Where the second
is hardly smaller, the fit's shape rests on the landmarks and the face statistics, whatever the
photo's shading did to it: it cannot be better than they are but by chance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from facestage.contract.arrays import Float, Integer
from facestage.contract.face_model import FaceModel
from facestage.fit.trust.vertex_certainty import shape_columns

# Deviations are right to about a fifth on photographs (docs/certainty.md): a shape that is surer by
# less than that may as well be no surer.
NARROWED_MIN = 0.2
# Heads outside the face model whose shape the photo narrowed down by less than this gained a fifth
# of their error at most, or lost as much: skin that no albedo mode has passes for shading, and the
# less of that there is, the further it goes.
NARROWED_SURELY = 0.6


@dataclass(frozen=True)
class Support:
    """Root mean square distance in mm of the narrow face's vertices from the truth, expected after
    similarity alignment: by landmarks alone, and with the photo.
    """

    landmarks_mm: float
    photo_mm: float

    @property
    def little(self) -> bool:
        """Whether the photo has hardly narrowed down the shape."""
        return self.photo_mm > (1.0 - NARROWED_MIN) * self.landmarks_mm

    @property
    def weak(self) -> bool:
        """Whether what the photo says of the shape may be nothing but its misfit."""
        return self.photo_mm > (1.0 - NARROWED_SURELY) * self.landmarks_mm


def expected_distance(
    model: FaceModel,
    vertices: Float[np.ndarray, "vertices 3"],
    region: Integer[np.ndarray, " region"],
    covariance: Float[np.ndarray, "modes modes"],
) -> float:
    """Root mean square distance in mm over the ``region``, similarity-aligned, of a shape whose
    coefficients have this ``covariance``.

    ``vertices`` of the shape in the model's frame, in metres. A coefficient that nothing holds
    (infinite) counts as moving nothing, see :func:`vertex_deviation`.
    """
    columns = shape_columns(model, vertices, region).reshape(3 * len(region), -1)
    finite = np.where(np.isfinite(covariance), covariance, 0.0)
    square = float(np.einsum("ij,ij->", columns.T @ columns, finite)) / len(region)
    return 1e3 * float(np.sqrt(max(square, 0.0)))

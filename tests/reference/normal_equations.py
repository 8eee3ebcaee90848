"""What a prior adds to normal equations that are 0 before."""

from __future__ import annotations

import numpy as np

from facestage.contract.arrays import Float
from facestage.fit.face.gaussians import Gaussian, Relative
from facestage.fit.face.light_color import LightPrior


def normal_equations(
    prior: Gaussian | Relative | LightPrior, values: Float[np.ndarray, " values"]
) -> tuple[Float[np.ndarray, "values values"], Float[np.ndarray, " values"]]:
    """Hessian and gradient of its energy at ``values``."""
    hessian, gradient = np.zeros((len(values), len(values))), np.zeros(len(values))
    prior.add_to(hessian, gradient, values)
    return hessian, gradient

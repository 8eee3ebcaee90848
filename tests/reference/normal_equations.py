"""What a prior adds to normal equations that are 0 before."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from facestage.contract.arrays import Float


class Prior(Protocol):
    """Of an unknown's values."""

    def add_to(self, hessian: np.ndarray, gradient: np.ndarray, values: np.ndarray) -> None:
        """Add its part."""


def normal_equations(
    prior: Prior, values: Float[np.ndarray, " values"]
) -> tuple[Float[np.ndarray, "values values"], Float[np.ndarray, " values"]]:
    """Hessian and gradient of its energy at ``values``."""
    hessian, gradient = np.zeros((len(values), len(values))), np.zeros(len(values))
    prior.add_to(hessian, gradient, values)
    return hessian, gradient

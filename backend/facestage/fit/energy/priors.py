"""What is known before the photo: statistics of faces, of skin and of light (E_prior and
E_light).
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from facestage.contract.job import Weights
from facestage.fit.face.gaussians import Gaussian
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import UNKNOWNS, Known


@dataclass(frozen=True)
class Quadratic:
    """A quadratic energy 0.5 x^T H x + g^T x around the current state, and its value now."""

    hessian: np.ndarray
    gradient: np.ndarray
    energy: dict[str, float]


@dataclass(frozen=True)
class Priors:
    """E_prior on alpha, beta, delta, roughness, specular and focal length; E_light on the lights:
    all that the rows of the unknowns say.
    """

    layout: Layout
    known: Known
    weights: Weights
    # Unknowns whose priors another photo of the same person carries.
    omitted: frozenset[str] = frozenset()

    @cached_property
    def residuals(self) -> dict[str, tuple[slice, Gaussian]]:
        """By the name of each energy: where its unknown lies, and the weighted residuals."""
        result = {}
        for unknown in UNKNOWNS:
            where = self.layout.slices[unknown.name]
            root = float(np.sqrt(getattr(self.weights, unknown.weight)))
            for name, prior in unknown.priors.items():
                if unknown.name not in self.omitted:
                    gaussian = prior(self.known, where.stop - where.start)
                    result[name] = where, gaussian.scaled(root)
        return result

    def without(self, names: Collection[str]) -> Priors:
        """Those of all unknowns but ``names``."""
        return replace(self, omitted=self.omitted | frozenset(names))

    def relative_to(self, light_scale: float) -> Priors:
        """With E_light relative to another mean radiance."""
        return replace(self, known=replace(self.known, light_scale=light_scale))

    def energies(self, state: State) -> dict[str, float]:
        """The energy of each term at ``state``."""
        values = self.layout.values(state)
        return {
            name: 0.5 * float((gaussian.residuals(values[where]) ** 2).sum())
            for name, (where, gaussian) in self.residuals.items()
        }

    def quadratic(self, state: State) -> Quadratic:
        """The terms around ``state``."""
        values = self.layout.values(state)
        hessian = np.zeros((self.layout.size, self.layout.size))
        gradient = np.zeros(self.layout.size)
        energy = {}
        for name, (where, gaussian) in self.residuals.items():
            residual = gaussian.residuals(values[where])
            hessian[where, where] += gaussian.hessian
            gradient[where] += gaussian.operator.T @ residual
            energy[name] = 0.5 * float(residual @ residual)
        return Quadratic(hessian, gradient, energy)

"""What is known before the photo: statistics of faces, of skin and of light (E_prior and
E_light).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.job import Weights
from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.energy.term import Placed, Quadratic, Setup, Term, Weighed
from facestage.fit.face.gaussians import Gaussian, Relative
from facestage.fit.face.layout import Layout
from facestage.fit.face.light_color import LightPrior
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import UNKNOWNS, Known

# What is not called "Prior on" and its name.
_OWN_WORDS = {
    "focal": "Prior on focal length",
    "specular_level": "Prior on specular",
    "specular_smooth": "Smoothness of specular",
    "light": "Light color",
}


def _words() -> dict[str, str]:
    names = (name for unknown in UNKNOWNS for name in unknown.priors)
    return {name: _OWN_WORDS.get(name, f"Prior on {name.replace('_', ' ')}") for name in names}


@dataclass(frozen=True, eq=False)
class Priors(Term, Placed):
    """E_prior on alpha, beta, delta, roughness, specular and focal length; E_light on the lights:
    all that the rows of the unknowns say. Wherever it is placed, it compares the same things.
    """

    words: ClassVar = _words()
    prior: ClassVar = True

    layout: Layout
    known: Known
    weights: Weights
    # Unknowns whose priors another photo of the same person carries.
    omitted: frozenset[str] = frozenset()

    @classmethod
    def of(cls, setup: Setup) -> Self:
        """Of every phase."""
        return cls(setup.layout, setup.known, setup.problem.job.weights)

    @cached_property
    def gaussians(self) -> dict[str, tuple[slice, Gaussian | Relative | LightPrior]]:
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

    def beside_another(self, shared: frozenset[str]) -> Self:
        """What is known of the person counts once."""
        return replace(self, omitted=self.omitted | shared)

    def at(self, state: State, evaluation: Evaluation | None = None) -> Self:
        """Everywhere the same."""
        return self

    def weighed(self, state: State) -> WeighedPriors:
        """With the residuals of ``state``."""
        return WeighedPriors(self, state, self.residuals(state))

    def residuals(self, state: State) -> dict[str, Float[np.ndarray, " _"]]:
        """By the name of each energy: its residuals (r,) at ``state``."""
        values = self.layout.values(state)
        return {
            name: gaussian.residuals(values[where])
            for name, (where, gaussian) in self.gaussians.items()
        }

    def energies(self, state: State) -> dict[str, float]:
        """The energy of each prior at ``state``."""
        return {name: 0.5 * float((one**2).sum()) for name, one in self.residuals(state).items()}


@dataclass(frozen=True, eq=False)
class WeighedPriors(Weighed):
    """The priors' residuals at one state; nearly quadratic, they need no weights."""

    priors: Priors
    state: State
    residuals: Mapping[str, Float[np.ndarray, " _"]]

    @property
    def energies(self) -> dict[str, float]:
        """Half the sum of squares of each."""
        return {name: 0.5 * float(one @ one) for name, one in self.residuals.items()}

    def add_to(self, total: Quadratic) -> None:
        """Exactly, but for the curvature of what is known of light."""
        values = total.layout.values(self.state)
        for where, gaussian in self.priors.gaussians.values():
            gaussian.add_to(total.hessian[where, where], total.gradient[where], values[where])

    def decrease(self, state: State, evaluation: Evaluation | None) -> float:
        """Exactly."""
        return sum(self.energies.values()) - sum(self.priors.energies(state).values())

"""How bright light is in a photo that somebody exposed: white skin would be about white in it.

Skin and light leave no more than their product in a photo. But cameras, and whoever develops their
pictures, set the exposure for the scene: white skin in the face's place would be brighter than the
photo's own white by about the same factor, whoever's face it is. That is no more than a habit, so
it says little beside whites of eyes that show, and nothing where a photo is plainly exposed for the
face.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.files.color import REC709
from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.energy.robust_residuals import RobustResiduals
from facestage.fit.energy.term import Setup, Term
from facestage.fit.face.layout import Layout
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.face.state import State
from facestage.fit.given.problem import Problem

# The radiance of white skin where the face is lit well, 1 being the photo's own white, and the
# deviation of its logarithm: photographs of 13 people at believable albedos of their skin
# (docs/skin-tone.md).
EXPOSED, SIGMA = 1.25, 0.375
# Of light that is too bright: far brighter photos are thrown away.
BRIGHTER_SCALE = 2.2
FAINT = 0.01  # of a photo this dark nobody chose the exposure


@dataclass(frozen=True, eq=False)
class Exposure(RobustResiduals):
    """What light would make of white skin, beside what photos are exposed for."""

    name: ClassVar = "exposure"
    cauchy_scale: ClassVar = 1.5  # some are exposed for a face before a window

    lights: LightParameters
    by_light: Float[np.ndarray, " lights"]  # radiance of white skin, of a light of radiance 1
    weight: float = 1.0
    share: float = 1.0

    def at(self, state: State, evaluation: Evaluation | None = None) -> Self:
        """Everywhere the same skin."""
        return self

    def residuals(self, state: State) -> Float[np.ndarray, " 1"]:
        """Of the logarithm of its luminance."""
        return np.array([np.log(self._white(state) / EXPOSED) / SIGMA])

    def scales(self, residuals: Float[np.ndarray, " 1"]) -> Float[np.ndarray, " 1"]:
        """Another one for light that is too bright."""
        return np.where(residuals > 0, BRIGHTER_SCALE, self.cauchy_scale)

    def jacobian(self, state: State, layout: Layout) -> Float[np.ndarray, "1 unknowns"]:
        """Derivative of :meth:`residuals`; lamps and face stand as at the phase's start."""
        fitted = self.by_light[self.lights.fitted]
        slope = np.einsum("j,jcp,c->p", fitted, self.lights.jacobian(state.lights), REC709)
        result = np.zeros((1, layout.size))
        result[0, layout.slices["lights"]] = slope / (self._white(state) * SIGMA)
        return result

    def _white(self, state: State) -> float:
        radiance = self.lights.radiance(state.lights) @ np.array(REC709)
        return float(self.by_light @ radiance) + FAINT


@dataclass(frozen=True, eq=False)
class ExposureTerm(Term):
    """The skin that is lit well as the phase began."""

    words: ClassVar = {"exposure": "Exposure of the photo"}

    exposure: Exposure

    @classmethod
    def of(cls, setup: Setup) -> Self | None:
        """Of phases that move the light, in photos that somebody has exposed."""
        if not (setup.moves_light and somebody_exposed(setup.problem)):
            return None
        by_light = setup.white_skin
        if by_light is None:
            return None
        return cls(Exposure(setup.forward.lights, by_light, setup.problem.job.weights.photo))

    def at(self, state: State, evaluation: Evaluation | None = None) -> Exposure:
        """Everywhere the same skin."""
        return self.exposure


def somebody_exposed(problem: Problem) -> bool:
    """Whether the photo's exposure says how bright its light is: not of files in linear light, and
    where the light's brightness or the skin's is known there is nothing to guess.
    """
    known = problem.job.skin_tone is not None or problem.lights.fixed_radiance.any()
    return problem.photograph.developed and not known

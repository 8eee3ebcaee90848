"""The teeth that a smile shows: how bright the light is, and of which color.

Teeth are nearly white, like the whites of the eyes, and many more pixels, the brightest of which no
lip shades.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.files.color import REC709
from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.energy.term import Setup, Term
from facestage.fit.energy.white_reference import WhiteReference
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.face.state import State

# What the best lit teeth show, beside white skin where the face is lit well (docs/skin-tone.md).
TEETH = np.array([0.68, 0.55, 0.44])
# Of the logarithm: how light teeth are, their red over blue, and their green over both.
SIGMA = np.array([0.22, 0.2, 0.08])


@dataclass(frozen=True, eq=False)
class Teeth(WhiteReference):
    """What light makes of teeth, beside what the photo shows of them."""

    name: ClassVar = "teeth"

    lights: LightParameters
    by_light: Float[np.ndarray, "3 lights"]
    seen: Float[np.ndarray, " 3"]
    deviation: Float[np.ndarray, " 3"]
    weight: float = 1.0
    share: float = 1.0


@dataclass(frozen=True, eq=False)
class TeethTerm(Term):
    """The teeth as the phase began."""

    words: ClassVar = {"teeth": "Teeth"}

    teeth: Teeth

    @classmethod
    def of(cls, setup: Setup) -> Self | None:
        """Of phases that move the light, where teeth are seen."""
        seen = setup.problem.teeth if setup.moves_light else None
        white = None if seen is None else setup.white_skin
        if seen is None or white is None:
            return None
        by_light, weight = TEETH[:, None] * white, setup.problem.job.weights.photo
        return cls(Teeth(setup.forward.lights, by_light, seen, SIGMA, weight))

    def at(self, state: State, evaluation: Evaluation | None = None) -> Teeth:
        """Everywhere the same teeth."""
        return self.teeth


def lightness_off(teeth: Float[np.ndarray, " 3"], white: float) -> float:
    """How far, in standard deviations, light of which white skin has the luminance ``white`` is too
    bright for ``teeth`` that show this radiance.
    """
    return float(np.log(max(white, 1e-9) * (TEETH @ REC709) / (teeth @ REC709)) / SIGMA[0])

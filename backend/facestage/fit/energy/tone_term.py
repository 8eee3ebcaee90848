"""How light and how dark people's skin is at most: a bound that light cannot hide behind; or how
light somebody knows that it is.

The tones of all people are one wide Gaussian to the face model, which puts nothing against skin
that is lighter than anybody's. The lightest is only half as light again as the mean one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.files.color import REC709
from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.energy.known_tone import KnownTone
from facestage.fit.energy.robust_residuals import QuadraticResiduals
from facestage.fit.energy.term import Setup, Term
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.models.anatomy.skin import HAEMOGLOBIN_MEAN, skin_albedo

# Melanosomes in the epidermis of the lightest and of the darkest people's faces (Jacques 1998: from
# 1.3 % on; what the sun does not see has less).
LIGHTEST, DARKEST = 0.008, 0.40
SIGMA = 0.1  # of the logarithm


@dataclass(frozen=True, eq=False)
class Tone(QuadraticResiduals):
    """How far the skin is lighter or darker than people are."""

    name: ClassVar = "tone"

    mean: float  # of the logarithm of the albedo, its channels as luminance counts them
    by_albedo: Float[np.ndarray, " albedos"]
    limits: tuple[float, float]
    weight: float = 1.0
    share: float = 1.0

    def residuals(self, state: State) -> Float[np.ndarray, " 1"]:
        """0 for people's skin."""
        tone = self._tone(state)
        return np.array([(tone - np.clip(tone, *self.limits)) / SIGMA])

    def jacobian(self, state: State, layout: Layout) -> Float[np.ndarray, "1 unknowns"]:
        """Derivative of :meth:`residuals`."""
        result = np.zeros((1, layout.size))
        low, high = self.limits
        if not low <= self._tone(state) <= high:
            result[0, layout.slices["albedo"]] = self.by_albedo / SIGMA
        return result

    def coefficients(self, luminance: float) -> Float[np.ndarray, " albedos"]:
        """The likeliest ones of skin of this logarithm of ``luminance``."""
        by_itself = max(float(self.by_albedo @ self.by_albedo), 1e-30)  # of one tone: 0
        return self.by_albedo * (luminance - self.mean) / by_itself

    def _tone(self, state: State) -> float:
        return self.mean + float(self.by_albedo @ state.albedo)


@dataclass(frozen=True, eq=False)
class ToneTerm(Term):
    """The limits of people's skin, or the tone that is known."""

    words: ClassVar = {
        Tone.name: "Skin lighter or darker than people's",
        KnownTone.name: "Skin lighter or darker than it is known to be",
    }
    prior: ClassVar = True

    tone: Tone | KnownTone

    @classmethod
    def of(cls, setup: Setup) -> Self | None:
        """Of phases that move the albedo."""
        if not setup.moves(("albedo",)):
            return None
        geometry, job = setup.problem.geometry, setup.problem.job
        if job.skin_tone is None:
            return cls(tone_of(geometry, job.weights.prior))
        return cls(KnownTone.of(geometry, job.skin_tone, job.weights.prior))

    def beside_another(self, shared: frozenset[str]) -> Self:
        """What is known of the person counts once."""
        weight = 0.0 if "albedo" in shared else self.tone.weight
        return replace(self, tone=replace(self.tone, weight=weight))

    def at(self, state: State, evaluation: Evaluation | None = None) -> Tone | KnownTone:
        """Everywhere the same."""
        return self.tone


def tone_of(geometry: FaceGeometry, weight: float = 1.0) -> Tone:
    """Of the skin that is compared with photos."""
    luminance, skin = np.array(REC709), geometry.fitted_vertices
    melanin, blood = np.array([DARKEST, LIGHTEST]), np.full(2, HAEMOGLOBIN_MEAN)
    low, high = np.log(skin_albedo(melanin, blood)) @ luminance
    return Tone(
        float((geometry.log_albedo[skin] @ luminance).mean()),
        np.asarray(geometry.albedo_basis[:, skin].mean(axis=1) @ luminance),
        (float(low), float(high)),
        weight,
    )

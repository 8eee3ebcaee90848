"""How bright light is in a photo that somebody exposed: so that what is white in it is white.

Skin and light leave no more than their product in a photo. But cameras, and whoever develops their
pictures, set the exposure for the scene: a white card in the face's light would be nearly
saturated, whoever's face it is. That is no more than a habit, so it says little beside whites of
eyes that show, and nothing where a photo is plainly exposed for the face.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.files.color import REC709
from facestage.contract.light_stage import LightStage
from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.energy.robust_residuals import RobustResiduals
from facestage.fit.energy.term import Setup, Term
from facestage.fit.face.lamps import turned
from facestage.fit.face.layout import Layout
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.face.state import State

# The radiance of a perfect white that faces the light, 1 being the photo's own white, and the
# deviation of its logarithm: ten photographs of people, at believable albedos of their skin, have
# 0.7 to 2.2 (docs/skin-tone.md).
EXPOSED, SIGMA = 1.4, 0.4
# Of light that is too bright: far brighter photos are thrown away.
BRIGHTER_SCALE = 2.2
FAINT = 0.01  # of a photo this dark nobody chose the exposure
# Normals that the camera sees, from straight on to a slant.
SLANTS, TURNS = np.linspace(0.0, np.radians(80.0), 9), np.linspace(0.0, 2 * np.pi, 16, False)


@dataclass(frozen=True, eq=False)
class Exposure(RobustResiduals):
    """What light would make of a white card, beside what photos are exposed for."""

    name: ClassVar = "exposure"
    cauchy_scale: ClassVar = 1.5  # some are exposed for a face before a window

    lights: LightParameters
    by_light: Float[np.ndarray, " lights"]  # radiance of the card, of a light of radiance 1
    weight: float = 1.0
    share: float = 1.0

    def at(self, state: State, evaluation: Evaluation | None = None) -> Self:
        """Everywhere the same card."""
        return self

    def residuals(self, state: State) -> Float[np.ndarray, " 1"]:
        """Of the logarithm of its luminance."""
        return np.array([np.log(self._card(state) / EXPOSED) / SIGMA])

    def scales(self, residuals: Float[np.ndarray, " 1"]) -> Float[np.ndarray, " 1"]:
        """Another one for light that is too bright."""
        return np.where(residuals > 0, BRIGHTER_SCALE, self.cauchy_scale)

    def jacobian(self, state: State, layout: Layout) -> Float[np.ndarray, "1 unknowns"]:
        """Derivative of :meth:`residuals`; lamps and face stand as at the phase's start."""
        fitted = self.by_light[self.lights.fitted]
        slope = np.einsum("j,jcp,c->p", fitted, self.lights.jacobian(state.lights), REC709)
        result = np.zeros((1, layout.size))
        result[0, layout.slices["lights"]] = slope / (self._card(state) * SIGMA)
        return result

    def _card(self, state: State) -> float:
        radiance = self.lights.radiance(state.lights) @ np.array(REC709)
        return float(self.by_light @ radiance) + FAINT


@dataclass(frozen=True, eq=False)
class ExposureTerm(Term):
    """The card as the phase began."""

    words: ClassVar = {"exposure": "Exposure of the photo"}

    exposure: Exposure

    @classmethod
    def of(cls, setup: Setup) -> Self | None:
        """Of phases that move the light, in photos that somebody has exposed."""
        if setup.stage is None or not setup.moves(("lights",)):
            return None
        lights = setup.forward.lights
        if not setup.problem.photograph.developed or lights.fixed_radiance.any():
            return None  # light of known brightness needs no guess
        stage = turned(setup.stage, setup.start.light_position, setup.pivot)
        radiance = lights.radiance(setup.start.lights) @ np.array(REC709)
        by_light = brightest_card(stage, setup.start.translation, radiance)
        return cls(Exposure(lights, by_light, setup.problem.job.weights.photo))

    def at(self, state: State, evaluation: Evaluation | None = None) -> Exposure:
        """Everywhere the same card."""
        return self.exposure


def brightest_card(
    stage: LightStage, place: Float[np.ndarray, " 3"], radiance: Float[np.ndarray, " lights"]
) -> Float[np.ndarray, " lights"]:
    """The radiance that each light of radiance 1 gives a perfect white at ``place``, turned so that
    it is brightest under all lights of ``radiance``, of what the camera can see. Camera frame.
    """
    to_light = stage.position - place
    distance = np.linalg.norm(to_light, axis=1)
    to_light = to_light / distance[:, None]
    facing = np.clip(-(to_light * stage.direction).sum(axis=1), 0.0, None)
    slant, turn = (grid.ravel() for grid in np.meshgrid(SLANTS, TURNS))
    toward = -place / max(float(np.linalg.norm(place)), 1e-9)
    side = np.cross([0.0, 1.0, 0.0], toward)
    side /= max(float(np.linalg.norm(side)), 1e-9)
    normals = (
        np.cos(slant)[:, None] * toward
        + (np.sin(slant) * np.cos(turn))[:, None] * side
        + (np.sin(slant) * np.sin(turn))[:, None] * np.cross(toward, side)
    )
    solid_angle = stage.side**2 * facing / distance**2
    shown = np.clip(normals @ to_light.T, 0.0, None) * solid_angle / np.pi
    return np.asarray(shown[np.argmax(shown @ radiance)])

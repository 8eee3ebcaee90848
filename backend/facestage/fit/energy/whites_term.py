"""The whites of the eyes: what has nearly the same albedo in everybody, as long as lids do not
shade it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from facestage.contract.arrays import Float
from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.energy.term import Setup, Term
from facestage.fit.energy.white_reference import WhiteReference
from facestage.fit.face.eye_white import eye_is_open, eye_white
from facestage.fit.face.lamps import turned
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.face.state import State
from facestage.fit.forward.reflectance import EYE_ROUGHNESS, EYE_SPECULAR, Skin
from facestage.fit.forward.shading import ForwardModel, Surface
from facestage.fit.given.skin_mask import SURE_SKIN
from facestage.render.light_terms import PLAIN

# Of the logarithm: how light whites are, their red over blue (bloodshot, yellow), and their green
# over both; with what lids, lashes and the eye's own shadows do to the pixels that were chosen.
SIGMA = np.array([0.2, 0.12, 0.08])
# One pixel beside another may show half a lid.
PIXEL_SIGMA = np.array([0.4, 0.12, 0.12])
# Among the pixels that should be white, sorted by what they say of the albedo: below, lids, lashes
# and the iris mix in; above, the light's own reflection.
BRIGHTER_THAN, DARKER_THAN = 0.6, 0.9
PIXELS_MIN, PIXELS_MAX = 8, 400
SAMPLES = 16


@dataclass(frozen=True, eq=False)
class Whites(WhiteReference):
    """What light makes of the whites, beside what the photo shows of them."""

    name: ClassVar = "whites"
    # Lids and lashes darken the whites of real eyes by anything up to a unit of the logarithm, and
    # eyes that lie elsewhere than found are no whites.
    cauchy_scale: ClassVar = 2.0

    lights: LightParameters
    by_light: Float[np.ndarray, "3 lights"]
    seen: Float[np.ndarray, " 3"]
    deviation: Float[np.ndarray, " 3"]
    weight: float = 1.0
    share: float = 1.0


@dataclass(frozen=True, eq=False)
class WhitesTerm(Term):
    """The whites as the phase began."""

    words: ClassVar = {"whites": "Whites of the eyes"}

    whites: Whites

    @classmethod
    def of(cls, setup: Setup) -> Self | None:
        """Of phases that move the light, where open eyes are seen."""
        whites = _whites(setup) if setup.moves_light else None
        return None if whites is None else cls(whites)

    def at(self, state: State, evaluation: Evaluation | None = None) -> Whites:
        """Everywhere the same pixels."""
        return self.whites


def _whites(setup: Setup) -> Whites | None:
    """What the start of a phase shows of the whites; None where none are seen, or no light."""
    assert setup.photo is not None and setup.stage is not None
    forward, photo = setup.forward, setup.problem.photograph
    # A phase's photo may be too small for eyes.
    focal_px = setup.start.camera.focal_px / setup.factor
    state = replace(setup.start, camera=replace(setup.problem.camera, focal_px=focal_px))
    radiance = forward.lights.radiance(state.lights)
    surface = _surface(forward, state)
    x, y = surface.pixels.astype(int).T
    low_y, low_x = ((setup.factor * at).astype(int) for at in (y, x))
    height, width = setup.photo.usable.shape
    clear = setup.photo.usable[np.minimum(low_y, height - 1), np.minimum(low_x, width - 1)]
    clear &= photo.mask[y, x] & ~setup.problem.frame[y, x] & ~photo.clipped[y, x].any(axis=1)
    if clear.sum() < PIXELS_MIN or not radiance.any():
        return None
    surface = surface.part(np.flatnonzero(clear)[:: 1 + int(clear.sum()) // PIXELS_MAX])
    by_light = _by_light(setup, state, surface)
    shown = np.einsum("cpj,jc->pc", by_light, radiance)
    x, y = surface.pixels.astype(int).T
    color = photo.color[y, x].astype(np.float64)
    lightness = np.log(np.maximum(color, 1e-6) / np.maximum(shown, 1e-9)).mean(axis=1)
    low, high = np.quantile(lightness, (BRIGHTER_THAN, DARKER_THAN))
    chosen = (lightness >= low) & (lightness <= high)
    seen = np.maximum(color[chosen].mean(axis=0), 1e-6)
    if not eye_is_open(seen, photo.color[photo.mask & (setup.problem.skin > SURE_SKIN)]):
        return None
    return Whites(
        forward.lights,
        by_light[:, chosen].mean(axis=1),
        seen,
        np.hypot(SIGMA, PIXEL_SIGMA / np.sqrt(chosen.sum())),
        setup.problem.job.weights.photo,
    )


def _surface(forward: ForwardModel, state: State) -> Surface:
    """What the pixels see that should show the white of an eye."""
    white = eye_white(forward.geometry)
    at = state.camera.project(forward.pose(state)[1][white])
    at = at[np.isfinite(at).all(axis=1)]
    size = [state.camera.width, state.camera.height]
    low, high = (
        np.clip(end, 0, size).astype(int)
        for end in ((at.min(axis=0), at.max(axis=0) + 1) if len(at) else (0, 0))
    )
    x, y = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
    pixels = np.stack([x.ravel(), y.ravel()], axis=1) + 0.5
    surface = forward.surface(state, pixels)
    return surface.part(white[surface.corners].all(axis=1))


def _by_light(setup: Setup, state: State, surface: Surface) -> Float[np.ndarray, "3 pixels lights"]:
    """Radiance of the ``surface`` under each light of radiance 1."""
    assert setup.stage is not None
    stage = turned(setup.stage, state.light_position, setup.pivot)
    rough, count = np.full(len(surface.pixels), EYE_ROUGHNESS), len(surface.pixels)
    terms = setup.forward.light_terms(
        state, surface, stage, SAMPLES, setup.problem.job.seed, PLAIN, roughness=rough
    )
    skin = Skin(setup.forward.albedo(state, surface), np.full(count, EYE_SPECULAR))
    return skin.by_lights(terms.diffuse, terms.specular, indirect=terms.indirect)

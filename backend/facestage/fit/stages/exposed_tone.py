"""Where skin starts: as light as somebody says, or as the photo's exposure and teeth do.

Skin twice as dark in light twice as bright is the same matte picture, so a fit may stay near the
tone that it starts from; and dark skin, begun as the mean, is explained as lighter skin in the
shade. The exposure and the prior of tones say before the first step where to begin.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from facestage.contract.arrays import Float
from facestage.contract.files.color import REC709
from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.energy.exposure_term import EXPOSED, SIGMA, somebody_exposed
from facestage.fit.energy.known_tone import KnownTone
from facestage.fit.energy.photo_term import PhotoTerm
from facestage.fit.energy.teeth_term import lightness_off
from facestage.fit.energy.tone_term import tone_of
from facestage.fit.energy.white_skin import SKIN_MIN, white_skin
from facestage.fit.given.problem import Problem
from facestage.fit.stages.initialize import initial_lights

# Of the logarithm of luminance, among people whose photo may come.
TONE_SIGMA = 0.7
TOLERANCE = 0.03


def as_light_as_exposed(
    problem: Problem, photo: PhotoTerm, evaluation: Evaluation
) -> Float[np.ndarray, " albedos"]:
    """The albedo's coefficients to start from, each tried under the lights that then explain the
    photo best; those of the skin tone where it is known. As they are in ``evaluation`` where
    somebody has given or held them, or nobody has chosen the exposure.
    """
    state, image = evaluation.state, evaluation.image
    if state.albedo.any() or "albedo" in problem.job.freeze:
        return state.albedo
    if problem.job.skin_tone is not None:
        return KnownTone.of(problem.geometry, problem.job.skin_tone).coefficients()
    if not somebody_exposed(problem):
        return state.albedo
    y, x = photo.index(image.surface)
    skin = (evaluation.base_weight[y, x] > 0) & (photo.photo.skin[y, x] > SKIN_MIN)
    if not skin.any():
        return state.albedo
    tone, teeth = tone_of(problem.geometry), problem.teeth

    def unlikely(luminance: float) -> float:
        there = replace(state, albedo=tone.coefficients(luminance))
        albedo = photo.forward.albedo(there, image.surface)
        tried = replace(evaluation, image=replace(image, albedo=albedo))
        radiance = initial_lights(tried, photo, problem.lights) @ np.array(REC709)
        white = float(white_skin(image.terms.diffuse[skin], radiance) @ radiance)
        exposed = np.log(max(white, 1e-9) / EXPOSED) / SIGMA
        smiles = 0.0 if teeth is None else lightness_off(teeth, white)
        return float(exposed**2 + smiles**2 + ((luminance - tone.mean) / TONE_SIGMA) ** 2)

    found = minimize_scalar(
        unlikely, bounds=tone.limits, method="bounded", options={"xatol": TOLERANCE}
    )
    return tone.coefficients(float(found.x))


def is_darker(problem: Problem, albedo: Float[np.ndarray, " albedos"]) -> bool:
    """Whether skin of these coefficients is darker than the model's mean."""
    return bool(tone_of(problem.geometry).by_albedo @ albedo < 0)

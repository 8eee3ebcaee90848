"""What light would make of white skin where a face is lit well: what references in the photo are
compared with.
"""

from __future__ import annotations

import numpy as np

from facestage.contract import brdf
from facestage.contract.arrays import Float
from facestage.contract.files.color import REC709
from facestage.contract.light_stage import LightStage
from facestage.fit.face.state import State
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.photo import Photo

# Lit well: quantiles of the visible skin, from shade to the brightest. Beyond, a lamp at the side
# that grazes the face would say how bright light is.
LIT_WELL = (0.5, 0.75)
PIXELS_MIN, PIXELS_MAX, SAMPLES = 30, 400, 8
SKIN_MIN = 0.5


def white_skin(
    irradiance: Float[np.ndarray, "pixels lights"], radiance: Float[np.ndarray, " lights"]
) -> Float[np.ndarray, " lights"]:
    """The radiance that each light of radiance 1 gives white skin where the face is lit well by all
    lights of ``radiance``; ``irradiance`` by each light of radiance 1 where skin is seen.
    """
    white = brdf.matte(1.0, irradiance)
    shown = white @ radiance
    low, high = np.quantile(shown, LIT_WELL)
    return np.asarray(white[(shown >= low) & (shown <= high)].mean(axis=0))


def white_skin_of(
    forward: ForwardModel, state: State, photo: Photo, stage: LightStage, seed: int
) -> Float[np.ndarray, " lights"] | None:
    """The same of the face in a ``photo`` under a ``stage`` whose lights stand as in ``state``;
    None where too little of it shows.
    """
    y, x = np.nonzero(photo.usable & (photo.skin > SKIN_MIN))
    every = 1 + len(y) // PIXELS_MAX
    surface = forward.surface(state, np.stack([x, y], axis=1)[::every] + 0.5, only_fitted=True)
    if len(surface.pixels) < PIXELS_MIN:
        return None
    terms = forward.light_terms(state, surface, stage, SAMPLES, seed)
    radiance = forward.lights.radiance(state.lights) @ np.array(REC709)
    return white_skin(terms.diffuse, radiance)

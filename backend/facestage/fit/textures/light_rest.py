"""What a photo's light leaves in the albedo: pale patches wider and lighter than skin's own."""

from __future__ import annotations

import numpy as np

from facestage.contract.arrays import Float
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.forward.shading import Surface
from facestage.fit.textures.unseen_tone import unseen_tone

SCALE = 0.008  # metres: what is smaller may be a scar or a spot
# Log albedo above that of all seen skin from which on more and more is a highlight that the fitted
# lights lack.
LIGHTER = 0.1


def light_rest(
    geometry: FaceGeometry,
    surface: Surface,
    target: Float[np.ndarray, "pixels 3"],
    weight: Float[np.ndarray, " pixels"],
    feature: Float[np.ndarray, " pixels"],
) -> Float[np.ndarray, " pixels"]:
    """0 or more, what of ``target`` (log of photo over model) is light and no pigment; arguments as
    of :func:`unseen_tone`.

    Only what is lighter: beards, and shades that belong to features, are dark over as wide areas.
    """
    if weight.sum() <= 0:
        return np.zeros(len(target))
    wide = surface.of_vertices(unseen_tone(geometry, surface, target, weight, feature, SCALE))
    wide = wide.mean(axis=1)
    lighter = np.maximum(wide - np.average(wide, weights=weight), 0.0)
    return lighter - LIGHTER * np.tanh(lighter / LIGHTER)

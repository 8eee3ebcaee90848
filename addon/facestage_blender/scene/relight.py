"""Light the fitted face from elsewhere, and go back."""

from __future__ import annotations

import bpy
import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.light_stage import OFF

from .frames import LIGHT_DIRECTIONS
from .stage import light_side, read_stage, require_stage, set_light_radiance, stage_lights

SHARPNESS = 6.0  # exponent of the cosine lobe: a soft key light that still casts a shadow


def relight(scene: bpy.types.Scene, direction: str) -> None:
    """White light from one side, of the same total radiance as the fitted lights. Lights that are
    off stay off.

    Raises InputError when the direction is none, or when no light is on.
    """
    if direction not in LIGHT_DIRECTIONS:
        raise InputError(
            f"Cannot light from '{direction}'; expected one of {', '.join(LIGHT_DIRECTIONS)}."
        )
    empty = require_stage(scene)
    lights = stage_lights(empty)
    stage = read_stage(empty)
    lit = stage.state != OFF
    if not lit.any():
        raise InputError("All lights of the stage are off; turn one on (Lights, Set All).")
    towards = np.array(LIGHT_DIRECTIONS[direction]) / np.linalg.norm(LIGHT_DIRECTIONS[direction])
    cosine = np.where(lit, -stage.direction @ towards, -np.inf)
    lobe = np.maximum(0.0, cosine) ** SHARPNESS
    if lobe.sum() <= 1e-6:  # no light near that side: the nearest one serves
        lobe = (np.arange(len(lights)) == np.argmax(cosine)).astype(float)
    fitted = np.array([light.facestage_light.fitted_radiance for light in lights])
    total = fitted.mean(axis=1).sum()
    for light, share, on in zip(lights, lobe / lobe.sum(), lit, strict=True):
        if on:
            set_light_radiance(light, np.full(3, total * share), light_side(light))


def restore_lights(scene: bpy.types.Scene) -> None:
    """Give every light the radiance that the last fit, or the last build of the stage, gave it."""
    for light in stage_lights(require_stage(scene)):
        radiance = np.array(light.facestage_light.fitted_radiance)
        if radiance.any() or light.facestage_light.state != "OFF":  # an off light keeps its power
            set_light_radiance(light, radiance, light_side(light))

"""How well the color of the skin is known beside that of the light: a photo knows their product."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from facestage.contract.arrays import Float
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.layout import Layout
from facestage.fit.face.light_parameters import CHANNELS, LightParameters
from facestage.fit.face.state import State

RED_OVER_BLUE = np.array([1.0, 0.0, -1.0])


@dataclass(frozen=True)
class ColorDoubt:
    """Standard deviations of the logarithm of red over blue."""

    light: float  # of all light together
    skin: float  # of the face's mean albedo


def color_doubt(
    geometry: FaceGeometry,
    lights: LightParameters,
    state: State,
    known: Float[np.ndarray, "unknowns unknowns"],
) -> ColorDoubt | None:
    """By the covariance ``known`` of the unknowns at ``state``; None where light or skin is
    held.
    """
    layout = Layout(state)
    of_light, of_skin = (layout.slices[name] for name in ("lights", "albedo"))
    if not (np.diag(known)[of_light].any() and np.diag(known)[of_skin].any()):
        return None
    total = np.maximum(lights.radiance(state.lights).sum(axis=0), 1e-30)
    by_light = np.einsum("jcp,c->p", lights.jacobian(state.lights), RED_OVER_BLUE / total)
    region = geometry.model.regions.get("narrow_face", geometry.used)
    mean = geometry.model.albedo_basis[:, region].reshape(-1, len(region), CHANNELS).mean(axis=1)
    by_skin = mean.astype(np.float64) @ RED_OVER_BLUE
    return ColorDoubt(
        _deviation(by_light, known[of_light, of_light]),
        _deviation(by_skin, known[of_skin, of_skin]),
    )


def _deviation(slope: np.ndarray, known: np.ndarray) -> float:
    """Of what changes by ``slope`` (n,) with values of the covariance ``known`` (n, n)."""
    counted = slope != 0
    open_values = np.isinf(np.diag(known)[counted])
    if open_values.any():
        return float("inf")
    part = known[np.ix_(counted, counted)]
    return float(np.sqrt(max(float(slope[counted] @ part @ slope[counted]), 0.0)))

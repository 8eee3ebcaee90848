"""How light the skin is where somebody has said it: its individual typology angle.

A photo knows the product of light and skin. Whoever has seen the person knows the skin, at least
which of six types it is; the light is then what the photo leaves over.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.files.color import REC709
from facestage.contract.skin_tone import typology_angle
from facestage.fit.energy.robust_residuals import QuadraticResiduals
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State

SIGMA = 2.0  # degrees, as exactly as it is measured
STEP = 1e-4  # of log color, for the derivative of the angle
# Where on the way from the mean to lighter and darker skin an angle is looked up, in the logarithm
# of luminance.
LUMINANCES = np.linspace(-4.0, 3.0, 701)


@dataclass(frozen=True, eq=False)
class KnownTone(QuadraticResiduals):
    """How far the color of the face, the mean of its log albedo, is from the tone."""

    name: ClassVar = "known_tone"

    angle: float  # degrees
    mean: Float[np.ndarray, " 3"]  # log albedo
    by_albedo: Float[np.ndarray, "albedos 3"]
    weight: float = 1.0
    share: float = 1.0

    @classmethod
    def of(cls, geometry: FaceGeometry, angle: float, weight: float = 1.0) -> Self:
        """Of skin of a typology ``angle`` in degrees: on the narrow face where the model says which
        that is, else wherever the face is compared with photos.
        """
        named = geometry.model.regions.get("narrow_face")
        skin = geometry.fitted_vertices if named is None else geometry.new_index[named]
        skin = skin[skin >= 0]  # of a region, what is rendered
        mean, basis = geometry.log_albedo[skin], geometry.albedo_basis[:, skin]
        return cls(angle, mean.mean(axis=0), basis.mean(axis=1), weight)

    def residuals(self, state: State) -> Float[np.ndarray, " 1"]:
        """Of the angle."""
        return np.array([(float(typology_angle(self._color(state.albedo))) - self.angle) / SIGMA])

    def jacobian(self, state: State, layout: Layout) -> Float[np.ndarray, "1 unknowns"]:
        """Derivative of :meth:`residuals`."""
        color, steps = self._color(state.albedo), STEP * np.eye(3)
        slope = typology_angle(color * np.exp(steps)) - typology_angle(color * np.exp(-steps))
        result = np.zeros((1, layout.size))
        result[0, layout.slices["albedo"]] = self.by_albedo @ slope / (2 * STEP * SIGMA)
        return result

    def coefficients(self) -> Float[np.ndarray, " albedos"]:
        """The likeliest albedo of this tone: the mean one as much lighter or darker as it takes."""
        by_luminance = self.by_albedo @ np.array(REC709)
        way = by_luminance / max(float(by_luminance @ by_luminance), 1e-30)
        angles = typology_angle(self._color(np.outer(LUMINANCES, way)))
        rising = np.maximum.accumulate(angles)
        return way * float(np.interp(self.angle, rising, LUMINANCES))

    def _color(self, albedo: Float[np.ndarray, "*cases albedos"]) -> Float[np.ndarray, "*cases 3"]:
        return np.exp(self.mean + albedo @ self.by_albedo)

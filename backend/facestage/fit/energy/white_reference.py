"""Something in a photo whose color is known before: what a grey card is for photographers.

Skin and light leave no more than their product in a photo. What is nearly white, under the same
light, says how bright the light is, and of which color.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar, Self

import numpy as np

from facestage.contract.arrays import Float
from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.energy.robust_residuals import RobustResiduals
from facestage.fit.face.layout import Layout
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.face.state import State

# Of the logarithm: lightness, red over blue, and green over both.
AXES = np.array([[1 / 3, 1 / 3, 1 / 3], [1.0, 0.0, -1.0], [-0.5, 1.0, -0.5]])


class WhiteReference(RobustResiduals):
    """What light makes of it, beside what the photo shows; shape and pose are those of the phase's
    start.

    A subclass is a frozen dataclass with the fields ``lights``, ``by_light``, the radiance of the
    reference under each light of radiance 1, and ``seen``, that in the photo.
    """

    components: ClassVar = 3
    lights: LightParameters
    by_light: Float[np.ndarray, "3 lights"]
    seen: Float[np.ndarray, " 3"]

    @abstractmethod
    def sigma(self, too_bright: bool) -> Float[np.ndarray, " 3"]:
        """Deviations along the axes, where the light seems ``too_bright`` or not."""

    def at(self, state: State, evaluation: Evaluation | None = None) -> Self:
        """Everywhere the same pixels."""
        return self

    def residuals(self, state: State) -> Float[np.ndarray, " 3"]:
        """In lightness, from blue to red, and in green."""
        off = self._off(state)
        return np.asarray(off / self.sigma(bool(off[0] > 0)))

    def jacobian(self, state: State, layout: Layout) -> Float[np.ndarray, "3 unknowns"]:
        """Derivative of :meth:`residuals`."""
        fitted = self.by_light[:, self.lights.fitted]
        by_log = np.einsum("cj,jcp->cp", fitted, self.lights.jacobian(state.lights))
        sigma = self.sigma(bool(self._off(state)[0] > 0))
        result = np.zeros((3, layout.size))
        result[:, layout.slices["lights"]] = (
            AXES @ (by_log / self._shown(state)[:, None]) / sigma[:, None]
        )
        return result

    def _off(self, state: State) -> Float[np.ndarray, " 3"]:
        return np.asarray(AXES @ np.log(self._shown(state) / self.seen))

    def _shown(self, state: State) -> Float[np.ndarray, " 3"]:
        radiance = self.lights.radiance(state.lights)
        return np.maximum(np.einsum("cj,jc->c", self.by_light, radiance), 1e-30)

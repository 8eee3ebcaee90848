"""Something in a photo whose color is known before: what a grey card is for photographers.

Skin and light leave no more than their product in a photo. What is nearly white, under the same
light, says how bright the light is, and of which color.
"""

from __future__ import annotations

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
    reference under each light of radiance 1, ``seen``, that in the photo, and ``deviation``, the
    standard ones along the axes.
    """

    components: ClassVar = 3
    lights: LightParameters
    by_light: Float[np.ndarray, "3 lights"]
    seen: Float[np.ndarray, " 3"]
    deviation: Float[np.ndarray, " 3"]

    def at(self, state: State, evaluation: Evaluation | None = None) -> Self:
        """Everywhere the same pixels."""
        return self

    def residuals(self, state: State) -> Float[np.ndarray, " 3"]:
        """In lightness, from blue to red, and in green."""
        return np.asarray(AXES @ np.log(self._shown(state) / self.seen) / self.deviation)

    def jacobian(self, state: State, layout: Layout) -> Float[np.ndarray, "3 unknowns"]:
        """Derivative of :meth:`residuals`."""
        fitted = self.by_light[:, self.lights.fitted]
        by_log = np.einsum("cj,jcp->cp", fitted, self.lights.jacobian(state.lights))
        result = np.zeros((3, layout.size))
        result[:, layout.slices["lights"]] = (
            AXES @ (by_log / self._shown(state)[:, None]) / self.deviation[:, None]
        )
        return result

    def _shown(self, state: State) -> Float[np.ndarray, " 3"]:
        radiance = self.lights.radiance(state.lights)
        return np.maximum(np.einsum("cj,jc->c", self.by_light, radiance), 1e-30)

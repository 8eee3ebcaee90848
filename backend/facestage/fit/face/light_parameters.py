"""How the parameters of the lights become radiance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from facestage.contract.arrays import Bool, Float, Int

CHANNELS = 3


@dataclass(frozen=True)
class LightParameters:
    """How the light parameters become radiance; a light that is not fitted has none.

    multi: one parameter per light and channel. uniform: one intensity per light and one color for
    all (three more parameters; the product's scale is held by a prior on the color's mean).
    """

    fitted: Bool[np.ndarray, " lights"]
    fixed_radiance: Float[np.ndarray, "lights 3"]  # zero where fitted or off
    uniform: bool
    # what names a light when others come or go; None: 0, 1, 2, ...
    numbers: Int[np.ndarray, " lights"] | None = None

    @property
    def size(self) -> int:
        """Number of light parameters."""
        count = int(self.fitted.sum())
        # A color that no fitted light has is no parameter.
        return count + CHANNELS if self.uniform and count else count * CHANNELS

    def radiance(
        self, parameters: Float[np.ndarray, " parameters"]
    ) -> Float[np.ndarray, "lights 3"]:
        """Radiance of every light."""
        result = self.fixed_radiance.copy()
        if self.uniform and self.size:
            result[self.fitted] = parameters[:-CHANNELS, None] * parameters[-CHANNELS:]
        else:
            result[self.fitted] = parameters.reshape(-1, CHANNELS)
        return result

    def jacobian(
        self, parameters: Float[np.ndarray, " parameters"]
    ) -> Float[np.ndarray, "fitted 3 parameters"]:
        """Derivative of the fitted lights' radiance."""
        count = int(self.fitted.sum())
        result = np.zeros((count, CHANNELS, self.size))
        if not count:
            return result
        light = np.arange(count)
        for channel in range(CHANNELS):
            if self.uniform and count:
                result[light, channel, light] = parameters[count + channel]
                result[:, channel, count + channel] = parameters[:count]
            else:
                result[light, channel, light * CHANNELS + channel] = 1.0
        return result

    def dark(
        self, parameters: Float[np.ndarray, " parameters"], settled: Bool[np.ndarray, " parameters"]
    ) -> Bool[np.ndarray, " lights"]:
        """Lights of radiance 0 that nothing will turn on.

        ``settled`` marks the parameters that are at their bound and want to stay
        there, or may not move.
        """
        result = (self.radiance(parameters) == 0).all(axis=1)
        own = (self.jacobian(parameters) != 0).any(axis=1)
        result[self.fitted] &= own.any(axis=1) & ~(own & ~settled).any(axis=1)
        return result

    def of_lights(self, chosen: Bool[np.ndarray, " lights"]) -> Bool[np.ndarray, " parameters"]:
        """The parameters that belong to the ``chosen`` lights alone."""
        own = chosen[self.fitted]
        if not self.uniform or not self.size:
            return np.repeat(own, CHANNELS)
        return np.concatenate([own, np.zeros(CHANNELS, bool)])

    def from_radiance(
        self, radiance: Float[np.ndarray, "lights 3"]
    ) -> Float[np.ndarray, " parameters"]:
        """Parameters whose radiance is nearest to ``radiance``."""
        wanted = radiance[self.fitted]
        if not self.uniform or not self.size:
            return wanted.ravel().astype(float)
        total = wanted.sum(0)
        color = total / total.mean() if total.sum() > 0 else np.ones(CHANNELS)
        return np.concatenate([wanted @ color / (color @ color), color])

"""E_light: what is known of a photo's light before it is seen, whatever its level.

Dib et al. 2019, eq. 5, wants every light white, and dim. But photos are metered: how bright the
light is and how light the skin are one number to them, so that a prior that likes dim light makes
dark people light. And white balances miss, and lamps differ: along the locus of daylight and of
what glows (Judd, MacAdam and Wyszecki 1964; Planck), hardly across it, towards green or magenta. So
here colors are ratios, of each light to all and of all to white, wide along the locus and narrow
across, and the brightness of a light is its share of the total.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from facestage.contract.arrays import Bool, Float
from facestage.fit.face.light_axes import AXES
from facestage.fit.face.light_parameters import CHANNELS, LightParameters
from facestage.fit.face.white_balance import WhiteBalance

# Black bodies from 2300 K and daylight to 20000 K, 6500 K being white, lie within 0.07 of
# across = TILT along - BEND along^2; seen by a camera that is balanced to 3200, 4500 or 9500 K,
# within 0.15.
TILT, BEND = 0.06, 0.16
# Along and across: of all light together, which the white balance missed; of each light beside it.
COMMON_SIGMA, OWN_SIGMA = np.array([0.3, 0.05]), np.array([0.5, 0.1])
# The share of the mean light below which a light's own color is nobody's concern.
FAINT = 0.1
# How many times the mean light one is, about; and the mean light over that of the first guess,
# which the skin's tone knows better.
SHARE_SIGMA, LEVEL_SIGMA = 3.0, 3.0
# What each light costs that shines, hardly more where it has more than this share: few lamps
# explain most photos, and many weak lights beside them are a veil of gloss, which makes skin dark.
# The least share bounds the slope at darkness.
LIGHT_COST, SHINING, LEAST = 2.0, 0.02, 1e-4
UNIFORM_SIGMA = 0.06  # of the mean of the one color of all lights, whose scale is the intensities'
# What is further than so many standard deviations costs little more: neon is on no locus. But of
# each light across it later: a violet lamp and a green one explain half-lit dark skin cheaply.
CAUCHY_SCALE, OWN_CAUCHY_SCALE = 3.0, np.array([3.0, 6.0])


@dataclass(frozen=True)
class LightPrior:
    """Residuals, in standard deviations, of the lights' parameters (n,); see :class:`Gaussian`."""

    lights: LightParameters
    scale: float  # the mean radiance of the first guess
    factor: float = 1.0  # on each residual
    # In place of what is known of white balances that miss; None: nobody looked.
    white: WhiteBalance | None = None

    def scaled(self, factor: float) -> LightPrior:
        """With ``factor`` times each residual."""
        return replace(self, factor=self.factor * factor)

    def residuals(self, values: Float[np.ndarray, " values"]) -> Float[np.ndarray, " residuals"]:
        """The residuals of the ``values``."""
        return self._rows(values)[0]

    def jacobian(
        self, values: Float[np.ndarray, " values"]
    ) -> Float[np.ndarray, "residuals values"]:
        """Their derivative."""
        return self._rows(values)[1]

    def add_to(
        self,
        hessian: Float[np.ndarray, "values values"],
        gradient: Float[np.ndarray, " values"],
        values: Float[np.ndarray, " values"],
    ) -> None:
        """Add the Hessian (Gauss-Newton) and the gradient of the energy at ``values``.

        What lights cost is concave, nowhere above its tangent: it has no part in the Hessian. The
        squares of its residuals would hold dark lights where they are, however much a photo wants
        them.
        """
        residuals, jacobian, concave = self._rows(values)
        curved = jacobian[~concave]
        hessian += curved.T @ curved
        gradient += jacobian.T @ residuals

    def concave(self, values: Float[np.ndarray, " values"]) -> Bool[np.ndarray, " residuals"]:
        """Which of the residuals are what lights cost."""
        return self._rows(values)[2]

    def _rows(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The residuals, their derivative, and which of them are concave."""
        radiance, fitted = self.lights.radiance(values), self.lights.fitted
        light = radiance[fitted]
        if not len(light):
            return np.zeros(0), np.zeros((0, len(values))), np.zeros(0, bool)
        residuals, by_light, concave = _of_radiance(light, self.scale, self.white is None)
        if self.white is not None:
            balance, by_radiance = _of_balance(radiance, self.white)
            residuals = np.concatenate([residuals, balance])
            by_light = np.concatenate([by_light, by_radiance[:, fitted]])
        jacobian = by_light.reshape(len(residuals), -1)  # one parameter per light and channel
        if self.lights.uniform:
            jacobian = np.einsum("rjc,jcp->rp", by_light, self.lights.jacobian(values))
            row = np.zeros(len(values))
            row[-CHANNELS:] = 1.0 / (CHANNELS * UNIFORM_SIGMA)
            residuals = np.append(residuals, row @ values - 1.0 / UNIFORM_SIGMA)
            jacobian = np.vstack([jacobian, row])
        curved = np.zeros(len(residuals) - len(concave), bool)
        return self.factor * residuals, self.factor * jacobian, np.append(concave, curved)


def _of_radiance(
    light: np.ndarray, scale: float, with_common: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The residuals (r,) of the ``light`` (j, 3), their derivative (r, j, 3), and which are what
    lights cost (r,); of the color of all light together only ``with_common``.
    """
    count, channels = light.shape
    level = light.mean(axis=1)
    # Harmonics, which the bench fits too, may be negative.
    sign = np.where(level < 0, -1.0, 1.0)
    level = np.abs(level)
    total = max(float(level.sum()), 1e-30)
    by_total = np.repeat(sign[:, None] / channels, channels, axis=1)  # (j, 3)
    by_level = np.eye(count)[:, :, None] * by_total  # (i, j, 3)

    all_light, by_all = _bent(
        *_ratio(
            light.sum(axis=0) @ AXES.T,
            np.broadcast_to(AXES[:, None, :], (2, count, channels)),
            total,
            by_total,
        )
    )
    base = level + FAINT / count * total
    by_base = by_level + FAINT / count * by_total
    along_and_across = np.eye(count)[:, None, :, None] * AXES[None, :, None, :]
    each, by_each = _bent(
        *_ratio(light @ AXES.T, along_and_across, base[:, None], by_base[:, None])
    )
    much, by_much = _ratio(level, by_level, base, by_base)
    own = each - much[:, None] * all_light
    by_own = (
        by_each - by_much[:, None] * all_light[:, None, None] - much[:, None, None, None] * by_all
    )
    share, by_share = _ratio(count * level, count * by_level, total, by_total)
    cost = _cost(share / count, by_share / count)
    parts = [
        _robust(own / OWN_SIGMA, by_own / OWN_SIGMA[:, None, None], OWN_CAUCHY_SCALE),
        *(
            [_robust(all_light / COMMON_SIGMA, by_all / COMMON_SIGMA[:, None, None])]
            if with_common
            else []
        ),
        (share / SHARE_SIGMA, by_share / SHARE_SIGMA),
        cost,
        (
            np.array([total / (count * scale) - 1.0]) / LEVEL_SIGMA,
            by_total[None] / (count * scale * LEVEL_SIGMA),
        ),
    ]
    return (
        np.concatenate([one.ravel() for one, _ in parts]),
        np.concatenate([slope.reshape(-1, count, channels) for _, slope in parts]),
        np.concatenate([np.full(part[0].size, part is cost) for part in parts]),
    )


def _of_balance(radiance: np.ndarray, white: WhiteBalance) -> tuple[np.ndarray, np.ndarray]:
    """The residuals (2,) of all lights (n, 3), those that are held too, against what something grey
    shows, and their derivative (2, n, 3).
    """
    mix = white.shares @ radiance
    level = max(float(mix.mean()), 1e-30)
    color, by_color = _ratio(
        mix @ AXES.T,
        AXES[:, None, :] * white.shares[:, None],
        level,
        np.repeat(white.shares[:, None] / len(mix), len(mix), axis=1),
    )
    sigma = white.sigma
    return _robust((color - white.color) / sigma, by_color / sigma[:, None, None])


def _ratio(
    value: np.ndarray, by_value: np.ndarray, base: np.ndarray | float, by_base: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """``value`` over ``base`` with its derivative (..., j, 3)."""
    result = value / base
    return result, (by_value - result[..., None, None] * by_base) / np.asarray(base)[
        ..., None, None
    ]


def _bent(color: np.ndarray, slope: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A ``color`` (..., 2) along the locus and across, with its derivative (..., 2, j, 3): how far
    from the locus it lies instead of how far across.
    """
    along, result, by_color = color[..., 0], color.copy(), slope.copy()
    result[..., 1] += BEND * along**2 - TILT * along
    by_color[..., 1, :, :] += (2 * BEND * along - TILT)[..., None, None] * slope[..., 0, :, :]
    return result, by_color


def _cost(share: np.ndarray, slope: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Residuals of which half the squares are what each light of this ``share`` costs, with
    derivative.
    """
    above = share + LEAST
    root = np.sqrt(2 * LIGHT_COST * np.log1p(above / SHINING))
    return root, (LIGHT_COST / (root * (SHINING + above)))[:, None, None] * slope


def _robust(
    residuals: np.ndarray, slopes: np.ndarray, scale: np.ndarray | float = CAUCHY_SCALE
) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (..., 2) of which half the squares are the Cauchy loss, with derivative
    (..., 2, j, 3).
    """
    ratio = residuals / scale
    root = np.sqrt(np.log1p(ratio**2))
    slope = np.where(root > 1e-6, np.abs(ratio) / ((1 + ratio**2) * np.maximum(root, 1e-6)), 1.0)
    return np.sign(ratio) * scale * root, slopes * slope[..., None, None]

"""Light from skin to skin: whether a photo shows any, asked once shape, light and color are roughly
there.

Every photograph has all of it, but a picture of direct light has none, and in soft light the prior
would find half of it there. So it is left out where the photo alone, whatever shape, light and
color do beside it, clearly prefers none to all of it, and does not say that there is some.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from facestage.fit.face.state import State
from facestage.fit.face.unknowns import INTERREFLECTION_MEAN
from facestage.fit.solve.covariance import covariance
from facestage.fit.stages.photo_descent import PhotoDescent

# Of the energy, by the strength that the photo shows instead of none. Pictures of direct light gain
# 0.1 to 2, photographs with it 8 to 31. Those that hardly say have it.
GAIN_MIN = 4.0
# Of the energy, by all of it instead of none. Pictures of direct light lose 3.5 to 100, and come
# out as well where it is kept; real photographs lose 4.4 at most but for one.
LOSS_MIN = 6.5


@dataclass(frozen=True)
class SkinToSkin:
    """How much light from skin to skin a photo shows without what is known before."""

    strength: float
    deviation: float  # standard; infinite where the photo does not say

    @property
    def gain(self) -> float:
        """Of the energy."""
        return 0.5 * (max(self.strength, 0.0) / self.deviation) ** 2

    @property
    def loss(self) -> float:
        """Of the energy, by all of it instead of none."""
        whole = INTERREFLECTION_MEAN
        return 0.5 * whole * (whole - 2.0 * self.strength) / self.deviation**2

    @property
    def joined(self) -> bool:
        """Whether it is fitted on."""
        return self.loss < LOSS_MIN or self.gain >= GAIN_MIN

    @property
    def words(self) -> str:
        """Why it is left out."""
        return (
            f"the photo shows {self.strength:.2f} ± {self.deviation:.2f} of it: all of it would "
            f"raise the energy by {self.loss:.1f}, none raises it by {self.gain:.1f}"
        )


def look_between(descent: PhotoDescent, scaled: State, seed: int) -> SkinToSkin:
    """What the photo of ``descent``, over all that may stand for such light, shows around
    ``scaled``, a state at the size of its phase.
    """
    evaluation = descent.evaluate(scaled, seed, everything=True)
    system = descent.system(scaled, evaluation)
    values, slope = descent.values(scaled), system.gradient
    at_bound = (values <= descent.low) & (slope > 0) | (values >= descent.high) & (slope < 0)
    where = descent.energy.layout.slices["interreflection"].start
    free = descent.active & (~at_bound | (np.arange(len(values)) == where))
    row = covariance(system.hessian, free)[where]
    # The priors' own share in it: a Gaussian of this one unknown.
    told = system.prior_hessian[where, where]
    information = 1.0 / row[where] - told
    if information <= 0:
        return SkinToSkin(INTERREFLECTION_MEAN, float("inf"))
    mean = values[where] - float(row @ np.where(free, slope, 0.0))
    strength = (mean / row[where] - told * INTERREFLECTION_MEAN) / information
    return SkinToSkin(float(strength), float(information**-0.5))

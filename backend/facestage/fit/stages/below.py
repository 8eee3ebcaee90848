"""Light below the skin: whether a photo shows any, asked before the phase whose pixels can.

It blurs what light draws on the skin by a millimetre or two: a phase of larger pixels does not see
it. Where the photo's energy falls as light begins to wander, half as far as published, it is
followed, and how far it goes is fitted; elsewhere, as in pictures of opaque skin or in soft light
without an edge, it is left out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from facestage.fit.energy.photo_term import PhotoTerm, common_energy
from facestage.fit.face.state import State

FIRST_STRENGTH = 0.5  # between none and the published
# Of the photo's energy: twice its standard deviation. Photographs of opaque skin gain -7 to 0.4, of
# skin with a random walk below it 0.3 (in soft light) to 3.
GAIN_MIN = 2.0
# Times as many light samples as the phase has: spreading light also lowers the noise of few.
SAMPLES_MORE = 4


@dataclass(frozen=True)
class Below:
    """What light below the skin would explain of a photo."""

    gain: float  # of the photo's energy

    @property
    def joined(self) -> bool:
        """Whether it is fitted."""
        return self.gain >= GAIN_MIN

    @property
    def words(self) -> str:
        """Why it is left out."""
        change = "raises" if self.gain < 0 else "lowers"
        return (
            f"half of what skin is published to have {change} the photo's energy by "
            f"{abs(self.gain):.1f}; to lower it by {GAIN_MIN:g} were more than noise"
        )


def look_below(photo: PhotoTerm, scaled: State, seed: int) -> Below:
    """What it would explain at ``scaled``, a state without it at the size of the photo's phase."""
    more = replace(photo, samples=SAMPLES_MORE * photo.samples)
    plain = more.evaluate(scaled, seed)
    weights = photo.weights(plain, photo.noise(plain))
    spread = more.with_skin(plain, replace(scaled, scattering=FIRST_STRENGTH))
    before, after = common_energy(plain, spread, weights)
    return Below(before - after)

"""Skin that changes: every frame is looked at once more, when all else is known."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from facestage.contract.arrays import Float, Int
from facestage.fit.face.state import State
from facestage.fit.sequence.actor import Actor
from facestage.fit.sequence.frames import Cut
from facestage.fit.sequence.skin.haemoglobin import Haemoglobin, haemoglobin
from facestage.fit.sequence.skin.leftover import left_over
from facestage.fit.sequence.skin.patches import Patches, PatchSeen


@dataclass(frozen=True, eq=False)
class Look:
    """A frame that shows the face, and where it is there."""

    index: int
    cut: Cut  # with SKIN_PX along the face
    state: State


@dataclass(frozen=True, eq=False)
class SkinChanges:
    """What changes."""

    haemoglobin: Haemoglobin

    @property
    def figures(self) -> dict[str, float]:
        """How much, beside how much of it may be noise."""
        blood = self.haemoglobin
        return {"haemoglobin": blood.change, "haemoglobin_noise": blood.noise}

    @property
    def words(self) -> str:
        """The same for people."""
        blood = self.haemoglobin
        found = "comes and goes" if blood.is_clear else "is not seen to change, and was left out"
        return (
            f"the skin's haemoglobin {found} ({blood.change:.2f} standard deviations of a "
            f"population, {blood.noise:.2f} of them noise)"
        )


def skin_changes(
    actor: Actor,
    looks: Iterable[Look],
    times: Float[np.ndarray, " frames"],
    shots: Int[np.ndarray, " frames"],
    keyframes: Sequence[int],
) -> SkinChanges:
    """Of a film's frames at ``times`` in seconds; ``keyframes``: those that the texture shows."""
    geometry = actor.geometry
    patches = Patches.of(geometry)
    seen: list[PatchSeen | None] = [None] * len(times)
    for look in looks:
        seen[look.index] = patches.seen(left_over(actor, look.cut, look.state))
    return SkinChanges(haemoglobin(geometry, patches, seen, times, shots, keyframes))

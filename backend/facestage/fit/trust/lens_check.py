"""Whether the landmarks contradict a focal length that is said to be known.

A lens that is too long or too short bends the face's perspective; the shape can follow only by
becoming unlike other faces. So the landmark phase is run again through other lenses, the face as
large in each: how much better the best of them is than the given one, in units of what misfit
remains, is an F statistic with one degree of freedom.

By the strength of perspective, one over the focal length, the energy is nearly a parabola. So a way
to longer or to shorter lenses ends at the first that is no better than the one before.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from facestage.fit.energy.landmark_term import LandmarkTerm
from facestage.fit.face.state import State
from facestage.fit.stages.photo_descent import PhotoDescent
from facestage.fit.trust.guard import landmark_energy

# Focal lengths that are tried, relative to the given one: ways to shorter and to longer ones.
WAYS = ((1 / 2, 1 / 4, 1 / 8), (2.0, 4.0))
# F beyond which the lens is in doubt: four standard deviations, as landmarks of different
# annotators disagree a little like another lens.
DOUBTFUL = 16.0
POSE_PARAMETERS = 6


@dataclass(frozen=True)
class LensCheck:
    """The best lens: its focal length relative to the given one, and the F statistic of that."""

    ratio: float
    statistic: float

    @property
    def doubtful(self) -> bool:
        """True when the landmarks speak against the given focal length."""
        return self.statistic > DOUBTFUL


def check_lens(
    descent_of: Callable[[State], PhotoDescent | None], start: State, seed: int
) -> LensCheck:
    """``descent_of`` gives the landmark phase's descent from a state with another camera;
    ``start`` is where it ended before.
    """
    descent = descent_of(start)
    if descent is None:
        return LensCheck(1.0, 0.0)
    given = landmark_energy(descent.energy, start)
    best, ratio = given, 1.0
    for way in WAYS:
        before = given
        for other in way:
            energy = _energy_through(descent_of, start, other, seed)
            if energy < best:
                best, ratio = energy, other
            if energy >= before:
                break
            before = energy
    # The priors count as observations: as many more residuals as there are coefficients, which
    # leaves the pose.
    observations = descent.energy.term(LandmarkTerm).observations
    freedom = max(2 * observations - POSE_PARAMETERS, 1)
    scale = max(2.0 * best / freedom, 1e-12)
    return LensCheck(ratio, max(2.0 * (given - best) / scale, 0.0))


def _energy_through(
    descent_of: Callable[[State], PhotoDescent | None], start: State, ratio: float, seed: int
) -> float:
    camera = replace(start.camera, focal_px=start.camera.focal_px * ratio)
    state = replace(start, camera=camera, translation=start.translation * [1.0, 1.0, ratio])
    descent = descent_of(state)
    assert descent is not None
    last = descent.last(state, seed)
    energy = landmark_energy(descent.energy, state if last is None else last.state)
    return energy if np.isfinite(energy) else np.inf

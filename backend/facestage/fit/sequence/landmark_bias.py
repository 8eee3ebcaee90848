"""What a network's landmarks are off by on one person, always: taken out, less is left to doubt.

Most of a landmark's error is the same in every frame (the network's corner of this mouth is not the
model's), and says nothing of how the face moves. The little that is left says how far to trust a
landmark from frame to frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.landmarks import Landmarks
from facestage.fit.energy.landmark_term import LANDMARK_SIGMA_SHARE, LandmarkTerm
from facestage.fit.face.state import State
from facestage.fit.given.face_areas import face_size_px
from facestage.fit.sequence.actor import Actor

# As many frames count as having had no bias.
PRIOR_COUNT = 0.5
SCALE_MIN = 0.2
FRAMES_MIN = 3


@dataclass(frozen=True, eq=False)
class LandmarkBias:
    """``offset`` (m, 2): found minus the model's, in sizes of the face and turned with the head;
    ``scale``: how far landmarks are off besides, over how far they are off on a single photo.
    """

    offset: Float[np.ndarray, "landmarks 2"]
    scale: float = 1.0

    @classmethod
    def none(cls, count: int) -> LandmarkBias:
        """Before anything is known of ``count`` landmarks."""
        return cls(np.zeros((count, 2)))

    @classmethod
    def of(
        cls, actor: Actor, landmarks: Sequence[Landmarks], states: Sequence[State]
    ) -> LandmarkBias:
        """From frames whose faces are where their ``states`` say; there may be none."""
        if not landmarks:
            return cls.none(0)
        found = np.array(
            [_residuals(actor, one, state) for one, state in zip(landmarks, states, strict=True)]
        )
        seen = np.isfinite(found).all(axis=2)
        count = seen.sum(axis=0)
        middle = np.zeros(found.shape[1:])
        middle[count > 0] = np.nanmedian(found[:, count > 0], axis=0)
        offset = middle * (count / (count + PRIOR_COUNT))[:, None]
        if len(landmarks) < FRAMES_MIN:
            return cls(offset)
        sigma = np.array(
            [LandmarkTerm(actor.geometry, one, LANDMARK_SIGMA_SHARE).sigma for one in landmarks]
        )
        left = np.abs(found - middle)[seen] / sigma[seen][:, None]
        return cls(offset, float(np.clip(1.4826 * np.median(left), SCALE_MIN, 1.0)))

    def taken_from(self, landmarks: Landmarks, state: State) -> Landmarks:
        """``landmarks`` of a frame without it."""
        points = landmarks.points - self.offset @ _head_axes(state).T * face_size_px(landmarks)
        return replace(landmarks, points=points)


def _residuals(actor: Actor, landmarks: Landmarks, state: State) -> np.ndarray:
    """(m, 2) found minus the model's, in the head's axes and sizes; NaN where hidden."""
    size = face_size_px(landmarks)
    placed = LandmarkTerm(actor.geometry, landmarks, LANDMARK_SIGMA_SHARE * size).at(state)
    result = (placed.points - placed.project(state)) @ _head_axes(state) / size
    result[~landmarks.counted] = np.nan
    return result


def _head_axes(state: State) -> np.ndarray:
    """(2, 2), its columns the head's x axis in the picture, and the one across it."""
    across = state.rotation[:2, 0] * [1.0, -1.0]
    x, y = across / max(float(np.linalg.norm(across)), 1e-9)
    return np.array([[x, -y], [y, x]])

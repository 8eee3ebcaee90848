"""Where head and face are in every frame: what a sequence is about."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from facestage.contract.arrays import Float

POSE = 6  # unknowns of a frame before its expression: turn about the model's origin, then metres


@dataclass(frozen=True, eq=False)
class Course:
    """Pose (model to camera; metres) and expression of F frames."""

    rotation: Float[np.ndarray, "frames 3 3"]
    translation: Float[np.ndarray, "frames 3"]
    expression: Float[np.ndarray, "frames expressions"]

    def __len__(self) -> int:
        return len(self.rotation)

    @property
    def model_to_camera(self) -> Float[np.ndarray, "frames 4 4"]:
        """The head's pose as rigid transforms."""
        result = np.tile(np.eye(4), (len(self), 1, 1))
        result[:, :3, :3], result[:, :3, 3] = self.rotation, self.translation
        return result

    def moved(self, step: Float[np.ndarray, "frames unknowns"]) -> Course:
        """After a ``step`` of every frame: turn and move of the head, then weights."""
        turn = Rotation.from_rotvec(step[:, :3]).as_matrix()
        return Course(
            turn @ self.rotation,
            self.translation + step[:, 3:POSE],
            self.expression + step[:, POSE:],
        )

"""Joints turned in a model that is bent by linear blend skinning, as shapes of a linear model.

Loper et al. 2015, "SMPL: A Skinned Multi-Person Linear Model", eq. 2-4 and 8-9; FLAME and GNM use
the same.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class Skeleton:
    """Joints of n vertices in the rest pose. ``parents[0]`` is not used; a parent comes before its
    children.

    ``corrective_joints``: from this joint on, the entries of R - I, row by row and joint after
    joint, are the features that ``correctives`` takes (9 for each joint).
    """

    joints: np.ndarray  # (J, 3) m
    parents: np.ndarray  # (J,) int
    weights: np.ndarray  # (n, J), each row sums to 1
    # (9 (J - corrective_joints), n, 3) m per unit of a feature; may have no rows
    correctives: np.ndarray
    corrective_joints: int = 0

    def pose(self, vertices: np.ndarray, rotations: np.ndarray) -> np.ndarray:
        """(n, 3) vertices with the joints turned by ``rotations`` (J, 3), rotation vectors in
        radians.
        """
        local = Rotation.from_rotvec(rotations).as_matrix()
        if len(self.correctives):
            features = (local[self.corrective_joints :] - np.eye(3)).ravel()
            vertices = vertices + np.tensordot(features, self.correctives, 1)
        turned, moved = [local[0]], [self.joints[0]]
        for joint in range(1, len(self.joints)):
            parent = int(self.parents[joint])
            moved.append(
                moved[parent] + turned[parent] @ (self.joints[joint] - self.joints[parent])
            )
            turned.append(turned[parent] @ local[joint])
        result = np.zeros_like(vertices)
        for joint, (rotation, place) in enumerate(zip(turned, moved, strict=True)):
            result += self.weights[:, [joint]] * (
                (vertices - self.joints[joint]) @ rotation.T + place
            )
        return result

    def shape(self, vertices: np.ndarray, joint: int, rotation: ArrayLike) -> np.ndarray:
        """(n, 3) offsets that turn one joint by a rotation vector (radians): exact at weight 1, a
        chord between.
        """
        rotations = np.zeros((len(self.joints), 3))
        rotations[joint] = rotation
        return self.pose(vertices, rotations) - vertices


# Full gaze sideways and up or down, well within what eyes do without the head; weights between are
# chords of the arc.
SIDEWAYS_DEGREES, VERTICAL_DEGREES = 30.0, 25.0


def gaze_rotations() -> dict[str, np.ndarray]:
    """Name -> rotation vector (3,) in radians of each eye looking down, in, out and up at full
    gaze.

    Names end in _L and _R, the subject's own sides; +X is the subject's left, +Y up, +Z forward.
    """
    angles = np.radians([VERTICAL_DEGREES, SIDEWAYS_DEGREES, 0.0])
    result: dict[str, np.ndarray] = {}
    for side, inward in (("L", -1.0), ("R", 1.0)):
        axes = {"Down": (1, 0), "In": (0, inward), "Out": (0, -inward), "Up": (-1, 0)}
        result |= {f"eyeLook{word}_{side}": angles * [x, y, 0.0] for word, (x, y) in axes.items()}
    return result


def gaze_shapes(
    skeleton: Skeleton, vertices: np.ndarray, left: int, right: int
) -> tuple[tuple[str, ...], list[np.ndarray]]:
    """Names and offsets (n, 3) of :func:`gaze_rotations`; ``left``, ``right``: the joints of the
    subject's eyes.
    """
    rotations = gaze_rotations()
    shapes = [
        skeleton.shape(vertices, left if name.endswith("_L") else right, rotation)
        for name, rotation in rotations.items()
    ]
    return tuple(rotations), shapes

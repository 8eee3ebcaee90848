"""Blender's Z-up world against the contract's frames. No bpy: plain matrices.

The stage's empty carries the stage frame in Blender's axes, so everything parented to it is placed
by :func:`local_matrix` relative to that empty, wherever the user has moved it.
"""

from __future__ import annotations

import numpy as np

STAGE, CAMERA = "stage", "camera"

# Where the light comes from, in the stage frame: left is the left of the picture.
LIGHT_DIRECTIONS = {
    "left": (-1.0, 0.15, 0.25),
    "right": (1.0, 0.15, 0.25),
    "top": (0.0, 1.0, 0.25),
    "bottom": (0.0, -1.0, 0.25),
    "front": (0.0, 0.0, 1.0),
}


def stage_to_blender() -> np.ndarray:
    """(3, 3) rotation: stage (x, y, z) becomes Blender (x, -z, y), so a face looks along -Y in
    Blender.

    The one place where the two conventions meet.
    """
    return np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def points_to_blender(points: np.ndarray) -> np.ndarray:
    """Points or directions (..., 3) of the stage frame in Blender's axes."""
    return np.asarray(points) @ stage_to_blender().T.astype(np.asarray(points).dtype)


def points_to_stage(points: np.ndarray) -> np.ndarray:
    """Points or directions (..., 3) in Blender's axes in the stage frame."""
    return np.asarray(points) @ stage_to_blender().astype(np.asarray(points).dtype)


def local_matrix(to_stage: np.ndarray, axes: str | np.ndarray) -> np.ndarray:
    """(4, 4) matrix of an object relative to the stage's empty.

    ``to_stage`` (4, 4) maps the object's contract frame to the stage frame. ``axes`` says which
    axes the object's own coordinates have: STAGE for a mesh stored in Blender's axes, CAMERA for a
    camera, whose frame is the same in Blender and in the contract, or a matrix (4, 4) from them to
    the contract frame.
    """
    return _homogeneous(stage_to_blender()) @ np.asarray(to_stage, np.float64) @ to_contract(axes)


def to_stage_matrix(local: np.ndarray, axes: str | np.ndarray) -> np.ndarray:
    """The inverse of :func:`local_matrix`: (4, 4) object frame to stage frame."""
    return (
        _homogeneous(stage_to_blender()).T
        @ np.asarray(local, np.float64)
        @ np.linalg.inv(to_contract(axes))
    )


def light_rotation(direction: np.ndarray, axis_x: np.ndarray) -> np.ndarray:
    """(3, 3) rotation of a Blender area light, which emits along its local -Z, in Blender's
    axes.
    """
    z = -np.asarray(direction, np.float64)
    x = np.asarray(axis_x, np.float64)
    return points_to_blender(np.stack([x, np.cross(z, x), z])).T


def to_contract(axes: str | np.ndarray) -> np.ndarray:
    """(4, 4) from an object's own coordinates to its contract frame."""
    if isinstance(axes, np.ndarray):
        return axes
    return _homogeneous(stage_to_blender()).T if axes == STAGE else np.eye(4)


def _homogeneous(rotation: np.ndarray) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    return matrix

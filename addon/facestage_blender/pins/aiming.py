"""The photo's camera before the first fit: where it sees the rig as the photo shows the face."""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np
from mathutils import Matrix

from facestage.contract.errors import InputError

from ..landmarks.editing import read_landmarks
from ..scene.frames import CAMERA, STAGE, local_matrix
from ..scene.several import shares_camera
from .pinning import Setting, anchors, sight_of
from .rig_shapes import current_vertices
from .solver import Guess, energy, solve, upright_pose

FORWARD = np.array([0.0, -1.0, 0.0])  # where a rig of a face model looks, in its own axes
HEAD_SHARE = 0.7  # of the picture's height, where nothing says how large the head is in it


def aim_camera(scene: bpy.types.Scene) -> None:
    """Put the photo's camera in front of the rig: by the photo's landmarks, or straight in front
    where it has none. Nothing is done where the camera is the user's, or something is fitted.
    """
    settings = scene.facestage
    fitted = settings.result or settings.pins
    if not settings.view_before or fitted or settings.keep_camera or shares_camera(scene):
        return
    try:
        setting = replace(Setting.of(scene), sliders=[])
        to_camera = _by_landmarks(scene, setting)
    except InputError:
        return  # what is missing is said by the step that needs it
    if to_camera is None:
        to_camera = _in_front(setting)
    pose = np.array(setting.rig.matrix_world) @ np.linalg.inv(to_camera)
    setting.camera.matrix_world = Matrix(pose.tolist())


def _by_landmarks(scene: bpy.types.Scene, setting: Setting) -> np.ndarray | None:
    """(4, 4) the rig's mesh to the camera's frame; None without landmarks that say it."""
    landmarks = read_landmarks(scene, setting.lens.width, setting.lens.height)
    if landmarks is None:
        return None
    indices, corners, weights = anchors(setting.rig, landmarks.scheme)
    sight = sight_of(landmarks, indices, setting.lens)
    shapes, rest = setting.shapes(corners, weights), np.zeros(0)
    scale = np.array(setting.rig.matrix_world.to_scale())
    start = Guess(upright_pose(shapes.at(rest), sight, scale), rest)
    found = solve(shapes, sight, start, rest)
    looks_here = (found.to_camera[:3, :3] @ FORWARD)[2] > 0
    believable = looks_here and np.isfinite(energy(shapes, sight, found, rest))
    return found.to_camera if believable else None


def _in_front(setting: Setting) -> np.ndarray:
    """(4, 4) the same for a camera that looks straight at the face, all of the head in sight."""
    world = np.array(setting.rig.matrix_world)
    turn = np.linalg.inv(local_matrix(np.eye(4), CAMERA)) @ local_matrix(np.eye(4), STAGE)
    to_camera = turn @ np.diag([*np.linalg.norm(world[:3, :3], axis=0), 1.0])
    points = current_vertices(setting.rig) @ to_camera[:3, :3].T
    low, high = points.min(axis=0), points.max(axis=0)
    pixels = HEAD_SHARE * min(setting.lens.height, setting.lens.width * 1.2)
    away = setting.lens.focal_px * (high[1] - low[1]) / pixels
    # In the picture's middle, by the ray through it.
    middle = np.array([setting.lens.width, setting.lens.height]) / 2 - setting.lens.principal_px
    across = middle * [1.0, -1.0] * away / setting.lens.focal_px
    to_camera[:3, 3] = [*across, -away] - (low + high) / 2
    return to_camera

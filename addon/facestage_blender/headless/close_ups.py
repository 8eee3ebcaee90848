"""Pictures of a fitted head from close by and from the side and behind, under a lamp of their own:
what a photo's own view and light hide.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from ..pictures.render import render_linear, srgb, temporarily
from ..rig.face_rig import require_rig

NAME = "Facestage Close-up"  # of the camera, the lamp and the world
BACKDROP = 0.03  # linear grey behind the head
# A white card that faces the lamp sends back KEY, and AMBIENT of the light from all around.
KEY, AMBIENT = 1.1, 0.25
KEY_DISTANCE, KEY_SIDE = 0.9, 0.25  # metres
LENS_MM, SENSOR_MM = 105.0, 36.0
EYE, FACE = "eye_left", "narrow_face"  # the rig's vertex groups


@dataclass(frozen=True)
class Shot:
    """One picture: degrees are of the head, 0 from the front, positive to its left and upwards."""

    caption: str
    aim: str
    width: float  # of what is shown, metres
    azimuth: float
    elevation: float = 0.0
    # where the lamp stands, seen from the camera
    lamp_azimuth: float = -35.0
    lamp_elevation: float = 35.0


SHOTS = (
    Shot("eye", "eye", 0.055, 12.0),
    Shot("mouth", "mouth", 0.085, 8.0),
    Shot("cheek, raking light", "cheek", 0.085, 35.0, lamp_azimuth=-82.0, lamp_elevation=8.0),
    Shot("ear and neck", "ear", 0.19, 75.0),
    Shot("three-quarter", "head", 0.34, 40.0, 4.0),
    Shot("back", "head", 0.36, 150.0, 6.0),
)


def close_ups(scene: bpy.types.Scene, size: int, samples: int) -> dict[str, np.ndarray]:
    """Caption -> sRGB picture (size, size, 3) in 0..1 from Cycles.

    Leaves the scene as it was. Shots of what the rig does not name (a mesh of the user's has no
    regions) are left out.
    """
    rig = require_rig(scene)
    aims = _aims(rig)
    pictures = {}
    with _studio(scene, size) as (camera, lamp):
        for shot in SHOTS:
            if shot.aim not in aims:
                continue
            _stand(rig, camera, lamp, shot, aims[shot.aim])
            pixels = render_linear(scene, samples, denoise=True)
            pictures[shot.caption] = srgb(pixels[..., :3] + BACKDROP * (1 - pixels[..., 3:]))
    return pictures


def _aims(rig: bpy.types.Object) -> dict[str, np.ndarray]:
    """What shots look at: points (3,) of the rig's own axes, x to the head's left, -y forward."""
    points, groups = _points_and_groups(rig)
    if FACE not in groups:
        return {}
    face = points[groups[FACE]]
    low, high = face.min(axis=0), face.max(axis=0)
    width, height = (high - low)[[0, 2]]
    middle = 0.5 * (low + high)

    def skin(x: float, z: float) -> np.ndarray:
        """The face's point in front of x, z."""
        return np.array(face[np.hypot(face[:, 0] - x, face[:, 2] - z).argmin()])

    head = 0.5 * (points.min(axis=0) + points.max(axis=0))
    aims = {
        "mouth": skin(middle[0], low[2] + 0.3 * height),
        "cheek": skin(middle[0] + 0.3 * width, low[2] + 0.5 * height),
        "head": np.array([head[0], head[1], middle[2]]),
    }
    level = np.abs(points[:, 2] - (low[2] + 0.62 * height)) < 0.2 * height
    beside = points[level & (points[:, 0] > middle[0])]
    ear = beside[beside[:, 0].argmax()]
    aims["ear"] = np.array([ear[0], ear[1], ear[2] - 0.4 * height])
    if EYE in groups:
        ball = points[groups[EYE]]
        aims["eye"] = np.array([*ball.mean(axis=0)[:1], ball[:, 1].min(), ball[:, 2].mean()])
    return aims


def _points_and_groups(rig: bpy.types.Object) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """(n, 3) the rig's vertices under its shape keys, and the vertices of each group that shots
    look at.
    """
    evaluated = rig.evaluated_get(bpy.context.evaluated_depsgraph_get())
    points = np.empty(3 * len(evaluated.data.vertices), np.float32)
    evaluated.data.vertices.foreach_get("co", points)
    wanted = {group.index: group.name for group in rig.vertex_groups if group.name in (EYE, FACE)}
    members: dict[str, list[int]] = {}
    for vertex in rig.data.vertices:
        for entry in vertex.groups:
            if entry.group in wanted:
                members.setdefault(wanted[entry.group], []).append(vertex.index)
    return points.reshape(-1, 3), {name: np.array(each) for name, each in members.items()}


def _stand(
    rig: bpy.types.Object,
    camera: bpy.types.Object,
    lamp: bpy.types.Object,
    shot: Shot,
    aim: np.ndarray,
) -> None:
    """Put camera and lamp where ``shot`` has them."""
    distance = shot.width * LENS_MM / SENSOR_MM
    camera.matrix_world = rig.matrix_world @ _looking_at(
        aim, shot.azimuth, shot.elevation, distance
    )
    lamp.matrix_world = rig.matrix_world @ _looking_at(
        aim, shot.azimuth + shot.lamp_azimuth, shot.lamp_elevation, KEY_DISTANCE
    )


def _looking_at(aim: np.ndarray, azimuth: float, elevation: float, distance: float) -> Matrix:
    """Where something that looks along its own -Z stands to see ``aim`` from there."""
    turn, rise = math.radians(azimuth), math.radians(elevation)
    back = np.array(
        [math.sin(turn) * math.cos(rise), -math.cos(turn) * math.cos(rise), math.sin(rise)]
    )
    right = np.array([math.cos(turn), math.sin(turn), 0.0])
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([right, np.cross(back, right), back], axis=1)
    matrix[:3, 3] = aim + distance * back
    return Matrix(matrix.tolist())


@contextmanager
def _studio(
    scene: bpy.types.Scene, size: int
) -> Iterator[tuple[bpy.types.Object, bpy.types.Object]]:
    """A camera and a lamp of their own and light from all around, in place of the scene's."""
    camera = bpy.data.objects.new(NAME, bpy.data.cameras.new(NAME))
    lamp = bpy.data.objects.new(NAME, bpy.data.lights.new(NAME, "AREA"))
    world = bpy.data.worlds.new(NAME)
    camera.data.lens, camera.data.sensor_width, camera.data.clip_start = LENS_MM, SENSOR_MM, 0.01
    # A square of power P sends P / (pi d^2) to a card at the distance d, which sends back a pi-th.
    lamp.data.shape, lamp.data.size = "SQUARE", KEY_SIDE
    lamp.data.energy = KEY * (math.pi * KEY_DISTANCE) ** 2
    if world.node_tree is None:  # before Blender 5.0 a new world has no nodes
        world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (*(AMBIENT,) * 3, 1.0)
    lights = [each for each in scene.objects if each.type == "LIGHT"]
    render = scene.render
    values: list[tuple[Any, str, Any]] = [
        (scene, "camera", camera),
        (scene, "world", world),
        (render, "resolution_x", size),
        (render, "resolution_y", size),
        (render, "resolution_percentage", 100),
        (render, "use_border", False),
        *((each, "hide_render", True) for each in lights),
    ]
    try:
        for each in (camera, lamp):
            scene.collection.objects.link(each)
        with temporarily(values):
            yield camera, lamp
    finally:
        view, light = camera.data, lamp.data
        for each in (camera, lamp):
            bpy.data.objects.remove(each)
        bpy.data.cameras.remove(view)
        bpy.data.lights.remove(light)
        bpy.data.worlds.remove(world)

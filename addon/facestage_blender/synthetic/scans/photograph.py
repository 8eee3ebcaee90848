"""Photographs of a scanned head by Cycles, with the scan where the camera saw it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from facestage.contract.camera import Camera
from facestage.contract.case_files import CAMERA, LINEAR_PHOTO, PHOTO, SCAN
from facestage.contract.files.atomic import atomic_folder
from facestage.contract.files.storage import write_json
from facestage.contract.scan import MILLIMETRES, Scan

from ...pictures.render import render_linear, save_exr, save_png, srgb
from ...scene.camera import ensure_camera, write_camera
from .head import ScannedHead
from .light import Surroundings, light_world
from .skin import SkinMaps, skin_material

DISTANCE_MM = 900.0  # from the camera to the middle of the face
FOCAL_SHARE = 2.2  # focal length over the picture's side: a portrait lens, 79 mm on film
MIDDLE_GREY = 0.18  # linear, what a camera's meter makes of what it looks at


@dataclass(frozen=True)
class Pose:
    """How the head is turned: to the picture's right and downwards, in degrees."""

    yaw: float = 0.0
    pitch: float = 0.0

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3) from the head's frame to the camera's axes."""
        y, p = np.radians(self.yaw), np.radians(self.pitch)
        about_y = np.array([[np.cos(y), 0, np.sin(y)], [0, 1, 0], [-np.sin(y), 0, np.cos(y)]])
        about_x = np.array([[1, 0, 0], [0, np.cos(p), -np.sin(p)], [0, np.sin(p), np.cos(p)]])
        return np.asarray(about_x @ about_y)


@dataclass(frozen=True)
class Quality:
    """Side of the picture in pixels, samples per pixel, and their seed."""

    size: int
    samples: int
    seed: int = 0

    @property
    def camera(self) -> Camera:
        """The lens of every photo of this size."""
        return Camera.default(self.size, self.size, FOCAL_SHARE * self.size)


@dataclass(frozen=True)
class Shot:
    """What a photo is taken with, and in."""

    light: Surroundings
    maps: SkinMaps
    quality: Quality


def posed(
    vertices: np.ndarray, middle: np.ndarray, pose: Pose, distance: float = DISTANCE_MM
) -> np.ndarray:
    """Vertices (n, 3) of the head's frame in the camera's, with ``middle`` (3,) on its axis; mm."""
    return np.asarray((vertices - middle) @ pose.rotation.T + [0.0, 0.0, -distance])


def picture_of(
    scene: bpy.types.Scene, head: ScannedHead, vertices: np.ndarray, shot: Shot
) -> np.ndarray:
    """(h, w, 3) linear: the head with its vertices (n, 3), mm in the camera's frame, before its
    surroundings. Raises InputError.
    """
    mesh = head.mesh
    mesh.vertices.foreach_set("co", (vertices / MILLIMETRES).astype(np.float32).ravel())
    mesh.materials.clear()
    mesh.materials.append(skin_material(shot.maps))
    mesh.update()
    for item in list(scene.collection.all_objects):
        bpy.data.objects.remove(item)
    scene.collection.objects.link(bpy.data.objects.new("Scan", mesh))
    camera = ensure_camera(scene, scene.collection)
    # The contract's camera frame is Blender's own, so the world is the camera's.
    camera.matrix_world = Matrix()
    write_camera(scene, camera.data, shot.quality.camera)
    light_world(scene, shot.light)
    samples, seed = shot.quality.samples, shot.quality.seed
    return render_linear(scene, samples, seed=seed, denoise=True, background=True)[..., :3]


def photograph_scan(
    scene: bpy.types.Scene,
    head: ScannedHead,
    face: np.ndarray,
    pose: Pose,
    shot: Shot,
    folder: Path,
) -> None:
    """Photograph a head whose ``face`` are these vertices into ``folder``: photo.png, photo.exr,
    camera.json and scan.npz. Raises InputError.
    """
    camera = shot.quality.camera
    vertices = posed(head.vertices, middle_of(head.vertices[face]), pose)
    pixels = picture_of(scene, head, vertices, shot)
    # The pixels where the face lies; those that it hides itself show skin too.
    x, y = np.clip(camera.project(vertices[face]), 0, camera.width - 1).astype(int).T
    picture = exposed(pixels, (y, x))
    with atomic_folder(folder) as unfinished:
        save_png(unfinished / PHOTO, srgb(picture))
        save_exr(unfinished / LINEAR_PHOTO, picture)
        write_json(unfinished / CAMERA, camera.to_json())
        Scan(vertices, head.triangles, face).save(unfinished / SCAN)


def exposed(pixels: np.ndarray, where: Any) -> np.ndarray:
    """Linear pixels (h, w, 3) as bright as a camera makes them that meters what lies ``where`` (an
    index of pixels).
    """
    return pixels * (MIDDLE_GREY / max(float(pixels[where].mean()), 1e-9))


def middle_of(points: np.ndarray) -> np.ndarray:
    """(3,) middle of the box around points (n, 3)."""
    return np.asarray(0.5 * (points.min(axis=0) + points.max(axis=0)))

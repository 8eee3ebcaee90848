"""A photo whose truth is known: a seeded person of the face model, rendered by Cycles with direct light.

The skin has texture that no albedo coefficient can explain, and the landmarks have noise, as in life.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from facestage.contract.camera import Camera
from facestage.contract.errors import InputError
from facestage.contract.face_model import FaceModel
from facestage.contract.light_stage import LightStage, fibonacci_stage
from facestage.contract.storage import write_arrays, write_json

from . import frames
from .camera import ensure_camera, write_camera
from .material import set_textures, texture_image
from .render import render_linear, save_exr, save_png, srgb
from .rig import build_rig, set_weights
from .stage import build_stage, facestage_collection
from .texture import paint_vertices
from .write_back import place

SIZE, FOCAL_PX, DISTANCE = 256, 600.0, 0.78  # pixels, pixels, metres
ALBEDO_SIZE, SPECULAR_SIZE = 1024, 32
LANDMARK_NOISE_PX = 1.0
TEXTURE_MISMATCH = 0.05  # relative standard deviation of the albedo that the model cannot explain
BRIGHTEST = 0.85  # linear value of the photo's brightest skin but for 1 %
BACKGROUND = 0.03
EXPRESSION = {"mouthSmileLeft": 0.55, "mouthSmileRight": 0.5, "jawOpen": 0.12, "browInnerUp": 0.35}


@dataclass(frozen=True)
class Person:
    """The truth behind a synthetic photo, as plain arrays of the contract."""

    identity: np.ndarray
    expression: np.ndarray
    albedo: np.ndarray  # (S, S, 3) texture
    specular: np.ndarray  # (s, s) c_spec
    roughness: float
    model_to_camera: np.ndarray
    stage: LightStage  # stage frame: centred on the face, parallel to the camera


def random_person(model: FaceModel, seed: int) -> Person:
    """A person of the model: shape, expression, skin, pose and light drawn from ``seed``."""
    rng = np.random.default_rng(seed)
    identity = np.clip(0.8 * rng.normal(size=len(model.identity_names)), -2, 2)
    expression = np.array([EXPRESSION.get(name, 0.0) for name in model.expression_names])
    delta = np.clip(0.6 * rng.normal(size=len(model.albedo_basis)), -1.5, 1.5)
    albedo = paint_vertices(model.albedo(delta), model.triangles, model.uvs, model.triangle_uvs, ALBEDO_SIZE)
    mismatch = sum(_noise(rng, ALBEDO_SIZE, cells) for cells in (24, 96, 384)) / np.sqrt(3)
    albedo = np.clip(albedo * (1 + TEXTURE_MISMATCH * mismatch[..., None]), 0.005, 0.95)
    specular = np.clip(0.75 + 0.25 * _noise(rng, SPECULAR_SIZE, 6), 0.2, 1.4)
    yaw, pitch, roll = np.radians([14.0, 4.0, -3.0])
    pose = np.eye(4)
    pose[:3, :3] = _turn(2, roll) @ _turn(0, pitch) @ _turn(1, yaw)
    pose[:3, 3] = (0.012, -0.006, -DISTANCE)
    stage = fibonacci_stage()
    radiance = np.zeros((len(stage), 3))
    for light, power in zip((3, 6, 11, 14, 1), (10.0, 5.0, 3.0, 2.0, 1.5), strict=True):
        radiance[light] = power * (1 + 0.15 * rng.uniform(-1, 1, 3))
    return Person(identity, expression, albedo, specular, 0.42, pose, stage.with_radiance(radiance))


def render_person(
    scene: bpy.types.Scene,
    model: FaceModel,
    person: Person,
    folder: Path,
    samples: int = 128,
    seed: int = 0,
    size: int = SIZE,
) -> None:
    """Photograph a person into ``folder``: photo.png/.exr, landmarks.json, camera.json and truth.npz."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"Cannot write the folder '{folder}': {error.strerror}; choose another.") from error
    camera = Camera.default(size, size, FOCAL_PX * size / SIZE)
    camera_to_stage = np.eye(4)
    camera_to_stage[:3, 3] = -person.model_to_camera[:3, 3]
    empty = build_stage(scene, person.stage)
    rig = build_rig(scene, model, "default", empty)
    set_weights(
        rig,
        dict(zip(model.identity_names, person.identity, strict=True)),
        dict(zip(model.expression_names, person.expression, strict=True)),
    )
    images = texture_image("True Albedo", person.albedo), texture_image("True Specular", person.specular)
    set_textures(rig, *images, roughness=person.roughness)
    view = ensure_camera(scene, facestage_collection(scene))
    write_camera(scene, view.data, camera)
    place(empty, rig, camera_to_stage @ person.model_to_camera, frames.STAGE)
    place(empty, view, camera_to_stage, frames.CAMERA)

    pixels = render_linear(scene, samples, direct_only=True, seed=seed)
    coverage = pixels[..., 3:] > 0.99
    exposure = BRIGHTEST / float(np.percentile(pixels[..., :3][coverage[..., 0]], 99))
    stage = person.stage.with_radiance(person.stage.radiance * exposure)
    build_stage(scene, stage)
    picture = exposure * pixels[..., :3] + BACKGROUND * (1 - pixels[..., 3:])
    save_png(folder / "photo.png", srgb(picture))
    save_exr(folder / "photo.exr", picture)
    write_json(folder / "camera.json", camera.to_json())
    vertices = model.shape(person.identity, person.expression) @ person.model_to_camera[:3, :3].T
    vertices = vertices + person.model_to_camera[:3, 3]
    _write_landmarks(scene, model, vertices, camera, folder, seed)
    lights = stage.transformed(np.linalg.inv(camera_to_stage))
    write_arrays(
        folder / "truth.npz",
        {
            "vertices": vertices.astype(np.float32), "identity": person.identity, "expression": person.expression,
            "light_position": lights.position, "light_direction": lights.direction, "light_corners": lights.corners,
            "light_radiance": lights.radiance, "albedo": person.albedo.astype(np.float32),
            "specular": person.specular, "roughness": np.array(person.roughness),
            "model_to_camera": person.model_to_camera, "mask": coverage[..., 0],
        },
    )  # fmt: skip


def _write_landmarks(
    scene: bpy.types.Scene, model: FaceModel, vertices: np.ndarray, camera: Camera, folder: Path, seed: int
) -> None:
    """The 68 true landmarks with noise; one is visible when nothing lies between it and the camera."""
    corners, weights = model.landmark_vertices("ibug68")
    points = np.einsum("mi,mix->mx", weights, vertices[corners])
    noise = LANDMARK_NOISE_PX * np.random.default_rng(seed + 1).normal(size=(len(points), 2))
    graph = bpy.context.evaluated_depsgraph_get()
    eye = np.array(scene.camera.matrix_world)
    visible = []
    for point in points @ eye[:3, :3].T + eye[:3, 3]:
        path = point - eye[:3, 3]
        distance = float(np.linalg.norm(path))
        hit = scene.ray_cast(graph, eye[:3, 3].tolist(), (path / distance).tolist(), distance=distance - 0.004)[0]
        visible.append(not hit)
    data = {"scheme": "ibug68", "points": camera.project(points) + noise, "visible": visible}
    write_json(folder / "landmarks.json", data)


def _noise(rng: np.random.Generator, size: int, cells: int) -> np.ndarray:
    """(size, size) noise of unit variance, linear between random values at ``cells`` x ``cells`` knots."""
    knots = rng.normal(size=(cells + 1, cells + 1))
    at = (np.arange(size) + 0.5) / size * cells
    low = np.minimum(at.astype(int), cells - 1)
    share = at - low
    rows = knots[low] * (1 - share[:, None]) + knots[low + 1] * share[:, None]
    smooth = rows[:, low] * (1 - share) + rows[:, low + 1] * share
    return smooth / smooth.std()


def _turn(axis: int, angle: float) -> np.ndarray:
    """(3, 3) right-handed rotation about a coordinate axis."""
    a, b = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[a, a] = matrix[b, b] = np.cos(angle)
    matrix[a, b], matrix[b, a] = -np.sin(angle), np.sin(angle)
    return matrix

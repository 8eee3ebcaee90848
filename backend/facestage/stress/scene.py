"""Small synthetic photographs with known truth, rendered with the fit's own forward model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from facestage.contract.camera import Camera
from facestage.contract.case_files import LINEAR_PHOTO, TRUTH
from facestage.contract.face_model import FaceModel
from facestage.contract.files.color import linear_to_srgb
from facestage.contract.files.storage import write_arrays
from facestage.contract.job import Job
from facestage.contract.landmarks import Landmarks
from facestage.contract.light_stage import LightStage, fibonacci_stage
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import SPECULAR_MEAN
from facestage.fit.forward.lamp_derivatives import AXES
from facestage.fit.forward.shading import ForwardModel, Image, Surface
from facestage.images.opencv import opencv
from facestage.models.registry import load_model
from facestage.render.variant import start_renderer

SIDE_PX, FOCAL_PER_SIDE, DISTANCE = 112, 2.5, 0.6
LIGHTS = 12
# The face's bright skin (95th percentile) in the photo.
EXPOSURE = 0.6
BACKGROUND = 0.12
SAMPLES, PIXELS_AT_ONCE = 32, 100_000
LANDMARK_NOISE_PX = 0.3
# A coarse specular map keeps the cases cheap; its own case takes the usual size.
SPECULAR_SIZE = 8


@dataclass(frozen=True)
class Scene:
    """The truth: a face, its camera and its light.

    ``stage`` is in the stage frame, its radiance the true one.
    """

    model: FaceModel
    camera: Camera
    rotation: np.ndarray  # (3, 3) model to camera
    translation: np.ndarray  # (3,) m
    identity: np.ndarray  # (k,)
    expression: np.ndarray  # (e,)
    albedo: np.ndarray  # (d,)
    stage: LightStage
    roughness: float = 0.4
    c_spec: float = 0.8
    # (4, 4); None: centred on the face, axes parallel to the camera's
    camera_to_stage: np.ndarray | None = None
    scattering: float = 0.0  # how far light wanders below the skin

    @property
    def stage_in_camera(self) -> LightStage:
        """The lights in the camera frame."""
        if self.camera_to_stage is None:
            matrix = np.eye(4)
            matrix[:3, 3] = self.translation
            return self.stage.transformed(matrix)
        return self.stage.transformed(np.linalg.inv(self.camera_to_stage))

    @property
    def state(self) -> State:
        """The truth as the fit's parameters, its lights held."""
        return State(
            self.rotation,
            self.translation,
            self.camera,
            self.identity,
            self.expression,
            np.zeros(0),
            np.zeros((len(self.stage), AXES)),
            self.albedo,
            self.roughness,
            np.full((4, 4), self.c_spec),
            scattering=self.scattering,
        )


def plain_scene(
    model: FaceModel | None = None, seed: int = 1, lights: int = LIGHTS, side_px: int = SIDE_PX
) -> Scene:
    """A face turned a little, its mouth a little open, under a key light, a fill light and dim
    others.
    """
    model = load_model("default") if model is None else model
    random = np.random.default_rng(seed)
    identity = np.clip(random.normal(0.0, 0.7, len(model.identity_names)), -2, 2)
    expression = np.zeros(len(model.expression_names))
    expression[random.permutation(len(expression))[:6]] = 0.3
    albedo = random.normal(0.0, 0.5, len(model.albedo_basis))
    stage = fibonacci_stage(lights)
    level = random.uniform(0.02, 0.15, lights)
    # A key light from the upper left, a fill light from the right.
    level[np.argmax(stage.position @ [-0.5, 0.5, 0.7])] = 1.0
    level[np.argmax(stage.position @ [0.7, 0.1, 0.6])] = 0.5
    color = 1.0 + 0.12 * random.uniform(-1, 1, (lights, 3))
    return Scene(
        model=model,
        camera=Camera.default(side_px, side_px, FOCAL_PER_SIDE * side_px),
        rotation=turn(yaw=12, pitch=-4),
        translation=np.array([0.005, -0.004, -DISTANCE]),
        identity=identity,
        expression=expression,
        albedo=albedo,
        stage=stage.with_radiance(level[:, None] * color),
    )


def turn(yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0) -> np.ndarray:
    """(3, 3) rotation by degrees: about the vertical, then up and down, then in the image."""
    return Rotation.from_euler("zxy", [roll, pitch, yaw], degrees=True).as_matrix()


def render(
    scene: Scene, background: np.ndarray | float = BACKGROUND, exposure: float = EXPOSURE
) -> np.ndarray:
    """(h, w, 3) linear photo, exposed so that bright skin has the value ``exposure``."""
    color, skin = _radiance(scene)
    covered = np.isfinite(color).all(axis=2)
    return np.where(covered[..., None], _gain(color[skin], exposure) * color, background)


def exposed(scene: Scene, exposure: float = EXPOSURE) -> Scene:
    """The scene with its light as bright as :func:`render` makes it."""
    color, skin = _radiance(scene)
    return with_stage(scene, radiance=_gain(color[skin], exposure) * scene.stage.radiance)


def _gain(skin: np.ndarray, exposure: float) -> float:
    bright = float(np.percentile(skin, 95)) if skin.size else 0.0
    return exposure / bright if bright > 0 else 1.0


def _radiance(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """(h, w, 3) radiance of the head, NaN where there is none, and (h, w) bool, where it shows
    fitted skin.
    """
    start_renderer("cpu")
    geometry = FaceGeometry(scene.model)
    stage, state, camera = scene.stage_in_camera, scene.state, scene.camera
    lights = LightParameters(np.zeros(len(stage), bool), stage.radiance, uniform=False)
    forward = ForwardModel(geometry, lights)
    y, x = np.mgrid[: camera.height, : camera.width]
    pixels = np.stack([x.ravel(), y.ravel()], axis=1) + 0.5
    color = np.full((camera.height, camera.width, 3), np.nan)
    skin = np.zeros(color.shape[:2], bool)
    for start in range(0, len(pixels), PIXELS_AT_ONCE):
        image = _shade(forward, state, stage, pixels[start : start + PIXELS_AT_ONCE])
        column, row = image.surface.pixels.astype(int).T
        color[row, column] = image.color
        skin[row, column] = geometry.fitted[image.surface.triangle]
    return color, skin


def _shade(forward: ForwardModel, state: State, stage: LightStage, pixels: np.ndarray) -> Image:
    surface: Surface = forward.surface(state, pixels)
    return forward.shade(
        state, surface, forward.light_terms(state, surface, stage, SAMPLES, seed=12345)
    )


def project_landmarks(scene: Scene, noise_px: float = LANDMARK_NOISE_PX) -> Landmarks:
    """The 68 landmarks of the true face with a little noise; those on the far side are marked
    hidden.
    """
    geometry, state = FaceGeometry(scene.model), scene.state
    vertices, weights = scene.model.landmark_vertices("ibug68")
    corners = geometry.new_index[vertices]
    shape = geometry.at(state)
    normals, _ = geometry.vertex_normals(shape)
    points = np.einsum("mi,mix->mx", weights, shape[corners]) @ state.rotation.T + state.translation
    facing = np.einsum("mx,mx->m", normals[corners[:, 0]] @ state.rotation.T, points) < 0
    noise = noise_px * np.random.default_rng(7).normal(size=(len(points), 2))
    return Landmarks("ibug68", state.camera.project(points) + noise, facing)


def write_job(
    folder: Path, scene: Scene, photo: np.ndarray, landmarks: Landmarks | None = None
) -> Job:
    """The job of fitting ``photo`` (h, w, 3) linear, with the scene's camera and stage; truth
    beside it.
    """
    path = folder / LINEAR_PHOTO
    write_float_exr(path, photo)
    return job_of(folder, scene, path, landmarks)


def write_float_exr(path: Path, photo: np.ndarray) -> None:
    """Write (h, w, 3) as 32-bit EXR: NaN, infinity and any radiance stay what they are."""
    opencv().imwrite(str(path), np.ascontiguousarray(photo[..., ::-1], np.float32))


def write_png(path: Path, photo: np.ndarray, alpha: np.ndarray | None = None) -> None:
    """Write (h, w, 3) linear as an 8-bit sRGB PNG that clips at 1; ``alpha`` (h, w) bool masks."""
    from PIL import Image

    pixels = np.round(255 * linear_to_srgb(np.clip(photo, 0, 1))).astype(np.uint8)
    if alpha is not None:
        pixels = np.dstack([pixels, np.where(alpha, 255, 0).astype(np.uint8)])
    Image.fromarray(pixels).save(path)


def job_of(folder: Path, scene: Scene, photo: Path, landmarks: Landmarks | None = None) -> Job:
    """The job of fitting the image file ``photo``; the scene's model and truth are written into
    ``folder``.
    """
    model = "default"
    if scene.model is not load_model("default"):
        scene.model.save(folder / "model.npz")
        model = f"npz:{folder / 'model.npz'}"
    vertices = (
        scene.model.shape(scene.identity, scene.expression) @ scene.rotation.T + scene.translation
    )
    write_arrays(folder / TRUTH, {"vertices": vertices.astype(np.float32)}, compress=False)
    return Job(
        image=photo,
        model=model,
        landmarks=landmarks or project_landmarks(scene),
        camera=scene.camera,
        stage=scene.stage,
        camera_to_stage=scene.camera_to_stage,
        truth=folder / TRUTH,
        device="cpu",
        initial={"specular": np.full((SPECULAR_SIZE, SPECULAR_SIZE), SPECULAR_MEAN)},
    )


def with_stage(scene: Scene, **arrays: np.ndarray) -> Scene:
    """The scene with arrays of its stage replaced."""
    return replace(scene, stage=replace(scene.stage, **arrays))

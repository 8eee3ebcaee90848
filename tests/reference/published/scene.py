"""Any face model before a camera under a few lights: its picture, and a photo with landmarks for a
small fit.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from facestage.contract.camera import Camera
from facestage.contract.face_model import FaceModel
from facestage.contract.job import Job
from facestage.contract.landmarks import Landmarks
from facestage.contract.light_stage import fibonacci_stage
from facestage.contract.result import Result
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.face.state import State
from facestage.fit.forward.shading import ForwardModel
from facestage.render.variant import start_renderer
from reference.synthetic_scene import Scene

RADIANCE = np.array([[9, 8, 7], [2, 2, 3], [6, 7, 8], [1, 1, 1], [3, 2, 2], [4, 5, 6]], float)


def fewer_modes(model: FaceModel, identity: int, expressions: tuple[str, ...]) -> FaceModel:
    """The model with its first identity modes, the named expressions and eight colors: quick to
    fit.
    """
    rows = [model.expression_names.index(name) for name in expressions]
    return replace(
        model,
        identity_names=model.identity_names[:identity],
        identity_basis=model.identity_basis[:identity],
        expression_names=expressions,
        expression_basis=model.expression_basis[rows],
        expression_prior=tuple("box" if box else "gaussian" for box in model.expression_box[rows]),
        albedo_basis=model.albedo_basis[:8],
    )


def model_scene(
    model: FaceModel,
    side: int = 96,
    yaw: float = 0.2,
    identity: np.ndarray | None = None,
    expression: np.ndarray | dict[str, float] | None = None,
    distance: float = 0.6,
    zoom: float = 1.0,
) -> Scene:
    """The model turned by ``yaw`` radians, ``distance`` m from the camera; the face fills half of
    it at ``zoom`` 1.
    """
    weights = np.zeros(len(model.expression_names))
    if isinstance(expression, dict):
        for name, weight in expression.items():
            weights[model.expression_names.index(name)] = weight
    elif expression is not None:
        weights = expression
    start_renderer("cpu")
    geometry = FaceGeometry(model)
    lights = LightParameters(np.ones(len(RADIANCE), bool), np.zeros_like(RADIANCE), False)
    translation = np.array([0.004, -0.006, -distance])
    matrix = np.eye(4)
    matrix[:3, 3] = translation
    state = State(
        rotation=Rotation.from_rotvec([0.06, yaw, -0.03]).as_matrix(),
        translation=translation,
        camera=Camera(side, side, zoom * 2.0 * side * distance / 0.6, (0.5 * side, 0.5 * side)),
        identity=np.zeros(len(model.identity_names)) if identity is None else identity,
        expression=weights,
        lights=lights.from_radiance(RADIANCE),
        light_position=np.zeros((len(RADIANCE), 2)),
        albedo=np.zeros(len(model.albedo_basis)),
        roughness=0.4,
        specular=np.full((8, 8), 0.7),
    )
    stage = fibonacci_stage(len(RADIANCE), radius=0.8).transformed(matrix).with_radiance(RADIANCE)
    return Scene(model, geometry, lights, stage, ForwardModel(geometry, lights), state)


def projected_landmarks(scene: Scene) -> Landmarks:
    """The ibug landmarks of the scene's state, barycentric weights and all."""
    vertices, weights = scene.model.landmark_vertices("ibug68")
    places = np.einsum("mk,mkc->mc", weights, scene.forward.pose(scene.state)[1][vertices])
    return Landmarks("ibug68", scene.state.camera.project(places), np.ones(len(places), bool))


def fit_error(folder: Path, scene: Scene) -> tuple[float, Result]:
    """Mean distance (m) of a quick fit to the scene's own picture over the narrow face,
    similarity-aligned; the fit.
    """
    from facestage.fit.given.metrics import aligned_distance
    from facestage.fit.result.run import fit_job

    scene.model.save(folder / "model.npz")
    job = replace(
        landmark_job(folder, scene, f"npz:{folder / 'model.npz'}"),
        quality="draft",
        budget_seconds=6.0,
    )
    result = fit_job(job, folder / "result")
    narrow = scene.model.regions["narrow_face"]
    truth = scene.forward.pose(scene.state)[1][narrow]
    return float(aligned_distance(result.vertices[narrow], truth, scale=True).mean()), result


def landmark_job(folder: Path, scene: Scene, specification: str) -> Job:
    """A job on the scene's picture: landmarks, camera and model as the user would give them."""
    from PIL import Image

    from facestage.contract.files.color import linear_to_srgb

    color, _ = scene.render(samples=16)
    color = 0.75 * color / color.max()
    Image.fromarray(np.round(255 * linear_to_srgb(color)).astype(np.uint8)).save(
        folder / "photo.png"
    )
    return Job(
        image=folder / "photo.png",
        model=specification,
        landmarks=projected_landmarks(scene),
        camera=scene.state.camera,
        stage=fibonacci_stage(6),
    )

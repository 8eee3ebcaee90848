"""The person of a sequence as a face model of its own: what the keyframes found, held for good."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from facestage.contract.arrays import Float32, UInt8
from facestage.contract.camera import Camera
from facestage.contract.face_model import EYES, OTHER, SKIN, FaceModel
from facestage.contract.light_stage import LightStage
from facestage.contract.result import Result
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import from_kept
from facestage.fit.forward.lamp_derivatives import AXES
from facestage.fit.forward.shading import ForwardModel, sample_bilinear

# Where a triangle's albedo is looked up, for its corners: barycentric coordinates.
SAMPLES = (
    np.array(
        [[4, 1, 1], [1, 4, 1], [1, 1, 4], [1, 2.5, 2.5], [2.5, 1, 2.5], [2.5, 2.5, 1], [2, 2, 2]]
    )
    / 6.0
)
ALBEDO_RANGE = 1e-3, 0.98


@dataclass(frozen=True, eq=False)
class Actor:
    """Shape, skin, lens and light of a sequence, with what renders them.

    ``geometry`` is of the person's own model: its mean is the person at rest, there are expressions
    alone, and each vertex has the albedo that the keyframes' texture has around it.
    """

    geometry: FaceGeometry
    forward: ForwardModel
    stage: LightStage  # stage frame
    camera_to_stage: np.ndarray  # (4, 4)
    state: State  # at rest, where the first keyframe has it

    @property
    def camera(self) -> Camera:
        """Of the whole picture, which all frames share."""
        return self.state.camera

    @classmethod
    def of(cls, model: FaceModel, keyframe: Result, albedo: np.ndarray | None) -> Actor:
        """The person of ``keyframe``, whose texture is ``albedo`` (S, S, 3), or that of its
        coefficients.
        """
        geometry = FaceGeometry(own_model(model, keyframe, albedo))
        stage = keyframe.stage
        lights = LightParameters(np.ones(len(stage), bool), np.zeros((len(stage), 3)), False)
        values = from_kept(keyframe.parameters) | {
            "identity": np.zeros(0),
            "albedo": np.zeros(0),
            "expression": np.zeros(len(model.expression_names)),
        }
        matrix = keyframe.model_to_camera
        state = State(
            rotation=matrix[:3, :3],
            translation=matrix[:3, 3],
            camera=keyframe.camera,
            lights=lights.from_radiance(stage.radiance),
            light_position=np.zeros((len(stage), AXES)),
            **values,
        )
        forward = ForwardModel(geometry, lights, resting=True)
        return cls(geometry, forward, stage, keyframe.camera_to_stage, state)

    def __reduce__(self) -> tuple[Callable[..., Actor], tuple[object, ...]]:
        """For another process, which renders with a scene of its own."""
        geometry, forward = self.geometry, self.forward
        parts = geometry.model, geometry.relief_basis, forward.lights, forward.bounces.resting
        return _staged, (*parts, self.stage, self.camera_to_stage, self.state)

    @cached_property
    def stage_in_camera(self) -> LightStage:
        """The lights where the first keyframe had them, in the camera frame."""
        return self.stage.transformed(np.linalg.inv(self.camera_to_stage))

    def at(self, rotation: np.ndarray, translation: np.ndarray, expression: np.ndarray) -> State:
        """The person with this pose and expression."""
        return replace(
            self.state, rotation=rotation, translation=translation, expression=expression
        )

    def lit(self, lights: np.ndarray) -> Actor:
        """Under other ``lights`` (parameters)."""
        return replace(self, state=replace(self.state, lights=lights))


def _staged(
    model: FaceModel,
    relief: np.ndarray,
    lights: LightParameters,
    resting: bool,
    stage: LightStage,
    camera_to_stage: np.ndarray,
    state: State,
) -> Actor:
    geometry = FaceGeometry(model, relief)
    forward = ForwardModel(geometry, lights, resting)
    return Actor(geometry, forward, stage, camera_to_stage, state)


def own_model(model: FaceModel, keyframe: Result, albedo: np.ndarray | None) -> FaceModel:
    """``model`` with the keyframe's identity, relief and albedo built in, and expressions alone; of
    its parts, the face and the eyes.
    """
    vertices = model.shape(keyframe.identity)
    if keyframe.relief is not None:
        vertices = vertices + keyframe.relief
    color = model.albedo(keyframe.albedo)
    if albedo is not None:
        color = painted(model, color, albedo)
    none = np.zeros((0, len(vertices), 3), np.float32)
    return replace(
        model,
        vertices=vertices.astype(np.float32),
        polygon_part=_shown_parts(model),
        identity_names=(),
        identity_basis=none,
        albedo_mean=np.clip(color, *ALBEDO_RANGE).astype(np.float32),
        albedo_basis=none,
    )


def _shown_parts(model: FaceModel) -> UInt8[np.ndarray, " polygons"]:
    """The parts of the polygons, without the back of the head and what is within the mouth: half of
    what would have to be traced, and none of what is compared.
    """
    if "face" not in model.regions:
        return model.polygon_part
    face = np.zeros(len(model.vertices), bool)
    face[model.regions["face"]] = True
    corners = np.where(model.polygons < 0, model.polygons[:, :1], model.polygons)
    marked = np.zeros(len(model.vertices), bool)
    for table in model.landmarks.values():
        marked[table[:, :3][table[:, 3:] != 0].astype(int)] = True
    shown = face[corners].all(axis=1) | (model.polygon_part == EYES)
    shown |= marked[corners].any(axis=1)
    return np.where(shown, model.polygon_part, OTHER).astype(np.uint8)


def painted(
    model: FaceModel, color: Float32[np.ndarray, "vertices 3"], texture: np.ndarray
) -> Float32[np.ndarray, "vertices 3"]:
    """``color``, on skin as ``texture`` (S, S, 3) has it around each vertex."""
    skin = model.triangle_part == SKIN
    triangles, uvs = model.triangles[skin], model.uvs[model.triangle_uvs[skin]]
    total, weight = np.zeros((len(color), 3)), np.zeros(len(color))
    for sample in SAMPLES:
        seen = sample_bilinear(texture, np.einsum("i,tix->tx", sample, uvs))
        for corner in range(3):
            np.add.at(total, triangles[:, corner], sample[corner] * seen)
            np.add.at(weight, triangles[:, corner], sample[corner])
    found = weight > 0
    result = color.copy()
    result[found] = total[found] / weight[found, None]
    return result

"""A face model registered to a scan: the truth that an ablation gives a fit piece by piece."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from facestage.contract.camera import Camera
from facestage.contract.errors import InputError
from facestage.contract.face_model import FaceModel
from facestage.contract.files.storage import read_arrays
from facestage.contract.landmarks import MEDIAPIPE, Landmarks
from facestage.contract.scan import MILLIMETRES, Scan
from facestage.contract.schemas.array_field import Array
from facestage.contract.schemas.schema import FileSchema, checked
from facestage.models.mesh.similarity import Similarity, procrustes
from facestage.models.mesh.surface import vertex_normals

# Cosine of normal and view below which a landmark does not show.
SHOWS = 0.1
# Of the iris, which a registration says nothing of.
FIRST_IRIS = 468
ALBEDO_RANGE = (0.02, 0.95)
# Millimetres that a case's scan may differ from the registered one after a rigid motion.
SAME_SCAN = 0.1


class RegisteredSchema(FileSchema):
    """A registered.npz."""

    dimensions: ClassVar = {"scan": (3, 2**31)}

    identity = Array(("identities",), minimum=-20, maximum=20)
    expression = Array(("expressions",), minimum=-20, maximum=20)
    vertices = Array(("vertices", 3), minimum=-1e6, maximum=1e6)
    scan = Array(("scan", 3), minimum=-1e6, maximum=1e6)
    albedo = Array(("vertices", 3), minimum=0, maximum=1, required=False)


@dataclass(frozen=True)
class Registered:
    """Coefficients of the scanned head, and the model's vertices beside the scan's, both in mm in
    one frame; the scan may lie elsewhere in a photo.
    """

    identity: np.ndarray  # (k,)
    expression: np.ndarray  # (e,)
    vertices: np.ndarray  # (n, 3)
    scan: np.ndarray  # (s, 3)
    albedo: np.ndarray | None  # (n, 3) linear

    @classmethod
    def load(cls, path: Path, model: FaceModel) -> Registered:
        """Raises InputError for what is not this model's."""
        arrays = read_arrays(path, "registration")
        sizes = {
            "identities": len(model.identity_names),
            "expressions": len(model.expression_names),
            "vertices": len(model.vertices),
        }
        found = checked(RegisteredSchema(**sizes), arrays, f"The registration '{path}'")
        values = {name: array.astype(np.float64) for name, array in found.items()}
        return cls(**({"albedo": None} | values))

    def in_photo(self, scan: Scan, model: FaceModel) -> Placed:
        """Where the registered head is when its scan is where ``scan`` has it."""
        if scan.vertices.shape != self.scan.shape:
            raise InputError(
                f"The case's scan has {len(scan.vertices)} vertices, the registered one "
                f"{len(self.scan)}; give a registration to this scan."
            )
        moved = procrustes(self.scan, scan.vertices, rigid=True)
        left = np.linalg.norm(moved.apply(self.scan) - scan.vertices, axis=1).max()
        if left > SAME_SCAN:
            raise InputError(
                f"The case's scan is not the registered one: they differ by {left:.3g} mm."
            )
        vertices = moved.apply(self.vertices) / MILLIMETRES
        shape = model.shape(self.identity, self.expression)
        return Placed(self, vertices, procrustes(shape, vertices, rigid=True), model)


@dataclass(frozen=True)
class Placed:
    """The registered head in a photo."""

    registered: Registered
    vertices: np.ndarray  # (n, 3) m, camera frame
    pose: Similarity  # of scale 1, model frame to camera frame
    model: FaceModel

    @property
    def initial(self) -> dict[str, np.ndarray]:
        """A job's starting values."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.pose.rotation, self.pose.translation
        registered = self.registered
        return {
            "identity": registered.identity,
            "expression": registered.expression,
            "model_to_camera": matrix,
        }

    def landmarks(self, camera: Camera) -> Landmarks:
        """Where the landmarks of the registered head are in the picture."""
        corners, weights = self.model.landmark_vertices(MEDIAPIPE)
        points = np.einsum("mi,mix->mx", weights, self.vertices[corners])
        normals = vertex_normals(self.vertices, self.model.triangles)
        normal = np.einsum("mi,mix->mx", weights, normals[corners])
        scale = np.linalg.norm(normal, axis=1) * np.linalg.norm(points, axis=1)
        shows = -(normal * points).sum(axis=1) > SHOWS * np.maximum(scale, 1e-20)
        shows[FIRST_IRIS:] = False
        return Landmarks(MEDIAPIPE, camera.project(points), shows, shows.astype(np.float64))

    def colored(self) -> FaceModel:
        """The face model with the scan's color as its mean. Raises InputError without one."""
        if self.registered.albedo is None:
            raise InputError("The registration holds no array 'albedo', which this row gives.")
        albedo = np.clip(self.registered.albedo, *ALBEDO_RANGE).astype(np.float32)
        return replace(self.model, albedo_mean=albedo)

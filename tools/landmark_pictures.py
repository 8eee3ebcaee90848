"""Pictures of a face model at known shapes and poses, and what MediaPipe's landmark network sees in
them.

Used by derive_landmarks.py alone; the fit never needs it.
"""

from __future__ import annotations

import tempfile
import zipfile
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from facestage.contract.camera import Camera
from facestage.contract.face_model import SKIN, FaceModel
from facestage.contract.files.color import linear_to_srgb
from facestage.contract.light_stage import fibonacci_stage
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.face.state import State
from facestage.fit.forward.shading import ForwardModel

SIDE, NET_SIDE = 384, 256
LIGHTS = 20
# The network's own tracker crops a square of 1.5 times the landmarks' bounding box, turned so that
# the eyes are level.
CROP_SCALE = 1.5
EYE_CORNERS = (33, 263)
# Each iris has its centre first, then four points of its border. In both they run the same way
# round the picture, so the mirror image exchanges two of them.
IRIS_MIRROR = (473, 476, 475, 474, 477, 468, 471, 470, 469, 472)
BROW, LIP, LID, HAIR = (
    (0.05, 0.035, 0.028),
    (0.30, 0.115, 0.10),
    (0.06, 0.035, 0.03),
    (0.06, 0.045, 0.035),
)


@dataclass(frozen=True)
class Draw:
    """One person in front of a camera."""

    identity: np.ndarray
    expression: np.ndarray
    rotation: np.ndarray  # (3, 3)
    translation: np.ndarray  # (3,)
    camera: Camera
    blinks: bool


def draw_person(
    model: FaceModel,
    rng: np.random.Generator,
    angles: tuple[float, float, float] | None = None,
    spread: float = 0.8,
) -> Draw:
    """A random face; ``angles`` (yaw, pitch, roll) in degrees, drawn when None."""
    identity = np.clip(spread * rng.normal(size=len(model.identity_names)), -2, 2)
    expression = np.zeros(len(model.expression_names))
    blinks = rng.random() < 0.1
    for index, name in enumerate(model.expression_names):
        if name.startswith("eyeBlink"):
            expression[index] = 0.9 * blinks
        elif name != "tongueOut" and rng.random() < 0.12:
            expression[index] = rng.uniform(0, 0.6)
    if angles is None:
        angles = (rng.uniform(-32, 32), rng.uniform(-20, 20), rng.uniform(-10, 10))
    yaw, pitch, roll = angles
    rotation = Rotation.from_euler("zxy", [roll, pitch, yaw], degrees=True).as_matrix()
    distance = rng.uniform(0.5, 1.1)
    camera = Camera.default(SIDE, SIDE, distance * SIDE / 0.33)
    translation = np.array([*rng.uniform(-0.01, 0.01, 2), -distance])
    return Draw(identity, expression, rotation, translation, camera, bool(blinks))


class Photographer:
    """Renders one model, in colors that a network trained on photographs knows for a face."""

    def __init__(self, model: FaceModel) -> None:
        from facestage.render.variant import start_renderer

        start_renderer("cpu")
        self.model = model
        self.geometry = FaceGeometry(model)
        self.stage = fibonacci_stage(LIGHTS)
        lights = LightParameters(np.zeros(LIGHTS, bool), np.ones((LIGHTS, 3)), uniform=False)
        self.forward = ForwardModel(self.geometry, lights)
        self._plain = "brows" not in model.regions

    def state(self, person: Draw) -> State:
        """The person as the fit's parameters."""
        return State(
            person.rotation,
            person.translation,
            person.camera,
            person.identity,
            person.expression,
            np.zeros(0),
            np.zeros((LIGHTS, 2)),
            np.zeros(len(self.model.albedo_basis)),
            0.45,
            np.full((4, 4), 0.7),
        )

    def picture(self, person: Draw, rng: np.random.Generator) -> np.ndarray:
        """(SIDE, SIDE, 3) uint8 sRGB, red first: soft light with a key lamp somewhere in front."""
        state = self.state(person)
        y, x = np.mgrid[:SIDE, :SIDE]
        pixels = np.stack([x.ravel(), y.ravel()], axis=1) + rng.uniform(0.2, 0.8, 2)
        surface = self.forward.surface(state, pixels)
        level = rng.uniform(0.2, 1.0, LIGHTS)
        level[rng.integers(0, LIGHTS // 2)] *= rng.uniform(1, 4)
        matrix = np.eye(4)
        matrix[:3, 3] = person.translation
        stage = self.stage.transformed(matrix).with_radiance(
            level[:, None] * (1 + 0.1 * rng.uniform(-1, 1, 3))
        )
        terms = self.forward.light_terms(state, surface, stage, 2, int(rng.integers(1 << 30)))
        colors = self._albedo(rng)[self.geometry.used]
        albedo = np.einsum("pi,pic->pc", surface.weights, colors[surface.corners])
        image = self.forward.shade(state, surface, terms, albedo=albedo, radiance=stage.radiance)
        result = np.full((SIDE, SIDE, 3), rng.uniform(0.05, 0.6, 3))
        column, row = surface.pixels.astype(int).T
        result[row, column] = image.color * (0.55 / np.percentile(image.color, 95))
        return np.round(255 * linear_to_srgb(np.clip(result, 0, 1))).astype(np.uint8)

    def outline(self, person: Draw) -> np.ndarray:
        """(68, 2) pixels of the 68 landmarks."""
        corners, weights = self.model.landmark_vertices("ibug68")
        shape = (
            self.model.shape(person.identity, person.expression) @ person.rotation.T
            + person.translation
        )
        return person.camera.project(np.einsum("mi,mix->mx", weights, shape[corners]))

    def _albedo(self, rng: np.random.Generator) -> np.ndarray:
        """(n, 3) linear; a model of bare skin gets brows, lips, lid borders and sometimes hair."""
        model = self.model
        delta = np.zeros(len(model.albedo_basis))
        delta[:2] = np.clip(0.5 * rng.normal(size=2), -1, 1)
        color = model.albedo(delta).astype(np.float64)
        if not self._plain:
            return color
        for target, weight in _make_up(model, rng):
            color *= (np.array(target) / color) ** weight[:, None]
        return color


def _make_up(
    model: FaceModel, rng: np.random.Generator
) -> list[tuple[tuple[float, float, float], np.ndarray]]:
    """Colors and their weights (n,), from the 68 landmarks of the mean face."""
    corners, barycentric = model.landmark_vertices("ibug68")
    mark = np.einsum("mi,mix->mx", barycentric, model.vertices[corners]).astype(float)
    skin = np.zeros(len(model.vertices), bool)
    skin[model.triangles[model.triangle_part == SKIN]] = True
    points = model.vertices.astype(float)
    face = np.zeros(len(points), bool)
    face[model.regions["face"]] = True
    brow = np.zeros(len(points))
    for line in (mark[17:22], mark[22:27]):
        brow = np.maximum(brow, _near(points, line, 0.0032 + 0.0015 * rng.random()))
    lid = np.zeros(len(points))
    for line in (mark[[36, 37, 38, 39]], mark[[42, 43, 44, 45]]):
        lid = np.maximum(lid, _near(points, line, 0.0016))
    lips = _lip_weight(points, mark)
    hairline = mark[27, 1] + rng.uniform(0.05, 0.075)
    sides = points[:, 2] < mark[[0, 16], 2].mean() - 0.01
    hair = ((points[:, 1] > hairline) | (~face & sides & (points[:, 1] > mark[8, 1]))) * float(
        rng.random() < 0.7
    )
    return [
        (BROW, 0.85 * brow * skin),
        (LIP, 0.75 * lips * skin),
        (LID, 0.6 * lid * skin),
        (HAIR, 0.9 * hair * skin),
    ]


def _near(points: np.ndarray, line: np.ndarray, width: float) -> np.ndarray:
    """(n,) 1 on a polyline (k, 3), falling to 0 beyond ``width`` metres from it."""
    best = np.full(len(points), np.inf)
    for a, b in pairwise(line):
        share = np.clip(((points - a) @ (b - a)) / ((b - a) @ (b - a)), 0, 1)
        best = np.minimum(best, np.linalg.norm(points - a - share[:, None] * (b - a), axis=1))
    return np.exp(-((best / width) ** 4))


def _lip_weight(points: np.ndarray, mark: np.ndarray) -> np.ndarray:
    """(n,) 1 between the outer and the inner border of the lips, seen from the front."""
    from matplotlib.path import Path as Outline

    inside = Outline(mark[48:60, :2]).contains_points(points[:, :2], radius=1e-4)
    return inside * (points[:, 2] > mark[48:60, 2].min() - 0.006)


class LandmarkNet:
    """MediaPipe's face landmark network out of its bundle."""

    def __init__(self, bundle: Path) -> None:
        with zipfile.ZipFile(bundle) as archive, tempfile.TemporaryDirectory() as folder:
            path = archive.extract("face_landmarks_detector.tflite", folder)
            self._net = cv2.dnn.readNetFromTFLite(path)
        self._outputs = self._net.getUnconnectedOutLayersNames()

    def detect(self, picture: np.ndarray, box: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """(478, 2) pixels of ``picture`` (h, w, 3) uint8; ``box`` (2, 2) of low and high corner is
        the first guess.
        """
        centre, side, angle = box.mean(axis=0), CROP_SCALE * np.ptp(box, axis=0).max(), 0.0
        points = np.zeros((478, 2))
        for _ in range(2):
            jitter = 0.03 * side * rng.uniform(-1, 1, 2)
            points = self._once(picture, centre + jitter, side * rng.uniform(0.95, 1.05), angle)
            angle = float(np.arctan2(*(points[EYE_CORNERS[1]] - points[EYE_CORNERS[0]])[::-1]))
            turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
            level = points @ turn.T
            centre = 0.5 * (level.min(axis=0) + level.max(axis=0)) @ turn
            side = CROP_SCALE * np.ptp(level, axis=0).max()
        return points

    def _once(
        self, picture: np.ndarray, centre: np.ndarray, side: float, angle: float
    ) -> np.ndarray:
        cos, sin = side / NET_SIDE * np.cos(angle), side / NET_SIDE * np.sin(angle)
        linear = np.array([[cos, -sin], [sin, cos]])
        # Pixel centres are at halves in the points, at whole numbers in OpenCV.
        shift = centre - linear @ np.full(2, NET_SIDE / 2)
        matrix = np.column_stack([linear, shift + linear @ [0.5, 0.5] - 0.5])
        crop = cv2.warpAffine(
            picture,
            matrix,
            (NET_SIDE, NET_SIDE),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
        self._net.setInput(cv2.dnn.blobFromImage(crop, 1 / 255.0))
        found = next(item for item in self._net.forward(self._outputs) if item.size == 478 * 3)
        return found.reshape(478, 3)[:, :2] @ linear.T + shift


def canonical_mesh(bundle: Path) -> np.ndarray:
    """(468, 3) cm: the network's canonical face, from the Protocol Buffers file in its bundle."""
    with zipfile.ZipFile(bundle) as archive:
        data = archive.read("geometry_pipeline_metadata_landmarks.binarypb")
    mesh = next(value for field, value in _fields(data) if field == 1)
    assert isinstance(mesh, bytes)
    numbers = b"".join(
        value for field, value in _fields(mesh) if field == 3 and isinstance(value, bytes)
    )
    return np.frombuffer(numbers, "<f4").reshape(-1, 5)[:, :3].astype(float)


def mirror_order(canonical: np.ndarray) -> np.ndarray:
    """(478,) index of each landmark's mirror image; ``canonical`` is (468, 3)."""
    distance, order = cKDTree(canonical).query(canonical * [-1, 1, 1])
    assert distance.max() < 1e-4, "the canonical face is not symmetric"
    return np.concatenate([order, IRIS_MIRROR])


def _fields(data: bytes) -> list[tuple[int, bytes | int]]:
    """Field numbers and values of a message: varints as int, all else as bytes."""
    result: list[tuple[int, bytes | int]] = []
    at = 0
    while at < len(data):
        key, at = _varint(data, at)
        if key & 7 == 0:
            number, at = _varint(data, at)
            result.append((key >> 3, number))
            continue
        length = {1: 8, 5: 4}.get(key & 7, 0)
        if key & 7 == 2:
            length, at = _varint(data, at)
        result.append((key >> 3, data[at : at + length]))
        at += length
    return result


def _varint(data: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        value |= (data[at] & 127) << shift
        at, shift = at + 1, shift + 7
        if data[at - 1] < 128:
            return value, at

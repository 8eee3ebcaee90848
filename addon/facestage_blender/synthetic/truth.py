"""The truth behind a synthetic photo, as plain arrays of the contract. No bpy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from facestage.contract.face_model import FaceModel
from facestage.contract.landmarks import IBUG
from facestage.contract.light_stage import LightStage

SIZE, FOCAL_PX, DISTANCE = 256, 600.0, 0.78  # pixels, pixels, metres


@dataclass(frozen=True)
class Worn:
    """Something before the skin that the face model knows nothing of."""

    name: str
    vertices: np.ndarray  # (n, 3) m, model frame
    triangles: np.ndarray  # (t, 3)
    color: tuple[float, float, float]  # linear RGB
    roughness: float
    of_skin: bool = False  # part of the person, to be colored like the face


@dataclass(frozen=True)
class Optics:
    """What a real camera adds to a picture; by default nothing."""

    # of a lens of the camera's angle of view on a sensor 36 mm wide; None: all is sharp
    f_number: float | None = None
    # that a pixel holds at white: their count is what makes noise; None: no noise
    electrons: float | None = None
    jpeg_quality: int | None = None  # 1..100; None: the picture is not compressed


PERFECT = Optics()


@dataclass(frozen=True)
class Sky:
    """One of the surroundings that Blender ships, turned by degrees about the vertical."""

    name: str
    turn: float = 0.0


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
    worn: tuple[Worn, ...] = ()
    interreflection: bool = False  # whether light is followed beyond its first reflection
    focal_px: float = FOCAL_PX  # for a picture of SIZE pixels
    around: tuple[Worn, ...] = ()  # walls and the like, in the stage frame
    optics: Optics = PERFECT
    sky: Sky | None = None  # what lights the scene beside the stage
    scattering: float = 0.0  # how far light wanders below the skin (contract/scattering.py)
    height: np.ndarray | None = None  # (S, S) mm that the skin stands off the smooth face


def landmark_points(model: FaceModel, vertices: np.ndarray) -> np.ndarray:
    """(68, 3) landmarks of the ibug scheme on a head's vertices (n, 3), in their frame."""
    corners, weights = model.landmark_vertices(IBUG)
    return np.einsum("mi,mix->mx", weights, vertices[corners])

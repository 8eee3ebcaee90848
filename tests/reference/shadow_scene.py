"""A card that floats before a bulging wall and throws a soft shadow on it: a model whose modes move
the shadow.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from facestage.contract.camera import Camera
from facestage.contract.face_model import SKIN, FaceModel
from facestage.contract.light_stage import LightStage
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.face.state import State
from facestage.fit.forward.shading import ForwardModel
from reference.rendering.meshes import stage_at
from reference.synthetic_scene import Scene

IDENTITY = ("card across", "card up", "card away", "card turned", "card tilted", "wall bulge")
EXPRESSION = ("card wider",)
SIDE = 80
RADIANCE = np.array([[60.0, 50.0, 40.0]])
CARD_CENTRE, CARD_HALF = np.array([0.045, 0.02, 0.06]), 0.025


def _grid(rows: int, half: float) -> tuple[np.ndarray, np.ndarray]:
    """(rows^2, 2) places on a square and its quads, counter-clockwise."""
    v, u = np.meshgrid(
        np.linspace(-half, half, rows), np.linspace(-half, half, rows), indexing="ij"
    )
    row, column = np.mgrid[: rows - 1, : rows - 1]
    a = (row * rows + column).ravel()
    return np.stack([u.ravel(), v.ravel()], axis=1), np.stack(
        [a, a + 1, a + rows + 1, a + rows], axis=1
    )


def card_and_wall(rows: int = 21) -> FaceModel:
    """A wall of 26 cm and a card of 5 cm six centimetres before it; each mode moves a few
    millimetres.
    """
    flat, wall_quads = _grid(rows, 0.13)
    bulge = np.exp(-(flat**2).sum(1) / (2 * 0.05**2))
    wall = np.column_stack([flat, 0.02 * bulge])
    flat_card, card_quads = _grid(3, CARD_HALF)
    offset = np.column_stack([flat_card, np.zeros(len(flat_card))])
    vertices = np.concatenate([wall, CARD_CENTRE + offset])
    polygons = np.concatenate([wall_quads, len(wall) + card_quads]).astype(np.int32)

    def of_card(motion: np.ndarray) -> np.ndarray:
        return np.concatenate([np.zeros_like(wall), np.broadcast_to(motion, offset.shape)])

    identity = [of_card(0.004 * np.eye(3)[axis]) for axis in range(3)]
    identity += [
        of_card(0.15 * np.cross([0, 0, 1], offset)),
        of_card(0.15 * np.cross([0, 1, 0], offset)),
    ]
    identity.append(np.concatenate([0.004 * bulge[:, None] * [0, 0, 1], np.zeros_like(offset)]))
    expression = [of_card(0.15 * offset * [1, 0, 0])]
    count = len(vertices)
    uvs = np.concatenate([flat / 0.26 + 0.5, flat_card / 0.26 + 0.5])
    return FaceModel(
        name="card and wall",
        license="CC0",
        source="made for tests",
        vertices=vertices.astype(np.float32),
        polygons=polygons,
        polygon_uvs=polygons.copy(),
        polygon_part=np.full(len(polygons), SKIN, np.uint8),
        uvs=uvs.astype(np.float32),
        identity_names=IDENTITY,
        identity_basis=np.stack(identity).astype(np.float32),
        expression_names=EXPRESSION,
        expression_basis=np.stack(expression).astype(np.float32),
        albedo_mean=np.full((count, 3), 0.4, np.float32),
        albedo_basis=np.zeros((0, count, 3), np.float32),
        landmarks={"ibug68": _landmarks()},
        expression_prior="gaussian",
    )


def _landmarks() -> np.ndarray:
    """(68, 6): corners of the wall's grid along its border."""
    zeros = np.zeros(68)
    return np.stack([np.arange(68)] * 3 + [zeros + 1, zeros, zeros], axis=1)


def shadow_scene(side_of_light: float = 0.12) -> Scene:
    """The card and the wall before the camera under one lamp from the upper right."""
    model = card_and_wall()
    geometry = FaceGeometry(model)
    translation = np.array([0.004, -0.006, -0.6])
    matrix = np.eye(4)
    matrix[:3, 3] = translation
    stage: LightStage = stage_at(np.array([[0.45, 0.25, 0.5]]), side_of_light).transformed(matrix)
    lights = LightParameters(np.ones(1, bool), np.zeros_like(RADIANCE), uniform=False)
    state = State(
        rotation=Rotation.from_rotvec([0.08, -0.12, 0.05]).as_matrix(),
        translation=translation,
        camera=Camera(SIDE, SIDE, 2.2 * SIDE, (0.51 * SIDE, 0.48 * SIDE)),
        identity=np.zeros(len(IDENTITY)),
        expression=np.zeros(len(EXPRESSION)),
        lights=lights.from_radiance(RADIANCE),
        light_position=np.zeros((1, 2)),
        albedo=np.zeros(0),
        roughness=0.5,
        specular=np.full((4, 4), 0.6),
    )
    return Scene(
        model,
        geometry,
        lights,
        stage.with_radiance(RADIANCE),
        ForwardModel(geometry, lights),
        state,
    )

"""A second photo of the synthetic scene's person: another pose, expression, camera and light."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from facestage.contract.camera import Camera
from facestage.contract.light_stage import fibonacci_stage
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.forward.shading import ForwardModel
from reference.synthetic_scene import Scene


def another_photo(
    scene: Scene, side: int = 80, turn: tuple[float, float, float] = (-0.05, -0.4, 0.08)
) -> Scene:
    """The person of ``scene``, ``turn``ed (rotation vector), under four lights instead of six."""
    radiance = np.array([[2, 2, 2], [9, 8, 7], [1, 1, 1.5], [3, 4, 5]], float)
    lights = LightParameters(np.ones(4, bool), np.zeros_like(radiance), uniform=False)
    translation = np.array([-0.01, 0.006, -0.62])
    matrix = np.eye(4)
    matrix[:3, 3] = translation
    state = replace(
        scene.state,
        rotation=Rotation.from_rotvec(turn).as_matrix(),
        translation=translation,
        camera=Camera(side, side, 2.2 * side, (0.5 * side, 0.5 * side)),
        expression=np.array([0.1, 0.5, 0.0]),
        lights=lights.from_radiance(radiance),
        light_position=np.zeros((4, 2)),
    )
    stage = fibonacci_stage(4, radius=0.8).transformed(matrix).with_radiance(radiance)
    return replace(
        scene, lights=lights, stage=stage, forward=ForwardModel(scene.geometry, lights), state=state
    )

"""One guess of everything that is fitted."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from facestage.contract.camera import Camera


@dataclass(frozen=True)
class State:
    """One guess of everything that is fitted. Camera frame; lights at unit order of radiance."""

    rotation: np.ndarray  # (3, 3) model to camera
    translation: np.ndarray  # (3,) m
    camera: Camera
    identity: np.ndarray  # (k,) alpha
    expression: np.ndarray  # (e,) beta
    lights: np.ndarray  # (light parameters,), see LightParameters
    # (N, 2) radians that each light is turned by about the stage's centre
    light_position: np.ndarray
    albedo: np.ndarray  # (d,) delta
    roughness: float
    specular: np.ndarray  # (s, s) c_spec, row 0 at v = 1

    @property
    def model_to_camera(self) -> np.ndarray:
        """(4, 4) rigid transform."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.rotation, self.translation
        return matrix


def with_shape(state: State, shape: State) -> State:
    """``state`` with pose, lens, identity and expression of another."""
    return replace(
        state,
        rotation=shape.rotation,
        translation=shape.translation,
        camera=shape.camera,
        identity=shape.identity,
        expression=shape.expression,
    )

"""One guess of everything that is fitted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from facestage.contract.camera import Camera


@dataclass(frozen=True)
class State:
    """Camera frame; lights at unit order of radiance. A field that came later has a default, which
    files without it mean. What is done with each is its row in unknowns.py.
    """

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

"""One guess of everything that is fitted."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.camera import Camera


@dataclass(frozen=True)
class State:
    """Camera frame; lights at unit order of radiance. A field that came later has a default, which
    files without it mean. What is done with each is its row in unknowns.py.
    """

    rotation: Float[np.ndarray, "3 3"]  # model to camera
    translation: Float[np.ndarray, " 3"]  # m
    camera: Camera
    identity: Float[np.ndarray, " identities"]  # alpha
    expression: Float[np.ndarray, " expressions"]  # beta
    lights: Float[np.ndarray, " parameters"]  # see LightParameters
    # radians that each light is turned by about the stage's centre
    light_position: Float[np.ndarray, "lights 2"]
    albedo: Float[np.ndarray, " albedos"]  # delta
    roughness: float
    specular: Float[np.ndarray, "texels texels"]  # c_spec, row 0 at v = 1
    # of FaceGeometry.relief_basis; none: not fitted
    relief: Float[np.ndarray, " reliefs"] = field(default_factory=lambda: np.zeros(0))
    # how much of the light that skin sends to skin there is: 0 none, 1 as the mesh has it
    interreflection: float = 0.0
    # how far light wanders below the skin: 0 not at all, 1 as published (contract/scattering.py)
    scattering: float = 0.0
    # how much more light comes out at a slant and of bulges: 0 of opaque skin, 1 of a random walk
    translucency: float = 0.0

    @property
    def shape_weights(self) -> Float[np.ndarray, " modes"]:
        """Of identity, expression and relief, in the order of the shape's bases."""
        return np.concatenate([self.identity, self.expression, self.relief])

    @property
    def model_to_camera(self) -> Float[np.ndarray, "4 4"]:
        """The head's pose as a rigid transform."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.rotation, self.translation
        return matrix

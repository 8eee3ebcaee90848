"""The unknowns of a fit, as named blocks of one vector of increments."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from facestage.contract import brdf
from facestage.fit.face.lamps import spacing
from facestage.fit.face.state import State

BLOCKS = (
    "pose",
    "focal",
    "identity",
    "expression",
    "lights",
    "light_position",
    "albedo",
    "roughness",
    "specular",
)
FOCAL_SIGMA = 0.25  # of the logarithm, when the lens is unknown


class Layout:
    """Where each block lies in the increment vector, and which entries a stage may move."""

    def __init__(self, state: State) -> None:
        sizes = {
            "pose": 6,
            "focal": 1,
            "identity": state.identity.size,
            "expression": state.expression.size,
            "lights": state.lights.size,
            "light_position": state.light_position.size,
            "albedo": state.albedo.size,
            "roughness": 1,
            "specular": state.specular.size,
        }
        self.slices: dict[str, slice] = {}
        start = 0
        for name in BLOCKS:
            self.slices[name] = slice(start, start + sizes[name])
            start += sizes[name]
        self.size = start
        self._lights = len(state.light_position)

    def mask(self, blocks: Iterable[str]) -> np.ndarray:
        """(size,) bool, true for the entries of ``blocks``."""
        result = np.zeros(self.size, bool)
        for name in blocks:
            result[self.slices[name]] = True
        return result

    def blocks_of(self, mask: np.ndarray) -> tuple[str, ...]:
        """The blocks that ``mask`` (size,) bool touches."""
        return tuple(name for name, where in self.slices.items() if mask[where].any())

    def values(self, state: State) -> np.ndarray:
        """(size,) the current values; pose is an increment, so it reads 0."""
        result = np.zeros(self.size)
        result[self.slices["focal"]] = np.log(state.camera.focal_px)
        result[self.slices["identity"]] = state.identity
        result[self.slices["expression"]] = state.expression
        result[self.slices["lights"]] = state.lights
        result[self.slices["light_position"]] = state.light_position.ravel()
        result[self.slices["albedo"]] = state.albedo
        result[self.slices["roughness"]] = state.roughness
        result[self.slices["specular"]] = state.specular.ravel()
        return result

    def bounds(
        self, expression_box: bool | np.ndarray, stage_lights: int | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """(size,) lower and upper bounds of the values; the arguments as in the priors."""
        low, high = np.full(self.size, -np.inf), np.full(self.size, np.inf)
        low[self.slices["expression"]] = np.where(expression_box, 0.0, -np.inf)
        high[self.slices["expression"]] = np.where(expression_box, 1.0, np.inf)
        low[self.slices["lights"]] = 0.0
        reach = spacing(self._lights if stage_lights is None else stage_lights)
        low[self.slices["light_position"]], high[self.slices["light_position"]] = -reach, reach
        low[self.slices["roughness"]], high[self.slices["roughness"]] = (
            brdf.ROUGHNESS_MIN,
            brdf.ROUGHNESS_MAX,
        )
        low[self.slices["specular"]], high[self.slices["specular"]] = 0.0, brdf.SPECULAR_MAX
        # Ten standard deviations is no face; the bound keeps a wild step from leaving float range.
        for name in ("identity", "albedo"):
            low[self.slices[name]], high[self.slices[name]] = -10.0, 10.0
        return low, high

    def apply(self, state: State, step: np.ndarray) -> State:
        """The state after ``step`` (size,): rotation by an SO(3) increment about the model's
        origin.
        """
        values = self.values(state) + step
        omega, shift = step[self.slices["pose"]][:3], step[self.slices["pose"]][3:]
        rotation = Rotation.from_rotvec(omega).as_matrix() @ state.rotation
        camera = state.camera
        if step[self.slices["focal"]][0] != 0.0:
            camera = replace(camera, focal_px=float(np.exp(values[self.slices["focal"]][0])))
        return State(
            rotation=rotation,
            translation=state.translation + shift,
            camera=camera,
            identity=values[self.slices["identity"]],
            expression=values[self.slices["expression"]],
            lights=values[self.slices["lights"]],
            light_position=values[self.slices["light_position"]].reshape(
                state.light_position.shape
            ),
            albedo=values[self.slices["albedo"]],
            roughness=float(values[self.slices["roughness"]][0]),
            specular=values[self.slices["specular"]].reshape(state.specular.shape),
        )

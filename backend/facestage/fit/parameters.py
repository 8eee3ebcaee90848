"""The unknowns of a fit, as named blocks of one vector of increments."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from facestage.contract import brdf
from facestage.contract.camera import Camera
from facestage.fit.light_position import spacing

BLOCKS = ("pose", "focal", "identity", "expression", "lights", "light_position", "albedo", "roughness", "specular")
CHANNELS = 3


@dataclass(frozen=True)
class State:
    """One guess of everything that is fitted. Camera frame; lights at unit order of radiance."""

    rotation: np.ndarray  # (3, 3) model to camera
    translation: np.ndarray  # (3,) m
    camera: Camera
    identity: np.ndarray  # (k,) alpha
    expression: np.ndarray  # (e,) beta
    lights: np.ndarray  # (light parameters,), see LightParameters
    light_position: np.ndarray  # (N, 2) radians that each light is turned by about the stage's centre
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
        state, rotation=shape.rotation, translation=shape.translation, camera=shape.camera, identity=shape.identity,
        expression=shape.expression,
    )  # fmt: skip


@dataclass(frozen=True)
class LightParameters:
    """How the light parameters become radiance (N, 3); a light that is not fitted has none.

    multi: one parameter per light and channel. uniform: one intensity per light and one color for all
    (three more parameters; the product's scale is held by a prior on the color's mean).
    """

    fitted: np.ndarray  # (N,) bool
    fixed_radiance: np.ndarray  # (N, 3), zero where fitted or off
    uniform: bool
    numbers: np.ndarray | None = None  # (N,) int, what names a light when others come or go; None: 0, 1, 2, ...

    @property
    def size(self) -> int:
        """Number of light parameters."""
        count = int(self.fitted.sum())
        # A color that no fitted light has is no parameter.
        return count + CHANNELS if self.uniform and count else count * CHANNELS

    def radiance(self, parameters: np.ndarray) -> np.ndarray:
        """(N, 3) radiance of every light."""
        result = self.fixed_radiance.copy()
        if self.uniform and self.size:
            result[self.fitted] = parameters[:-CHANNELS, None] * parameters[-CHANNELS:]
        else:
            result[self.fitted] = parameters.reshape(-1, CHANNELS)
        return result

    def jacobian(self, parameters: np.ndarray) -> np.ndarray:
        """(fitted lights, 3, size) derivative of the fitted lights' radiance."""
        count = int(self.fitted.sum())
        result = np.zeros((count, CHANNELS, self.size))
        if not count:
            return result
        light = np.arange(count)
        for channel in range(CHANNELS):
            if self.uniform and count:
                result[light, channel, light] = parameters[count + channel]
                result[:, channel, count + channel] = parameters[:count]
            else:
                result[light, channel, light * CHANNELS + channel] = 1.0
        return result

    def dark(self, parameters: np.ndarray, settled: np.ndarray) -> np.ndarray:
        """(N,) bool: lights of radiance 0 that nothing will turn on.

        ``settled`` (size,) bool marks the parameters that are at their bound and want to stay there, or may not move.
        """
        result = (self.radiance(parameters) == 0).all(axis=1)
        own = (self.jacobian(parameters) != 0).any(axis=1)
        result[self.fitted] &= own.any(axis=1) & ~(own & ~settled).any(axis=1)
        return result

    def of_lights(self, chosen: np.ndarray) -> np.ndarray:
        """(size,) bool, the parameters that belong to the ``chosen`` (N,) lights alone."""
        own = chosen[self.fitted]
        if not self.uniform or not self.size:
            return np.repeat(own, CHANNELS)
        return np.concatenate([own, np.zeros(CHANNELS, bool)])

    def from_radiance(self, radiance: np.ndarray) -> np.ndarray:
        """Parameters whose radiance is nearest to (N, 3) ``radiance``."""
        wanted = radiance[self.fitted]
        if not self.uniform or not self.size:
            return wanted.ravel().astype(float)
        total = wanted.sum(0)
        color = total / total.mean() if total.sum() > 0 else np.ones(CHANNELS)
        return np.concatenate([wanted @ color / (color @ color), color])


class Layout:
    """Where each block lies in the increment vector, and which entries a stage may move."""

    def __init__(self, state: State) -> None:
        sizes = {
            "pose": 6, "focal": 1, "identity": state.identity.size, "expression": state.expression.size,
            "lights": state.lights.size, "light_position": state.light_position.size, "albedo": state.albedo.size,
            "roughness": 1, "specular": state.specular.size,
        }  # fmt: skip
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
        low[self.slices["roughness"]], high[self.slices["roughness"]] = brdf.ROUGHNESS_MIN, brdf.ROUGHNESS_MAX
        low[self.slices["specular"]], high[self.slices["specular"]] = 0.0, brdf.SPECULAR_MAX
        # Ten standard deviations is no face; the bound keeps a wild step from leaving float range.
        for name in ("identity", "albedo"):
            low[self.slices[name]], high[self.slices[name]] = -10.0, 10.0
        return low, high

    def apply(self, state: State, step: np.ndarray) -> State:
        """The state after ``step`` (size,): rotation by an SO(3) increment about the model's origin."""
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
            light_position=values[self.slices["light_position"]].reshape(state.light_position.shape),
            albedo=values[self.slices["albedo"]],
            roughness=float(values[self.slices["roughness"]][0]),
            specular=values[self.slices["specular"]].reshape(state.specular.shape),
        )

"""What is known before the photo: statistics of faces, of skin and of light (E_prior and
E_light).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from facestage.contract.job import Weights
from facestage.fit.face.lamps import spacing
from facestage.fit.face.layout import FOCAL_SIGMA, Layout
from facestage.fit.face.light_parameters import CHANNELS, LightParameters
from facestage.fit.face.state import State

# Expressions of photographed faces: most blendshapes near 0, few above a half.
EXPRESSION_SIGMA = 0.35
ROUGHNESS_MEAN, ROUGHNESS_SIGMA = 0.40, 0.10  # skin, Weyrich et al. 2006
SPECULAR_MEAN, SPECULAR_SIGMA = 0.8, 0.4  # c_spec = 0.7 is skin's index of 1.4
SPECULAR_SMOOTHNESS = 0.25  # difference of neighbouring texels
# E_light, relative to the mean light: how much the channels of one light differ, and how bright it
# is. Lamps may be of any color; that all of them together tint the skin cannot be told from the
# skin's own color.
LIGHT_COLOR_SIGMA, LIGHT_LEVEL_SIGMA, LIGHT_TINT_SIGMA = 0.4, 3.0, 0.06
# How far a lamp stands from the nearest light of the lattice, in spacings of the lattice.
LIGHT_POSITION_SHARE = 0.4


@dataclass(frozen=True)
class Quadratic:
    """A quadratic energy 0.5 x^T H x + g^T x around the current state, and its value now."""

    hessian: np.ndarray
    gradient: np.ndarray
    energy: dict[str, float]


class Priors:
    """E_prior on alpha, beta, delta, roughness, specular and focal length; E_light on the
    lights.
    """

    def __init__(
        self,
        layout: Layout,
        state: State,
        expression_box: bool | np.ndarray,
        weights: Weights,
        light_scale: float = 1.0,
        stage_lights: int | None = None,
        focal_sigma: float = FOCAL_SIGMA,
    ) -> None:
        """``expression_box``: which expressions (e,), or whether all, have weights in 0..1; others
        are Gaussian.

        ``light_scale``: the mean radiance that E_light is relative to. Fixed, so that black is no
        escape.

        ``focal_sigma``: standard deviation of the logarithm of the focal length of ``state``.
        ``stage_lights``: lights of the whole stage, those that are off too; by default those of
        ``state``.
        """
        self.layout, self.weights, self.light_scale = layout, weights, light_scale
        self.expression_sigma = np.where(expression_box, EXPRESSION_SIGMA, 1.0)
        self.focal_px, self.focal_sigma = state.camera.focal_px, focal_sigma
        self._lights = len(state.light_position) if stage_lights is None else stage_lights
        self.smoothness = _texel_differences(state.specular.shape[0])
        # Blocks whose priors another photo of the same person carries.
        self.omitted: frozenset[str] = frozenset()

    def _residual_operators(
        self, lights: LightParameters
    ) -> dict[str, tuple[slice, sp.spmatrix, np.ndarray]]:
        """Per term: block, operator A and offset b of the residual A x - b in standard
        deviations.
        """
        slices = self.layout.slices
        prior = np.sqrt(self.weights.prior)
        size = slices["specular"].stop - slices["specular"].start

        def scaled(
            name: str, mean: float, sigma: float | np.ndarray
        ) -> tuple[slice, sp.spmatrix, np.ndarray]:
            inverse = np.broadcast_to(prior / sigma, slices[name].stop - slices[name].start)
            return slices[name], sp.diags(inverse, format="csr"), mean * inverse

        light_operator, light_offset = _light_operator(lights, self.light_scale)
        light = np.sqrt(self.weights.light)
        terms = {
            "identity": scaled("identity", 0.0, 1.0),
            "expression": scaled("expression", 0.0, self.expression_sigma),
            "albedo": scaled("albedo", 0.0, 1.0),
            "roughness": scaled("roughness", ROUGHNESS_MEAN, ROUGHNESS_SIGMA),
            "focal": scaled("focal", np.log(self.focal_px), self.focal_sigma),
            # One observation's worth for the level of the whole map; smoothness ties the texels.
            "specular_level": (
                slices["specular"],
                sp.identity(size) * (prior / (SPECULAR_SIGMA * np.sqrt(size))),
                np.full(size, prior * SPECULAR_MEAN / (SPECULAR_SIGMA * np.sqrt(size))),
            ),
            "specular_smooth": (
                slices["specular"],
                self.smoothness * (prior / SPECULAR_SMOOTHNESS),
                np.zeros(self.smoothness.shape[0]),
            ),
            "light": (slices["lights"], light_operator * light, light_offset * light),
            "light_position": scaled(
                "light_position", 0.0, LIGHT_POSITION_SHARE * spacing(self._lights)
            ),
        }
        omitted = [slices[name] for name in self.omitted]
        return {name: term for name, term in terms.items() if term[0] not in omitted}

    def energies(self, state: State, lights: LightParameters) -> dict[str, float]:
        """The energy of each term at ``state``."""
        values = self.layout.values(state)
        return {
            name: 0.5 * float(((operator @ values[where] - offset) ** 2).sum())
            for name, (where, operator, offset) in self._residual_operators(lights).items()
        }

    def quadratic(self, state: State, lights: LightParameters) -> Quadratic:
        """The terms around ``state``."""
        values = self.layout.values(state)
        hessian = np.zeros((self.layout.size, self.layout.size))
        gradient = np.zeros(self.layout.size)
        energy = {}
        for name, (where, operator, offset) in self._residual_operators(lights).items():
            residual = operator @ values[where] - offset
            hessian[where, where] += (operator.T @ operator).toarray()
            gradient[where] += operator.T @ residual
            energy[name] = 0.5 * float(residual @ residual)
        return Quadratic(hessian, gradient, energy)


def _light_operator(lights: LightParameters, mean: float) -> tuple[sp.spmatrix, np.ndarray]:
    """E_light = sum_j |l_j - m_j|^2 (Dib et al. 2019, eq. 5), relative to the mean radiance; tint
    and a weak level.
    """
    count = int(lights.fitted.sum())
    if count == 0:
        return sp.csr_matrix((0, 0)), np.zeros(0)
    if lights.uniform:
        level = sp.identity(count) / (LIGHT_LEVEL_SIGMA * mean)
        color = sp.identity(CHANNELS) / LIGHT_TINT_SIGMA
        offset = np.concatenate([np.zeros(count), np.full(CHANNELS, 1.0 / LIGHT_TINT_SIGMA)])
        return sp.block_diag([level, color]).tocsr(), offset
    centre = np.eye(CHANNELS) - 1.0 / CHANNELS
    color = sp.kron(sp.identity(count), centre / (LIGHT_COLOR_SIGMA * mean))
    tint = sp.kron(np.ones((1, count)), centre / (LIGHT_TINT_SIGMA * mean * count))
    level = sp.identity(count * CHANNELS) / (LIGHT_LEVEL_SIGMA * mean)
    operator = sp.vstack([color, tint, level]).tocsr()
    return operator, np.zeros(operator.shape[0])


def _texel_differences(size: int) -> sp.csr_matrix:
    """Differences of horizontally and vertically neighbouring texels of a (size, size) map."""
    if size < 2:
        return sp.csr_matrix((0, size * size))
    step = sp.diags([-np.ones(size - 1), np.ones(size - 1)], [0, 1], shape=(size - 1, size))
    unit = sp.identity(size)
    return sp.vstack([sp.kron(unit, step), sp.kron(step, unit)]).tocsr()

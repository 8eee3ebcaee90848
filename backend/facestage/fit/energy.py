"""The energy E_data + w1 E_prior + w2 E_light (Dib et al. 2019, eq. 1) and its normal equations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_erosion

from facestage.contract.job import Weights
from facestage.contract.light_stage import LightStage
from facestage.fit.landmark_term import LandmarkTerm
from facestage.fit.noise import NoiseModel, estimate_noise
from facestage.fit.parameters import Layout, LightParameters, State
from facestage.fit.photometric import jacobian_blocks
from facestage.fit.priors import Priors
from facestage.fit.shading import ForwardModel, Image, Surface
from facestage.fit.shadow_edges import MOVES_SHADOWS, Penumbra, ShadowEdges, find_penumbra, refined, shadow_edges

# Cosines between view and surface where a pixel starts to count and counts in full: at grazing view
# a pixel mixes surfaces, and where the silhouette runs is not in the derivative.
VIEW_COSINE_ZERO, VIEW_COSINE_FULL = 0.15, 0.45


@dataclass(frozen=True)
class Photo:
    """The photograph at the resolution of a stage."""

    color: np.ndarray  # (h, w, 3) linear
    usable: np.ndarray  # (h, w) bool: finite, not masked out
    skin: np.ndarray  # (h, w) 0..1, how much the color is the face's own
    clipped: np.ndarray  # (h, w, 3) bool: "at least this bright"


@dataclass(frozen=True)
class Evaluation:
    """The model's answer at one state, and how it compares to the photo."""

    state: State
    image: Image
    residual: np.ndarray  # (h, w, 3) model minus photo, 0 where unused
    highlight: np.ndarray  # (h, w, 1) the model's specular radiance, mean of the channels
    base_weight: np.ndarray  # (h, w) 0..1 before robust weighting
    seed: int
    stage: LightStage  # camera frame
    penumbra: Penumbra | None = None  # found where the motion of shadows counts


class PhotoTerm:
    """Residuals of the photo over the skin pixels, with weights from the noise they show."""

    def __init__(self, forward: ForwardModel, photo: Photo, samples: int, shadow_edges: bool = False) -> None:
        """``samples`` per light; ``shadow_edges``: whether the derivatives know how cast shadows move."""
        self.forward, self.photo, self.samples, self.shadow_edges = forward, photo, samples, shadow_edges

    def pixels(self, state: State) -> np.ndarray:
        """(P, 2) centres of the pixels in the face's bounding box."""
        height, width = self.photo.usable.shape
        _, vertices = self.forward.pose(state)
        projected = state.camera.project(vertices)
        projected = projected[np.isfinite(projected).all(1)]
        if not len(projected):
            return np.zeros((0, 2))
        low = np.clip(np.floor(projected.min(0)) - 1, 0, [width, height]).astype(int)
        high = np.clip(np.ceil(projected.max(0)) + 1, 0, [width, height]).astype(int)
        y, x = np.mgrid[low[1] : high[1], low[0] : high[0]]
        inside = self.photo.usable[low[1] : high[1], low[0] : high[0]]
        return np.stack([x[inside], y[inside]], axis=1) + 0.5

    def evaluate(self, state: State, stage: LightStage, seed: int) -> Evaluation:
        """Render the skin at ``state`` and compare; derivatives of the light terms are kept."""
        surface = self.forward.surface(state, self.pixels(state), only_fitted=True)
        y, x = self.index(surface)
        weight = self._base_weight(surface)
        terms = self.forward.light_terms(state, surface, stage, self.samples, seed, derivatives=True)
        penumbra = None
        if self.shadow_edges:
            penumbra = find_penumbra(self.forward, state, surface, stage, weight[y, x], seed)
            terms = refined(self.forward, state, surface, stage, terms, penumbra, self.samples, seed)
        image = self.forward.shade(state, surface, terms)
        residual = np.zeros((*weight.shape, 3))
        difference = image.color - self.photo.color[y, x]
        # A clipped pixel only says "at least this bright".
        residual[y, x] = np.where(self.photo.clipped[y, x] & (difference > 0), 0.0, difference)
        highlight = np.zeros((*weight.shape, 1))
        highlight[y, x, 0] = image.c_spec * image.specular.mean(axis=1)
        return Evaluation(state, image, residual, highlight, weight, seed, stage, penumbra)

    def _base_weight(self, surface: Surface) -> np.ndarray:
        """(h, w) 0..1 before robust weighting."""
        shape = self.photo.usable.shape
        weight, seen = np.zeros(shape), np.zeros(shape, bool)
        y, x = self.index(surface)
        cosine = -np.einsum("px,px->p", surface.normals, surface.rays)
        ramp = np.clip((cosine - VIEW_COSINE_ZERO) / (VIEW_COSINE_FULL - VIEW_COSINE_ZERO), 0, 1)
        weight[y, x] = ramp * self.photo.skin[y, x]
        # Pixels beside another part (eye, mouth, background) mix both in the photo.
        seen[y, x] = True
        return weight * binary_erosion(seen, border_value=1)

    def penumbra_share(self, state: State, stage: LightStage, seed: int) -> float:
        """Share of the light on the compared pixels, unshadowed, that comes from partly hidden lights."""
        surface = self.forward.surface(state, self.pixels(state), only_fitted=True)
        weight = self._base_weight(surface)[self.index(surface)]
        return find_penumbra(self.forward, state, surface, stage, weight, seed).share

    def index(self, surface: Surface) -> tuple[np.ndarray, np.ndarray]:
        """Row and column of each of the surface's pixels."""
        return surface.pixels[:, 1].astype(int), surface.pixels[:, 0].astype(int)

    def noise(self, evaluation: Evaluation) -> NoiseModel:
        """The noise that the residuals of an evaluation show."""
        return estimate_noise(evaluation.residual, self.photo.color, evaluation.base_weight > 0.5)

    def weights(self, evaluation: Evaluation, noise: NoiseModel, factor: float) -> np.ndarray:
        """(h, w) inverse variances, robust and correlation-corrected, per channel."""
        scale = noise.scale(self.photo.color, evaluation.residual, evaluation.highlight)
        robust = noise.robust(evaluation.residual / scale)
        return factor * noise.information() * evaluation.base_weight * (robust / scale**2)[..., 0]

    def normal_equations(
        self, evaluation: Evaluation, weights: np.ndarray, layout: Layout, active: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(size, size) Hessian and (size,) gradient, accumulated in float64."""
        hessian, gradient = np.zeros((layout.size, layout.size)), np.zeros(layout.size)
        y, x = self.index(evaluation.image.surface)
        root = np.sqrt(np.repeat(weights[y, x], 3))
        residual = evaluation.residual[y, x].ravel() * root
        texture = layout.slices["specular"]
        dense_columns = np.flatnonzero(active[: texture.start])
        grid = np.ix_(dense_columns, dense_columns)
        edges = self._edges(evaluation, layout, active)
        for block in jacobian_blocks(self.forward, evaluation.state, evaluation.image, layout, active, edges):
            scale = root[block.rows]
            dense = (block.dense[:, dense_columns] * scale[:, None]).astype(np.float64)
            hessian[grid] += dense.T @ dense
            gradient[dense_columns] += dense.T @ residual[block.rows]
            if active[texture].any():
                specular = block.specular.multiply(scale[:, None]).tocsr()
                cross = specular.T @ dense
                hessian[texture, dense_columns] += cross
                hessian[dense_columns, texture] += cross.T
                hessian[texture, texture] += (specular.T @ specular).toarray()
                gradient[texture] += specular.T @ residual[block.rows]
        return hessian, gradient

    def _edges(self, evaluation: Evaluation, layout: Layout, active: np.ndarray) -> ShadowEdges | None:
        if evaluation.penumbra is None or not active[layout.mask(MOVES_SHADOWS)].any():
            return None
        return shadow_edges(self.forward, evaluation.state, evaluation.image, evaluation.stage, evaluation.penumbra)


def common_energy(old: Evaluation, new: Evaluation, weights: np.ndarray) -> tuple[float, float]:
    """Photo energies of two evaluations under the same weights, over the pixels that both see."""
    both = (old.base_weight > 0) & (new.base_weight > 0)
    shared = np.where(both, weights, 0.0)[..., None]
    return 0.5 * float((shared * old.residual**2).sum()), 0.5 * float((shared * new.residual**2).sum())


@dataclass(frozen=True)
class Energy:
    """All terms of a stage."""

    layout: Layout
    priors: Priors
    landmarks: LandmarkTerm
    weights: Weights
    light_parameters: LightParameters
    photo: PhotoTerm | None = None
    stage: LightStage | None = None  # camera frame

"""The photo term: residuals of the photo over the skin, and their normal equations."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field
from typing import ClassVar, Self

import numpy as np
from scipy.ndimage import binary_erosion

from facestage.contract.arrays import Bool, Float, Int
from facestage.contract.light_stage import LightStage
from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.energy.noise import NoiseModel, estimate_noise
from facestage.fit.energy.normal_equations import NormalEquations
from facestage.fit.energy.photo_jacobian import Jacobian
from facestage.fit.energy.plan import Plan
from facestage.fit.energy.shadow_edges import (
    LINES,
    Penumbra,
    ShadowEdges,
    casting_lights,
    find_penumbra,
    refined,
    shadow_edges,
)
from facestage.fit.energy.term import Placed, Quadratic, Setup, Term, Weighed
from facestage.fit.face.lamps import turned
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import BLOCKS, SURFACE
from facestage.fit.forward.lamp_derivatives import AXES, PositionDerivatives, position_derivatives
from facestage.fit.forward.moving_bounces import MovingBounces, moving_bounces
from facestage.fit.forward.shading import ForwardModel, Image, Surface
from facestage.fit.given.photo import Photo
from facestage.render.light_terms import Asked, LightTerms

# Cosines between view and surface where a pixel starts to count and counts in full: at grazing view
# a pixel mixes surfaces, and where the silhouette runs is not in the derivative.
VIEW_COSINE_ZERO, VIEW_COSINE_FULL = 0.15, 0.45
# Of a quarter of the pixels, the neighbours of one are two pixels away.
QUARTERS = 4
TWO_AWAY = np.zeros((5, 5), bool)
TWO_AWAY[::2, 2] = TWO_AWAY[2, ::2] = True


@dataclass(frozen=True, eq=False)
class PhotoTerm(Term):
    """Residuals of the photo over the skin pixels, with weights from the noise they show."""

    words: ClassVar = {"photo": "Photo"}

    forward: ForwardModel
    photo: Photo
    stage: LightStage  # camera frame, before its lights are turned by a state's light_position
    samples: int  # per light and pixel
    blocks: frozenset[str] = frozenset(BLOCKS)  # whose derivatives will be asked for
    _: KW_ONLY
    plan: Plan = field(default_factory=Plan)
    held: int = 0  # parameters that have no column because they are frozen
    # about which lights turn
    pivot: Float[np.ndarray, " 3"] = field(default_factory=lambda: np.zeros(3))
    # lights whose shadows the derivatives know to move; None: no light's do.
    casting: Bool[np.ndarray, " lights"] | None = None
    weight: float = 1.0
    # 0 to 3: a quarter of the pixels alone, one of each square of four, counting four times;
    # None: all
    quarter: int | None = None

    @classmethod
    def of(cls, setup: Setup) -> Self | None:
        """Of every phase that sees the photo, with derivatives by what the phase may move."""
        if setup.photo is None or setup.stage is None:
            return None
        layout, plan = setup.layout, setup.plan
        wanted = layout.mask(setup.blocks)
        free = wanted & ~setup.freeze if plan.rules.columns else wanted
        held = int((wanted & setup.freeze & ~layout.mask(["specular"])).sum())
        return cls(
            setup.forward,
            setup.photo,
            setup.stage,
            setup.samples,
            frozenset(layout.blocks_of(free)),
            plan=plan,
            held=held,
            pivot=setup.pivot,
            casting=setup.casting,
            weight=setup.problem.job.weights.photo,
        )

    def at(self, state: State, evaluation: Evaluation | None = None) -> PlacedPhoto | None:
        """Silent where nobody evaluated it."""
        return None if evaluation is None else PlacedPhoto(self, evaluation)

    def pixels(self, state: State) -> Float[np.ndarray, "pixels 2"]:
        """The centres of the pixels in the bounding box of the face's skin."""
        height, width = self.photo.usable.shape
        low, high = np.array([0, 0]), np.array([width, height])
        if self.plan.rules.pixels:
            vertices = self.forward.pose(state)[1]
            projected = state.camera.project(vertices[self.forward.geometry.fitted_vertices])
            projected = projected[np.isfinite(projected).all(1)]
            if not len(projected):
                return np.zeros((0, 2))
            low = np.clip(np.floor(projected.min(0)) - 1, 0, high).astype(int)
            high = np.clip(np.ceil(projected.max(0)) + 1, 0, high).astype(int)
        y, x = np.mgrid[low[1] : high[1], low[0] : high[0]]
        inside = self.photo.usable[low[1] : high[1], low[0] : high[0]]
        if self.quarter is not None:
            inside = inside & (x % 2 + 2 * (y % 2) == self.quarter)
        return np.stack([x[inside], y[inside]], axis=1) + 0.5

    def evaluate(
        self, state: State, seed: int, resting: Bool[np.ndarray, " lights"] | None = None
    ) -> Evaluation:
        """Render the skin at ``state`` and compare; derivatives of the light terms are kept.

        ``resting``: dark lights that may be left out; None: all are traced.
        """
        rules, ledger = self.plan.rules, self.plan.ledger
        surface = self.forward.surface(state, self.pixels(state), only_fitted=True)
        weight = self._base_weight(surface)
        if rules.pixels:
            counted = weight[self.index(surface)] > 0
            ledger.skip("pixels", lit=int((~counted).sum()))
            surface = surface.part(counted)
        placed = turned(self.stage, state.light_position, self.pivot)
        terms = self._light_terms(state, surface, placed, seed, resting)
        y, x = self.index(surface)
        terms, penumbra = self._with_penumbra(state, surface, placed, terms, weight[y, x], seed)
        image = self._shade(state, surface, terms, weight)
        return self._compared(state, image, weight, seed, penumbra)

    def with_skin(self, evaluation: Evaluation, state: State) -> Evaluation:
        """``evaluation`` for a ``state`` that differs from its own in the skin alone: what light
        reaches it is the same.
        """
        surface, terms = evaluation.image.surface, evaluation.image.terms
        image = self._shade(state, surface, terms, evaluation.base_weight)
        return self._compared(
            state, image, evaluation.base_weight, evaluation.seed, evaluation.penumbra
        )

    def _shade(
        self,
        state: State,
        surface: Surface,
        terms: LightTerms,
        weight: Float[np.ndarray, "height width"],
    ) -> Image:
        """Light goes on below the pixels that count, whatever others the plan has lit."""
        spread = None
        if state.scattering > 0:
            counted = weight[self.index(surface)] > 0
            spread = self.forward.scattering(surface, state.scattering, counted)
        return self.forward.shade(state, surface, terms, spread=spread)

    def _compared(
        self,
        state: State,
        image: Image,
        weight: Float[np.ndarray, "height width"],
        seed: int,
        penumbra: Penumbra | None,
    ) -> Evaluation:
        shape = self.photo.usable.shape
        y, x = self.index(image.surface)
        residual, highlight = np.zeros((*shape, 3)), np.zeros((*shape, 1))
        difference = image.color - self.photo.color[y, x]
        # A clipped pixel only says "at least this bright".
        residual[y, x] = np.where(self.photo.clipped[y, x] & (difference > 0), 0.0, difference)
        highlight[y, x] = image.skin.gloss(image.specular.mean(axis=1, keepdims=True))
        return Evaluation(state, image, residual, highlight, weight, seed, penumbra)

    def _base_weight(self, surface: Surface) -> Float[np.ndarray, "height width"]:
        """How much, 0..1, a pixel counts before its residual is known."""
        shape = self.photo.usable.shape
        weight, seen = np.zeros(shape), np.zeros(shape, bool)
        y, x = self.index(surface)
        cosine = -np.einsum("px,px->p", surface.normals, surface.rays)
        ramp = np.clip((cosine - VIEW_COSINE_ZERO) / (VIEW_COSINE_FULL - VIEW_COSINE_ZERO), 0, 1)
        weight[y, x] = ramp * self.photo.skin[y, x]
        # Pixels beside another part (eye, mouth, background) mix both in the photo.
        seen[y, x] = True
        return weight * binary_erosion(
            seen, None if self.quarter is None else TWO_AWAY, border_value=1
        )

    def _light_terms(
        self,
        state: State,
        surface: Surface,
        stage: LightStage,
        seed: int,
        resting: Bool[np.ndarray, " lights"] | None,
    ) -> LightTerms:
        rules, ledger = self.plan.rules, self.plan.ledger
        traced = np.ones(len(stage), bool)
        if rules.lights and resting is not None:
            traced = ~resting
        pixels = len(surface.pixels)
        with ledger.timed(lit=pixels, samples=pixels * self.samples * int(traced.sum())) as done:
            terms = self.forward.light_terms(
                state, surface, stage, self.samples, seed, self._asked(state), traced=traced
            )
            done["rays"] = terms.pairs * self.samples
        ledger.skip("lights", samples=pixels * self.samples * int((~traced).sum()))
        ledger.skip("facing", rays=(pixels * int(traced.sum()) - terms.pairs) * self.samples)
        return terms

    def _asked(self, state: State) -> Asked:
        if not self.plan.rules.terms:
            return Asked(by_surface=True, by_roughness=True)
        return Asked(
            specular="specular" in self.blocks or bool(state.specular.any()),
            by_surface=not self.blocks.isdisjoint(SURFACE),
            by_roughness="roughness" in self.blocks,
        )

    def _with_penumbra(
        self,
        state: State,
        surface: Surface,
        stage: LightStage,
        terms: LightTerms,
        weight: Float[np.ndarray, " pixels"],
        seed: int,
    ) -> tuple[LightTerms, Penumbra | None]:
        """``terms`` with more samples where a casting light is partly hidden, and where that is."""
        ledger = self.plan.ledger
        if self.blocks.isdisjoint(SURFACE):
            return terms, None
        still = casting_lights(stage, self.forward.lights.radiance(state.lights))
        if self.casting is not None:
            still &= ~self.casting
        ledger.skip("shadows", lines=2 * LINES * len(weight) * int(still.sum()))
        if self.casting is None:
            return terms, None
        with ledger.timed() as done:
            penumbra = find_penumbra(
                self.forward, state, surface, stage, weight, self.casting, seed
            )
            done["lines"] = penumbra.lines
            terms = refined(
                self.forward,
                state,
                surface,
                stage,
                terms,
                penumbra,
                samples=self.samples,
                seed=seed,
                asked=self._asked(state),
            )
        return terms, penumbra

    def penumbra_share(
        self, state: State, casting: Bool[np.ndarray, " lights"], seed: int
    ) -> float:
        """Share of the light on the compared pixels, unshadowed, that comes from partly hidden
        ``casting`` lights.
        """
        surface = self.forward.surface(state, self.pixels(state), only_fitted=True)
        weight = self._base_weight(surface)[self.index(surface)]
        placed = turned(self.stage, state.light_position, self.pivot)
        return find_penumbra(self.forward, state, surface, placed, weight, casting, seed).share

    def index(
        self, surface: Surface
    ) -> tuple[Int[np.ndarray, " pixels"], Int[np.ndarray, " pixels"]]:
        """Row and column of each of the surface's pixels."""
        return surface.pixels[:, 1].astype(int), surface.pixels[:, 0].astype(int)

    def noise(self, evaluation: Evaluation) -> NoiseModel:
        """The noise that the residuals of an evaluation show."""
        return estimate_noise(evaluation.residual, self.photo.color, evaluation.counted)

    def weights(
        self, evaluation: Evaluation, noise: NoiseModel
    ) -> Float[np.ndarray, "height width"]:
        """The inverse variances, robust and correlation-corrected, per channel."""
        scale = noise.scale(self.photo.color, evaluation.residual, evaluation.highlight)
        robust = noise.robust(evaluation.residual / scale)
        weight = self.weight * noise.information() * (1 if self.quarter is None else QUARTERS)
        return weight * evaluation.base_weight * (robust / scale**2)[..., 0]

    def normal_equations(
        self,
        evaluation: Evaluation,
        weights: Float[np.ndarray, "height width"],
        layout: Layout,
        active: Bool[np.ndarray, " unknowns"],
    ) -> tuple[Float[np.ndarray, "unknowns unknowns"], Float[np.ndarray, " unknowns"]]:
        """Hessian and gradient, accumulated in float64."""
        rules, ledger = self.plan.rules, self.plan.ledger
        wanted = active if rules.columns else active | layout.mask(self.blocks)
        pixels = len(evaluation.image.color)
        with ledger.timed(lit=0) as done:
            jacobian = Jacobian(
                self.forward,
                evaluation.state,
                evaluation.image,
                layout,
                wanted,
                all_columns=not rules.columns,
                positions=self.position_derivatives(
                    evaluation, wanted[layout.slices["light_position"]]
                ),
                edges=self._edges(evaluation, wanted[layout.mask(SURFACE)]),
                bounces=self._bounces(evaluation, wanted[layout.mask((*SURFACE, "albedo"))]),
            )
            columns = len(jacobian.dense_columns) + len(jacobian.light_index)
            done["cells"] = pixels * columns
            system = NormalEquations(jacobian, layout)
            y, x = self.index(evaluation.image.surface)
            residual, weights = evaluation.residual[y, x], weights[y, x]
            for block in jacobian.blocks():
                system.add(block, residual[block.pixels], weights[block.pixels])
        if rules.columns:
            ledger.skip("columns", cells=pixels * (jacobian.unseen + self.held))
        return system.assembled()

    def _edges(
        self, evaluation: Evaluation, shape: Bool[np.ndarray, " shape"]
    ) -> ShadowEdges | None:
        """Where the shadows' edges lie; None when nothing of the ``shape`` is wanted, or
        no light counts.
        """
        if evaluation.penumbra is None or not shape.any():
            return None
        placed = turned(self.stage, evaluation.state.light_position, self.pivot)
        with self.plan.ledger.timed(lines=0):
            return shadow_edges(
                self.forward, evaluation.state, evaluation.image, placed, evaluation.penumbra
            )

    def _bounces(
        self, evaluation: Evaluation, wanted: Bool[np.ndarray, " _"]
    ) -> MovingBounces | None:
        """How light from skin to skin changes; None when nothing is ``wanted`` that changes it, or
        there is no such light.
        """
        if not wanted.any():
            return None
        state = evaluation.state
        placed = turned(self.stage, state.light_position, self.pivot)
        return moving_bounces(self.forward, state, evaluation.image, placed, evaluation.seed)

    def position_derivatives(
        self, evaluation: Evaluation, wanted: Bool[np.ndarray, " angles"]
    ) -> PositionDerivatives | None:
        """By the places of the ``wanted`` (2 N,) bool lights; None when there are none."""
        moving = wanted.reshape(-1, AXES).any(axis=1)
        if not moving.any():
            return None
        return position_derivatives(
            self.forward,
            evaluation.state,
            evaluation.image.surface,
            self.stage,
            self.pivot,
            moving,
            self.samples,
            evaluation.seed,
        )


@dataclass(frozen=True, eq=False)
class PlacedPhoto(Placed):
    """The photo beside what the model looks like at one state."""

    term: PhotoTerm
    evaluation: Evaluation

    def weighed(self, state: State) -> WeighedPhoto:
        """With the noise that it shows where it was evaluated."""
        noise = self.term.noise(self.evaluation)
        return WeighedPhoto(self.term, self.evaluation, self.term.weights(self.evaluation, noise))


@dataclass(frozen=True, eq=False)
class WeighedPhoto(Weighed):
    """The photo's residuals at one state and their frozen weights.

    The noise is estimated anew at every state, so there is no energy beside that of frozen weights.
    """

    term: PhotoTerm
    evaluation: Evaluation
    weights: Float[np.ndarray, "height width"]

    @property
    def energies(self) -> dict[str, float]:
        """Half the weighted sum of squares."""
        return {"photo": common_energy(self.evaluation, self.evaluation, self.weights)[0]}

    def add_to(self, total: Quadratic) -> None:
        """The columns of what a step may move, alone."""
        hessian, gradient = self.term.normal_equations(
            self.evaluation, self.weights, total.layout, total.active
        )
        np.add(total.hessian, hessian, out=total.hessian)
        np.add(total.gradient, gradient, out=total.gradient)

    def decrease(self, state: State, evaluation: Evaluation | None) -> float:
        """Over the pixels that both states see."""
        if evaluation is None:
            return 0.0
        old, new = common_energy(self.evaluation, evaluation, self.weights)
        return old - new


def common_energy(
    old: Evaluation, new: Evaluation, weights: Float[np.ndarray, "height width"]
) -> tuple[float, float]:
    """Photo energies of two evaluations under the same weights, over the pixels that both see."""
    both = (old.base_weight > 0) & (new.base_weight > 0)
    shared = np.where(both, weights, 0.0)[..., None]
    before, after = ((shared * one.residual**2).sum() for one in (old, new))
    return 0.5 * float(before), 0.5 * float(after)

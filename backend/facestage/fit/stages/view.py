"""One photo of a fit: what it brings to each phase, and what it remembers between
phases.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.errors import InputError
from facestage.contract.job import AUTO, KNOWN, WITHOUT
from facestage.contract.light_stage import ON, LightStage, lights_behind, selected
from facestage.fit.energy.energy import Energy
from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.energy.photo_term import PhotoTerm
from facestage.fit.energy.plan import Plan, Rules
from facestage.fit.energy.shadow_edges import PENUMBRA_MIN, lamps_known
from facestage.fit.energy.term import Setup
from facestage.fit.face.lamps import strong_lights, turned
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import BELOW, LAMPS, SHAPE, SKIN, Known, kept_shapes, start_values
from facestage.fit.face.white_balance import WhiteBalance
from facestage.fit.forward.lamp_derivatives import AXES
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.gaze import looks_apart
from facestage.fit.given.lids import shut_weights
from facestage.fit.given.problem import Problem
from facestage.fit.given.teeth import expression_deviations
from facestage.fit.stages.below import FIRST_STRENGTH, Below, look_below
from facestage.fit.stages.dark_regions import dark_regions, still_dark
from facestage.fit.stages.exposed_tone import as_light_as_exposed, is_darker
from facestage.fit.stages.initialize import exposure, initial_lights, initial_pose
from facestage.fit.stages.phases import Phase, PhaseName
from facestage.fit.stages.photo_descent import PhotoDescent
from facestage.fit.stages.skin_to_skin import SkinToSkin, look_between
from facestage.fit.stages.surround import Surround, look_behind
from facestage.fit.stages.visible import VisiblePhoto, resized_mask

# Side over distance beyond which a light needs more samples in proportion, up to a limit: their
# noise would otherwise be taken for shape.
WIDE_LIGHT, SAMPLES_FACTOR_MAX = 0.5, 8.0
# Of all the light that skin sends to skin, which adds about 5 % to direct light (root mean square,
# docs/transport.md): less than half a percent is left out.
INTERREFLECTION_MIN, TRANSLUCENCY_MIN = 0.1, 0.1
# What light does in skin and that is left out where a photo shows less of it.
STRENGTHS_MIN = {"interreflection": INTERREFLECTION_MIN, "translucency": TRANSLUCENCY_MIN}


@dataclass(frozen=True)
class Memory:
    """What a view knows from the phases before."""

    light_scale: float
    penumbra: float | None
    camera_to_stage: np.ndarray | None  # (4, 4)
    strong: np.ndarray  # (N,) bool, the lights whose position is fitted
    # (h, w) bool at the size of the first photo phase; None before it was looked for
    hidden: np.ndarray | None
    # likewise, what is darker than light explains
    dark: np.ndarray | None = None
    surround: Surround | None = None  # None before it was looked for, and where it is not wanted
    exposure: float = 1.0
    between: SkinToSkin | None = None  # None before it was looked for, and where it is not wanted


class View:
    """A problem with its renderer: makes the solver's descent in any phase from any state.

    States are at the photo's full size; a phase works on them scaled by the phase's factor.
    """

    def __init__(
        self, problem: Problem, forward: ForwardModel, penumbra_min: float = PENUMBRA_MIN
    ) -> None:
        """``penumbra_min``: share of the light in penumbra from which on shadows are followed as
        they move.
        """
        self._penumbra_min = penumbra_min
        self.problem, self.forward = problem, forward
        self.visible = VisiblePhoto(problem)
        self.light_scale = 1.0
        self.penumbra: float | None = None
        self.camera_to_stage = problem.job.camera_to_stage
        # (N,) bool, the lights whose position is fitted.
        self.strong = np.zeros(len(problem.lit_stage), bool)
        self.surround: Surround | None = None
        self.between: SkinToSkin | None = None  # likewise
        self.below: Below | None = None  # None before it was looked for, and where it is not wanted
        self.samples_factor = self._samples_factor()
        self.plan = Plan(Rules.of(problem.job.plan))

    @property
    def memory(self) -> Memory:
        """What later phases depend on beside the state."""
        return Memory(
            self.light_scale,
            self.penumbra,
            self.camera_to_stage,
            self.strong,
            self.visible.hidden,
            self.visible.dark,
            self.surround,
            self.problem.exposure,
            self.between,
        )

    @memory.setter
    def memory(self, known: Memory) -> None:
        self.light_scale, self.penumbra, self.strong = (
            known.light_scale,
            known.penumbra,
            known.strong,
        )
        self.camera_to_stage, self.surround = known.camera_to_stage, known.surround
        self.between = known.between
        self.visible.hidden, self.visible.dark = known.hidden, known.dark

    def lit_from_behind(self, numbers: Sequence[int] | None = None) -> View:
        """The same photo with lights behind the face; ``numbers``: these of them, None: all."""
        behind = lights_behind(self.problem.stage)
        if behind is None:
            return self
        if numbers is not None:
            behind = selected(behind, np.array(numbers, int))
        return self._of(self.problem.lit_from_behind(behind))

    def exposed(self, exposure: float) -> View:
        """The same photo with the lights that are held ``exposure`` times as bright as the job has
        them.
        """
        return self._of(replace(self.problem, exposure=exposure))

    def _of(self, problem: Problem) -> View:
        view = View(problem, ForwardModel(problem.geometry, problem.lights), self._penumbra_min)
        view.camera_to_stage, view.plan = self.camera_to_stage, self.plan
        return view

    def lit(self, phase: Phase, state: State) -> View:
        """The same photo with all that is to be found of its lights before the first is fitted.

        ``state`` is where the landmark phases ended, ``phase`` the first that looks at the photo.
        """
        return self.with_exposure(phase, state).with_surround(phase, state)

    def with_exposure(self, phase: Phase, state: State) -> View:
        """The same photo, with the lights that are held as bright as it was exposed, where the job
        does not know that.
        """
        if self.problem.job.exposure == KNOWN or not self.problem.lights.fixed_radiance.any():
            return self
        photo = self.photo_term(phase, state)
        if photo is None:
            return self
        evaluation = photo.evaluate(self.scaled(phase, state), self.problem.job.seed)
        found = exposure(photo, evaluation, self.problem.lights.fixed_radiance)
        return self.exposed(found)

    def with_surround(self, phase: Phase, state: State) -> View:
        """The same photo, with lights behind the face where it needs them, or the job asks for
        them.

        ``state`` is where the landmark phases ended, ``phase`` the first that looks at the photo.
        """
        job, around = self.problem.job, self.lit_from_behind()
        if job.surround == WITHOUT or around is self or "lights" in job.freeze:
            return self
        if job.surround == AUTO and (self.problem.stage.state != ON).any():
            return self  # somebody has said where light comes from
        dark = around.unlit(state)
        photo = around.photo_term(phase, dark)
        if photo is None:
            return self
        found = look_behind(photo, around.scaled(phase, dark), around.problem.added, job)
        view = self.lit_from_behind(found.lights) if found.joined else self
        view.surround = found
        return view

    def unlit(self, state: State) -> State:
        """``state`` with all lights dark, in their places."""
        return replace(
            state,
            lights=np.zeros(self.problem.lights.size),
            light_position=np.zeros((len(self.problem.lit_stage), AXES)),
        )

    def start_state(self) -> State:
        """Where a fit starts: the job's own values, else the landmarks' pose and the mean of
        everything.
        """
        problem, initial = self.problem, self.problem.job.initial
        camera = problem.start_camera
        rotation, translation = initial_pose(problem.geometry, problem.landmarks, camera)
        if "model_to_camera" in initial:
            rotation, translation = (
                initial["model_to_camera"][:3, :3],
                initial["model_to_camera"][:3, 3],
            )
        shapes = kept_shapes(problem.geometry.model, problem.fineness.specular_size)
        return State(
            rotation=rotation,
            translation=translation,
            camera=camera,
            lights=np.zeros(problem.lights.size),
            light_position=np.zeros((len(problem.lit_stage), AXES)),
            relief=np.zeros(len(problem.geometry.relief_basis)),
            **start_values(initial, shapes),
        )

    def known(self, phase: Phase, state: State) -> Known:
        """What bounds and priors depend on in ``phase`` that begins at ``state``."""
        problem = self.problem
        return Known(
            problem.lights,
            problem.camera.scaled(self.factor(phase)).focal_px,
            problem.focal_sigma,
            problem.geometry.model.expression_box,
            self.light_scale,
            int((problem.stage.position[:, 2] >= 0).sum()),
            shut_weights(problem.geometry.model, problem.landmarks),
            expression_deviations(problem.geometry.model, problem.closed_teeth),
            self._white_balance(state),
            looks_apart(problem.geometry.model, problem.landmarks),
        )

    def _white_balance(self, state: State) -> WhiteBalance | None:
        """What the photo's grey says of the light, where the job knows it."""
        grey = self.problem.grey
        if grey is None:
            return None
        stage = self.placed_stage(state)
        towards = stage.position - state.translation
        distance = np.maximum(np.linalg.norm(towards, axis=1), 1e-3)
        return WhiteBalance.of(
            grey,
            towards / distance[:, None],
            (stage.side / distance) ** 2,
            stage.radiance,
            -state.translation / np.linalg.norm(state.translation),
        )

    def frozen(self) -> set[str]:
        """Blocks that the job, or a known camera, holds."""
        return set(self.problem.job.freeze) | (set() if self.problem.fit_focal else {"focal"})

    def held(self, state: State) -> np.ndarray:
        """(size,) bool: parameters that the job, or a known camera, holds, the places of weak
        lights, and light from skin to skin and below the skin where ``state`` has none.
        """
        layout = Layout(state)
        held = layout.mask(self.frozen())
        for name in STRENGTHS_MIN:
            if not getattr(state, name):
                held |= layout.mask({name})
        if not state.scattering:
            held |= layout.mask(BELOW)
        held[layout.slices["light_position"]] |= ~np.repeat(self.strong, AXES)
        return held

    def free_shape(self, layout: Layout) -> int:
        """How many parameters of the shape are fitted."""
        return int((layout.mask(SHAPE) & ~layout.mask(self.frozen())).sum())

    def choose_lamps(self, state: State) -> None:
        """Before a phase: the strongest lights may move, unless someone put each light in its
        lamp's place.
        """
        if state.lights.any() and not lamps_known(self.problem.job):
            lights = self.problem.lights
            self.strong = strong_lights(
                self.problem.lit_stage, lights.radiance(state.lights), lights.fitted
            )

    def factor(self, phase: Phase) -> float:
        """What a phase scales the photo by."""
        return 1.0 if phase.face_px is None else self.problem.scale(phase.face_px)

    def scaled(self, phase: Phase, state: State) -> State:
        """The state with the camera of the phase's photo."""
        return replace(state, camera=state.camera.scaled(self.factor(phase)))

    def full_size(self, phase: Phase, scaled: State, reference: State) -> State:
        """The phase's state with the camera of the full photo."""
        focal_px = scaled.camera.focal_px / self.factor(phase)
        return replace(scaled, camera=replace(reference.camera, focal_px=focal_px))

    def anchor(self, state: State) -> np.ndarray:
        """camera_to_stage: the job's, or axes parallel to the camera's with the face at the
        centre.
        """
        if self.camera_to_stage is None:
            self.camera_to_stage = np.eye(4)
            self.camera_to_stage[:3, 3] = -state.translation
        return self.camera_to_stage

    def without_next_to_nothing(self, state: State) -> State:
        """Before a phase: without light from skin to skin, and light that comes out of it unevenly,
        where the photo has shown hardly any.
        """
        frozen = self.frozen()
        nothing: dict[str, Any] = {
            name: 0.0
            for name, least in STRENGTHS_MIN.items()
            if getattr(state, name) < least and name not in frozen
        }
        return replace(state, **nothing) if nothing else state

    def without_unseen_bounces(self, phase: Phase, state: State) -> State:
        """Before the phase that comes after the shape's first: without light from skin to skin
        where the photo shows none.
        """
        held = "interreflection" in self.frozen() or not state.interreflection
        if held or phase.name != PhaseName.SPECULAR:
            return state
        whole = replace(phase, blocks=SHAPE + SKIN + LAMPS)
        descent = self.descent(whole, state)
        if descent is None:
            return state
        seed = self.problem.job.seed + phase.seed
        self.between = look_between(descent, self.scaled(phase, state), seed)
        return state if self.between.joined else replace(state, interreflection=0.0)

    def with_scattering(self, phase: Phase, state: State) -> State:
        """Before a phase that says how far light wanders below the skin: with some of it, where the
        photo shows it.
        """
        looked_for = set(BELOW) & set(phase.blocks) - self.frozen()
        if state.scattering or not looked_for:
            return state
        photo = self.photo_term(phase, state)
        if photo is None:
            return state
        self.below = look_below(photo, self.scaled(phase, state), self.problem.job.seed)
        return replace(state, scattering=FIRST_STRENGTH) if self.below.joined else state

    def placed_stage(self, state: State) -> LightStage:
        """The lit lights in the camera frame, where ``state`` turned them to and as bright as it
        says.
        """
        stage = turned(self._stage_in_camera(state), state.light_position, self._pivot(state))
        return stage.with_radiance(self.problem.lights.radiance(state.lights))

    def descent(self, phase: Phase, state: State) -> PhotoDescent | None:
        """The solver over a phase, or None when all it could move is frozen."""
        setup = self._setup(phase, state)
        if setup is None:
            return None
        setup = replace(setup, casting=self._casting(phase, setup))
        low, high = setup.layout.bounds(setup.known)
        energy = Energy.of(setup)
        return PhotoDescent(
            phase.title,
            phase.blocks,
            energy,
            phase.steps,
            setup.freeze,
            low,
            high,
            further=phase.further,
            settled_share=self.problem.fineness.settled_share,
        )

    def with_initial_lights(
        self, phase: Phase, state: State, skin: Float[np.ndarray, " albedos"] | None = None
    ) -> State:
        """Before the first photo phase: lights by non-negative least squares, the scale of E_light,
        what hides the face, what is darker than light explains, and the tone of the skin: ``skin``,
        None: by the exposure.
        """
        problem = self.problem
        if state.lights.any() or not problem.lights.size:
            return state
        self.visible.hidden = self.visible.dark = None
        photo, scaled = self.photo_term(phase, state), self.scaled(phase, state)
        if photo is None:
            return state
        evaluation = photo.evaluate(scaled, problem.job.seed)
        if len(evaluation.image.color) == 0:
            raise InputError(
                "None of the photo's usable pixels shows the face where the landmarks put it; "
                "check the landmarks and the photo's alpha mask."
            )
        albedo = as_light_as_exposed(problem, photo, evaluation) if skin is None else skin
        start = replace(state, albedo=albedo)
        # Beside skin that may be too light, brows would be too dark for any light.
        beside = start if is_darker(problem, albedo) else state
        if (beside.albedo != state.albedo).any():
            scaled = self.scaled(phase, beside)
            evaluation = photo.evaluate(scaled, problem.job.seed)
        radiance = initial_lights(evaluation, photo, problem.lights)
        hidden = self.visible.look_for_occluders(photo, evaluation, radiance)
        if hidden.any() and not hidden.all():
            photo, evaluation, radiance = self._lit_again(phase, photo, scaled)
        if not hidden.all():
            self.visible.dark = dark_regions(photo, evaluation, problem.lights)
            if self.visible.dark.any():
                radiance = self._lit_again(phase, photo, scaled)[2]
        if (albedo != beside.albedo).any():
            radiance = self._lit_again(phase, photo, self.scaled(phase, start))[2]
        self.light_scale = max(float(radiance[problem.lights.fitted].mean()), 1e-9)
        return replace(start, lights=problem.lights.from_radiance(radiance))

    def look_again(self, phase: Phase, state: State) -> None:
        """Before a later phase: which dark regions are explained by now, and count."""
        dark = self.visible.dark
        if dark is None or not dark.any():
            return
        self.visible.dark = None
        photo = self.photo_term(phase, state)
        self.visible.dark = dark
        if photo is None:
            return
        evaluation = photo.evaluate(self.scaled(phase, state), self.problem.job.seed)
        there = resized_mask(dark, *photo.photo.usable.shape)
        self.visible.dark = still_dark(there, photo, evaluation)

    def _lit_again(
        self, phase: Phase, photo: PhotoTerm, scaled: State
    ) -> tuple[PhotoTerm, Evaluation, np.ndarray]:
        """``photo`` without what is known by now to be hidden or dark, what it shows at ``scaled``,
        and the light by least squares.
        """
        seen = replace(photo, photo=self.visible.at(self.factor(phase)))
        evaluation = seen.evaluate(scaled, self.problem.job.seed)
        return seen, evaluation, initial_lights(evaluation, seen, self.problem.lights)

    def photo_term(self, phase: Phase, state: State) -> PhotoTerm | None:
        """What compares the photo in ``phase``; None where it moves nothing by the photo."""
        setup = self._setup(phase, state)
        return None if setup is None else PhotoTerm.of(setup)

    def _setup(self, phase: Phase, state: State) -> Setup | None:
        """What the terms of a phase are made from, shadows held; None when all that it could move
        is frozen.
        """
        layout, freeze = Layout(state), self.held(state)
        if not (layout.mask(phase.blocks) & ~freeze).any():
            return None
        scaled = self.scaled(phase, state)
        setup = Setup(
            problem=self.problem,
            forward=self.forward,
            layout=layout,
            start=scaled,
            factor=self.factor(phase),
            blocks=phase.blocks,
            freeze=freeze,
            known=self.known(phase, state),
            plan=self.plan,
        )
        if phase.face_px is None:
            return setup
        return replace(
            setup,
            photo=self.visible.at(setup.factor),
            stage=self._stage_in_camera(scaled),
            pivot=self._pivot(scaled),
            samples=phase.samples * self.samples_factor,
        )

    def _samples_factor(self) -> int:
        """How many times more samples than usual the lights need, by the one that looks widest from
        the face.
        """
        stage, face = self.problem.lit_stage, np.zeros(3)
        if self.camera_to_stage is not None:
            # The landmarks' pose, so that a resumed fit finds the same.
            _, translation = initial_pose(
                self.problem.geometry, self.problem.landmarks, self.problem.camera
            )
            face = self.camera_to_stage[:3, :3] @ translation + self.camera_to_stage[:3, 3]
        distance = np.maximum(np.linalg.norm(stage.position - face, axis=1), 1e-3)
        return int(
            np.clip(np.ceil((stage.side / distance).max() / WIDE_LIGHT), 1, SAMPLES_FACTOR_MAX)
        )

    def _stage_in_camera(self, state: State) -> LightStage:
        """The lit lights where the job has them."""
        return self.problem.lit_stage.transformed(np.linalg.inv(self.anchor(state)))

    def _pivot(self, state: State) -> np.ndarray:
        """(3,) the stage's centre in the camera frame."""
        return np.linalg.inv(self.anchor(state))[:3, 3]

    def _casting(self, phase: Phase, setup: Setup) -> np.ndarray | None:
        """(N,) bool, the lights whose shadows the phase follows as they move; None when that is not
        worth it.
        """
        photo = PhotoTerm.of(setup) if phase.shadow_edges else None
        if photo is None or photo.blocks.isdisjoint(SHAPE):
            return None
        known = lamps_known(self.problem.job)
        casting = np.ones_like(self.strong) if known else self.strong
        self.penumbra = photo.penumbra_share(setup.start, casting, self.problem.job.seed)
        return casting if self.penumbra >= self._penumbra_min else None

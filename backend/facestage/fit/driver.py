"""Runs a fit: phases of the schedule over one problem, with checkpoints, progress and a deadline."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.job import Job
from facestage.contract.light_stage import LightStage
from facestage.contract.quality import BEST, DRAFT
from facestage.fit.checkpoint import Checkpoint
from facestage.fit.directions import find_null_directions
from facestage.fit.energy import Energy, Evaluation, Photo, PhotoTerm
from facestage.fit.guard import doubt, informative_share, landmark_statistic, statistic_limit
from facestage.fit.initialize import initial_lights, initial_pose
from facestage.fit.landmark_term import LandmarkTerm
from facestage.fit.lens_check import LensCheck, check_lens
from facestage.fit.light_position import AXES, strong_lights, turned
from facestage.fit.metrics import psnr
from facestage.fit.occlusion import flat_occluders, without
from facestage.fit.parameters import Layout, State
from facestage.fit.plan import Ledger, Plan, Rules
from facestage.fit.priors import ROUGHNESS_MEAN, SPECULAR_MEAN, Priors
from facestage.fit.problem import COARSE_FACE_PX, FINE_FACE_PX, SPECULAR_SIZE, Problem
from facestage.fit.schedule import Iteration, Stage
from facestage.fit.shading import ForwardModel
from facestage.fit.shading_doubt import shading_doubt
from facestage.fit.shadow_edges import PENUMBRA_MIN, lamps_known
from facestage.fit.silhouette import SilhouetteTerm
from facestage.fit.solver import Damping
from facestage.fit.truth import Truth
from facestage.fit.uncertainty import Certainty, covariance, describe, deviations
from facestage.fit.vertex_certainty import vertex_deviation
from facestage.image_io import resize

# Standard deviation of a landmark as a share of the face's size: one pixel on a face of 120.
LANDMARK_SIGMA_SHARE = 0.0085
CHANNEL_NAMES = ("red", "green", "blue")
# Side over distance beyond which a light needs more samples in proportion, up to a limit: their noise would
# otherwise be taken for shape.
WIDE_LIGHT, SAMPLES_FACTOR_MAX = 0.5, 8.0
# Share of the face that must be left to see; with less, the photo says nothing of the shape.
VISIBLE_SHARE_MIN = 0.1
LENS_STEPS = 6
# A phase that ends at its last step has settled when this step lowered the photo's residual by less than this share.
SETTLED_SHARE = 0.05


@dataclass(frozen=True)
class Phase:
    """A step of the schedule: what moves, at which size of the face, with how many light samples."""

    name: str
    blocks: tuple[str, ...]
    face_px: float | None  # None: landmarks only
    steps: int
    samples: int = 2
    share: float = 0.1  # of the whole work, for the progress bar
    shadow_edges: bool = False  # whether the derivatives know how cast shadows move


SHAPE = ("pose", "focal", "identity", "expression")
SKIN = ("lights", "albedo")
LAMPS = ("light_position",)
GLOSS = ("specular", "roughness")
PHASES = (
    Phase("pose", ("pose", "focal"), None, 20, share=0.01),
    Phase("landmarks", SHAPE, None, 30, share=0.04),
    Phase("light and albedo", SKIN, COARSE_FACE_PX, 4, share=0.10),
    Phase("geometry", SHAPE + SKIN + LAMPS, COARSE_FACE_PX, 8, share=0.25),
    Phase("specular", SKIN + GLOSS, COARSE_FACE_PX, 3, share=0.10),
    Phase("joint", SHAPE + SKIN + LAMPS + GLOSS, FINE_FACE_PX, 8, samples=4, share=0.40),
)

# What the best quality does in the last phase: a face of more pixels, less noise in the light, more steps.
BEST_JOINT: dict[str, Any] = {"face_px": 1.35 * FINE_FACE_PX, "steps": 20, "samples": 8}


@dataclass(frozen=True)
class Schedule:
    """The phases of a run: what trades time for accuracy."""

    phases: tuple[Phase, ...] = field(default_factory=lambda: PHASES)

    def scaled(self, resolution: float = 1.0, samples: float = 1.0) -> Schedule:
        """Every photo phase at ``resolution`` times the pixels along a side and ``samples`` times the light samples."""
        return Schedule(
            tuple(
                phase
                if phase.face_px is None
                else replace(phase, face_px=phase.face_px * resolution, samples=max(round(phase.samples * samples), 1))
                for phase in self.phases
            )
        )

    @classmethod
    def of(cls, quality: str) -> Schedule:
        """The schedule of a job's quality."""
        if quality == DRAFT:
            return cls().until("joint")
        if quality == BEST:
            finer = replace(PHASES[-1], **BEST_JOINT)
            return cls((*PHASES[:-1], finer))
        return cls()

    def with_shadow_edges(self, on: bool) -> Schedule:
        """Every photo phase that moves the shape with, or without, the motion of cast shadows in its derivatives."""
        return Schedule(
            tuple(
                phase
                if phase.face_px is None
                else replace(phase, shadow_edges=on and not set(phase.blocks).isdisjoint(SHAPE))
                for phase in self.phases
            )
        )

    def until(self, name: str) -> Schedule:
        """The phases before the one called ``name``."""
        names = [phase.name for phase in self.phases]
        return Schedule(self.phases[: names.index(name)])


def default_schedule(job: Job) -> Schedule:
    """The schedule of a job's quality: cast shadows move in its derivatives where the lamps' places are known."""
    return Schedule.of(job.quality).with_shadow_edges(lamps_known(job))


@dataclass(frozen=True)
class Progress:
    """What a listener hears after each step."""

    phase: str
    iteration: int
    fraction: float
    seconds: float
    photo_rms: float | None
    evaluation: Evaluation | None
    photo: np.ndarray | None  # (h, w, 3) at the phase's resolution
    state: State  # at the photo's full size


@dataclass(frozen=True)
class Fitted:
    """Where the schedule ended."""

    state: State
    camera_to_stage: np.ndarray  # (4, 4)
    stage: LightStage  # lit lights, camera frame, at the fitted radiance
    trace: list[dict[str, Any]]
    energy: dict[str, float]
    condition: float
    seconds: float
    check_seconds: float  # afterwards: how sure it is, whether the lens can be right
    in_time: bool
    certainty: Certainty
    shading_doubt: np.ndarray | None  # (h, w) at the last phase's size, see shading_doubt.py
    hidden: np.ndarray  # (h, w) bool at the photo's size, what something flat hides
    doubt: str  # why the photo was not believed about the shape, which is then the landmarks' own; or empty
    settled: bool  # the last phase ended by itself, not at a limit or a wall
    lens: LensCheck | None  # None when the focal length was fitted
    landmark_statistic: float  # how far the photo pulled the shape from the landmarks', see guard.py
    ledger: Ledger = field(default_factory=Ledger)  # what was worked on, and what the plan left out
    penumbra: float | None = None  # share of the light on the face from partly hidden lights; None: did not look


class FitRun:
    """One fit. ``folder`` keeps the checkpoint; ``listen`` hears of each step; the clock is monotonic."""

    def __init__(
        self,
        problem: Problem,
        forward: ForwardModel,
        folder: Path,
        truth: Truth | None = None,
        listen: Callable[[Progress], None] = lambda progress: None,
        schedule: Schedule | None = None,
    ) -> None:
        self.problem, self.forward, self.folder = problem, forward, folder
        self.phases = (schedule or default_schedule(problem.job)).phases
        self.truth, self.listen = truth, listen
        self.trace: list[dict[str, Any]] = []
        self.light_scale = 1.0
        self.penumbra: float | None = None
        # (h, w) bool at the size of the first photo phase, what something flat hides; None before it was looked for.
        self.hidden: np.ndarray | None = None
        self.camera_to_stage = problem.job.camera_to_stage
        self.strong = np.zeros(len(problem.lit_stage), bool)
        self.samples_factor = self._samples_factor()
        self.plan = Plan(Rules.of(problem.job.plan))

    def run(self, deadline: float, checkpoint: Checkpoint | None = None) -> Fitted:
        """All phases from the start, or from ``checkpoint``, until done or ``deadline`` (time.monotonic)."""
        started = time.monotonic()
        state, first_phase, first_step, damping = self._start_state(), 0, 1, Damping()
        if checkpoint is not None:
            if checkpoint.fingerprint != self.problem.fingerprint:
                raise InputError(
                    f"The checkpoint in '{self.folder}' belongs to another job (photo, landmarks or options differ); "
                    "start again without --resume, or restore the options."
                )
            state, first_phase, first_step = checkpoint.state, checkpoint.phase, checkpoint.step + 1
            damping = Damping(*checkpoint.damping)
            self.trace, self.light_scale = list(checkpoint.trace), checkpoint.light_scale
            self.strong, self.hidden = checkpoint.strong, checkpoint.hidden
            started -= checkpoint.seconds
            if np.isfinite(checkpoint.camera_to_stage).all():
                self.camera_to_stage = checkpoint.camera_to_stage
        last: Iteration | None = None
        landmarks_only = [number for number, phase in enumerate(self.phases) if phase.face_px is None]
        anchor = self._landmark_state() if first_phase > max(landmarks_only, default=-1) else None
        for number in range(first_phase, len(self.phases)):
            phase = self.phases[number]
            if time.monotonic() > deadline and number > 1:
                break
            if first_step == 1 and state.lights.any() and self._lights_may_turn():
                lights = self.problem.lights
                self.strong = strong_lights(self.problem.lit_stage, lights.radiance(state.lights), lights.fitted)
            stage = self.solver_stage(phase, state)
            if stage is None:
                continue
            if phase.face_px is not None and first_step == 1:
                state = self.with_initial_lights(stage, state)
            if number == first_phase and first_step > 1:
                stage.damping = damping
                if checkpoint is not None and stage.energy.photo is not None:
                    stage.energy.photo.resting = checkpoint.resting if len(checkpoint.resting) else None
                    stage.energy.photo.casting = checkpoint.casting
            factor = self._factor(phase)
            scaled = replace(state, camera=state.camera.scaled(factor))
            for item in stage.run(scaled, self.problem.job.seed + number, deadline, first_step):
                state = self._full_size(item.state, state, factor)
                last = item
                seconds = time.monotonic() - started
                self._record(phase, item, stage, state, seconds)
                done = number + 1 if item.finished else number
                step = 0 if item.finished else item.number
                self._save(done, step, item.damping, state, seconds, stage)
                self.listen(self._progress(number, item, stage, state, seconds))
            first_step = 1
            if number == max(landmarks_only, default=-1):
                anchor = state
        clause, statistic = self._doubt(anchor or state, state, last)
        if clause:
            state, last = self._hold_shape(anchor or state, state, last, deadline, started)
        ended = time.monotonic()
        in_time = ended <= deadline
        certainty, doubt, lens = self._certainty(state, last), self._shading_doubt(last), self._lens(anchor or state)
        return Fitted(
            state, self._anchor(state), self.placed_stage(state),
            self.trace, last.energy if last else {}, last.condition if last else 1.0, ended - started,
            time.monotonic() - ended, in_time, certainty, doubt,
            self._hidden_at(self.problem.camera.height, self.problem.camera.width), clause,
            self._settled(), lens, statistic, self.plan.ledger, self.penumbra,
        )  # fmt: skip

    def _landmark_state(self) -> State:
        """Where the phases without the photo end, for a run that was resumed after them."""
        state = self._start_state()
        for number, phase in enumerate(self.phases):
            stage = self.solver_stage(phase, state) if phase.face_px is None else None
            if stage is not None:
                for item in stage.run(state, self.problem.job.seed + number, np.inf):
                    state = item.state
        return state

    def _doubt(self, start: State, end: State, last: Iteration | None) -> tuple[str, float]:
        """Why the photo is not believed about the shape at ``end``, if so, and the landmark statistic."""
        layout = Layout(end)
        free = int((layout.mask(SHAPE) & ~layout.mask(self._frozen())).sum())
        if last is None or last.evaluation is None or not free:
            return "", 0.0
        stage = self.solver_stage(Phase("landmarks", SHAPE, None, 0), start)
        assert stage is not None
        statistic = landmark_statistic(stage.energy, start, end)
        width = last.evaluation.base_weight.shape[1]
        share = informative_share(self._photo_at(width / self.problem.camera.width), last.evaluation)
        return doubt(statistic, statistic_limit(free), self.trace[-1].get("psnr"), share), statistic

    def _settled(self) -> bool:
        """Whether the last phase converged, rather than stop at its last step, or without a single one."""
        phase = self.phases[-1]
        if phase.face_px is None or not Layout(self._start_state()).mask(set(phase.blocks) - self._frozen()).any():
            return True
        errors = [row["photo_rms"] for row in self.trace if row["stage"] == phase.name]
        if len(errors) < 2:
            return bool(errors)
        if len(errors) < phase.steps or None in errors[-2:]:
            return True
        return bool(errors[-1] > (1 - SETTLED_SHARE) * errors[-2])

    def _lens(self, start: State) -> LensCheck | None:
        """Whether the landmarks speak against the known lens; ``start`` is where the landmark stage ended."""
        weights = self.problem.job.weights
        if self.problem.fit_focal or not weights.landmarks or not weights.prior:
            return None
        phase = Phase("lens", SHAPE, None, LENS_STEPS)
        return check_lens(lambda state: self.solver_stage(phase, state), start, self.problem.job.seed)

    def _hold_shape(
        self, start: State, end: State, last: Iteration | None, deadline: float, started: float
    ) -> tuple[State, Iteration | None]:
        """The landmarks' shape with light and skin fitted to it, as far as time allows; not in the checkpoint."""
        state = replace(
            end, rotation=start.rotation, translation=start.translation, camera=start.camera,
            identity=start.identity, expression=start.expression,
        )  # fmt: skip
        for number, phase in enumerate(self.phases):
            blocks = tuple(name for name in phase.blocks if name not in SHAPE)
            if phase.face_px is None or not blocks or time.monotonic() > deadline:
                continue
            held = replace(phase, name=f"{phase.name}, shape held", blocks=blocks)
            stage = self.solver_stage(held, state)
            if stage is None:
                continue
            factor = self._factor(held)
            scaled = replace(state, camera=state.camera.scaled(factor))
            for item in stage.run(scaled, self.problem.job.seed + number, deadline):
                state, last = self._full_size(item.state, state, factor), item
                self._record(held, item, stage, state, time.monotonic() - started)
        return state, last

    def _certainty(self, state: State, last: Iteration | None) -> Certainty:
        """What the last normal equations say of each parameter that was free, and of every vertex."""
        if last is None:
            return Certainty({}, {})
        layout, problem, names = Layout(state), self.problem, self._names()
        free = ~self._held(layout)
        found = describe(deviations(last.hessian, last.prior_hessian, free), layout, names)
        shape = slice(layout.slices["identity"].start, layout.slices["expression"].stop)
        model = problem.geometry.model
        region = model.regions.get("narrow_face", problem.geometry.used)
        vertices = vertex_deviation(
            model, model.shape(state.identity, state.expression), state.rotation,
            covariance(last.hessian, free)[shape, shape], region,
        )  # fmt: skip
        directions = find_null_directions(
            last.hessian, last.prior_hessian, free, state, problem.geometry, problem.lights, names
        )
        return replace(found, vertices_mm=vertices, directions=directions.to_json())

    def _shading_doubt(self, last: Iteration | None) -> np.ndarray | None:
        if last is None or last.evaluation is None:
            return None
        layout = Layout(last.state)
        known = covariance(last.hessian, ~self._held(layout))
        return shading_doubt(self.forward, last.evaluation, layout, known)

    def _names(self) -> dict[str, list[str]]:
        """Names of the parameters by block, where they have any."""
        problem, lights = self.problem, self.problem.lights
        numbers = np.flatnonzero(problem.lit)[lights.fitted].tolist()
        if lights.uniform:
            light_names = [f"light {number}" for number in numbers] + [f"color {channel}" for channel in CHANNEL_NAMES]
        else:
            light_names = [f"light {number} {channel}" for number in numbers for channel in CHANNEL_NAMES]
        model = problem.geometry.model
        return {
            "identity": list(model.identity_names), "expression": list(model.expression_names), "lights": light_names,
            "focal": ["focal"], "roughness": ["roughness"],
        }  # fmt: skip

    def _frozen(self) -> set[str]:
        """Blocks that the job, or a known camera, holds."""
        return set(self.problem.job.freeze) | (set() if self.problem.fit_focal else {"focal"})

    def _lights_may_turn(self) -> bool:
        """Not where someone put each light in its lamp's place."""
        return not lamps_known(self.problem.job)

    def _held(self, layout: Layout) -> np.ndarray:
        """(size,) bool: parameters that the job, or a known camera, holds, and the places of weak lights."""
        held = layout.mask(self._frozen())
        held[layout.slices["light_position"]] |= ~np.repeat(self.strong, AXES)
        return held

    def _samples_factor(self) -> int:
        """How many times more samples than usual the lights need, by the one that looks widest from the face."""
        stage, face = self.problem.lit_stage, np.zeros(3)
        if self.camera_to_stage is not None:
            # The landmarks' pose, so that a resumed fit finds the same.
            _, translation = initial_pose(self.problem.geometry, self.problem.landmarks, self.problem.camera)
            face = self.camera_to_stage[:3, :3] @ translation + self.camera_to_stage[:3, 3]
        distance = np.maximum(np.linalg.norm(stage.position - face, axis=1), 1e-3)
        return int(np.clip(np.ceil((stage.side / distance).max() / WIDE_LIGHT), 1, SAMPLES_FACTOR_MAX))

    def _start_state(self) -> State:
        problem, initial = self.problem, self.problem.job.initial
        model = problem.geometry.model
        rotation, translation = initial_pose(problem.geometry, problem.landmarks, problem.camera)
        if "model_to_camera" in initial:
            rotation, translation = initial["model_to_camera"][:3, :3], initial["model_to_camera"][:3, 3]
        size = SPECULAR_SIZE
        return State(
            rotation=rotation, translation=translation, camera=problem.camera,
            identity=initial.get("identity", np.zeros(len(model.identity_names))).astype(float),
            expression=initial.get("expression", np.zeros(len(model.expression_names))).astype(float),
            lights=np.zeros(problem.lights.size), light_position=np.zeros((len(problem.lit_stage), AXES)),
            albedo=initial.get("albedo", np.zeros(len(model.albedo_basis))).astype(float),
            roughness=float(initial.get("roughness", ROUGHNESS_MEAN)),
            specular=initial.get("specular", np.full((size, size), SPECULAR_MEAN)).astype(float),
        )  # fmt: skip

    def _factor(self, phase: Phase) -> float:
        return 1.0 if phase.face_px is None else self.problem.scale(phase.face_px)

    def _full_size(self, scaled: State, reference: State, factor: float) -> State:
        """The scaled state with the camera of the full photo."""
        return replace(scaled, camera=replace(reference.camera, focal_px=scaled.camera.focal_px / factor))

    def _anchor(self, state: State) -> np.ndarray:
        """camera_to_stage: the job's, or axes parallel to the camera's with the face at the centre."""
        if self.camera_to_stage is None:
            self.camera_to_stage = np.eye(4)
            self.camera_to_stage[:3, 3] = -state.translation
        return self.camera_to_stage

    def _stage_in_camera(self, state: State) -> LightStage:
        """The lit lights where the job has them."""
        return self.problem.lit_stage.transformed(np.linalg.inv(self._anchor(state)))

    def placed_stage(self, state: State) -> LightStage:
        """The lit lights in the camera frame, where ``state`` turned them to and as bright as it says."""
        stage = turned(self._stage_in_camera(state), state.light_position, self._pivot(state))
        return stage.with_radiance(self.problem.lights.radiance(state.lights))

    def _silhouette_term(self, phase: Phase, factor: float, frozen: np.ndarray) -> SilhouetteTerm | None:
        """None in phases that move no shape, where the outline is as it is."""
        layout = Layout(self._start_state())
        if phase.face_px is None or not (layout.mask(set(phase.blocks) & set(SHAPE)) & ~frozen).any():
            return None
        return SilhouetteTerm(self.forward, self._photo_at(factor), factor * self.problem.face_size_px)

    def _pivot(self, state: State) -> np.ndarray:
        """(3,) the stage's centre in the camera frame."""
        return np.linalg.inv(self._anchor(state))[:3, 3]

    def solver_stage(self, phase: Phase, state: State) -> Stage | None:
        """The solver's stage for a phase, or None when all it could move is frozen."""
        problem, job = self.problem, self.problem.job
        layout = Layout(state)
        freeze = self._held(layout)
        if not (layout.mask(phase.blocks) & ~freeze).any():
            return None
        factor = self._factor(phase)
        scaled = replace(state, camera=state.camera.scaled(factor))
        box = problem.geometry.model.expression_prior == "box"
        sigma = LANDMARK_SIGMA_SHARE * problem.face_size_px * factor
        priors = Priors(
            layout, replace(state, camera=problem.camera.scaled(factor)), box, job.weights, self.light_scale,
            len(problem.stage), problem.focal_sigma,
        )  # fmt: skip
        energy = Energy(
            layout, priors, LandmarkTerm(problem.geometry, problem.landmarks_at(factor), sigma),
            job.weights, problem.lights,
            photo=None if phase.face_px is None else self._photo_term(phase, layout, freeze, scaled, factor),
            stage=None if phase.face_px is None else self._stage_in_camera(scaled),
            silhouette=self._silhouette_term(phase, factor, freeze),
        )  # fmt: skip
        low, high = layout.bounds(box, len(problem.stage))
        return Stage(phase.name, phase.blocks, energy, phase.steps, freeze, low, high)

    def _photo_term(self, phase: Phase, layout: Layout, freeze: np.ndarray, scaled: State, factor: float) -> PhotoTerm:
        """The photo's residuals, with derivatives by what the phase may move."""
        wanted = layout.mask(phase.blocks)
        free = wanted & ~freeze if self.plan.rules.columns else wanted
        held = int((wanted & freeze)[: layout.slices["specular"].start].sum())
        photo = self._photo_at(factor)
        samples = phase.samples * self.samples_factor
        term = PhotoTerm(self.forward, photo, samples, layout.blocks_of(free), self.plan, held, self._pivot(scaled))
        term.casting = self._casting(phase, term, scaled)
        return term

    def _casting(self, phase: Phase, photo: PhotoTerm, scaled: State) -> np.ndarray | None:
        """(N,) bool, the lights whose shadows the phase follows as they move; None when that is not worth it."""
        if not phase.shadow_edges or photo.blocks.isdisjoint(SHAPE):
            return None
        known = lamps_known(self.problem.job)
        casting = np.ones_like(self.strong) if known else self.strong
        self.penumbra = photo.penumbra_share(scaled, self._stage_in_camera(scaled), casting, self.problem.job.seed)
        return casting if self.penumbra >= PENUMBRA_MIN else None

    def with_initial_lights(self, stage: Stage, state: State) -> State:
        """Before the first photo phase: lights by non-negative least squares, and the scale of E_light."""
        problem = self.problem
        if state.lights.any() or not problem.lights.size:
            return state
        photo, energy = stage.energy.photo, stage.energy
        assert photo is not None and energy.stage is not None
        factor = photo.photo.usable.shape[1] / problem.camera.width
        scaled = replace(state, camera=state.camera.scaled(factor))
        evaluation = photo.evaluate(scaled, energy.stage, problem.job.seed)
        if len(evaluation.image.color) == 0:
            raise InputError(
                "None of the photo's usable pixels shows the face where the landmarks put it; "
                "check the landmarks and the photo's alpha mask."
            )
        radiance = initial_lights(evaluation, photo, problem.lights)
        radiance = self._without_occluders(energy, evaluation, radiance)
        self.light_scale = max(float(radiance[problem.lights.fitted].mean()), 1e-9)
        energy.priors.light_scale = self.light_scale
        return replace(state, lights=problem.lights.from_radiance(radiance))

    def _without_occluders(self, energy: Energy, evaluation: Evaluation, radiance: np.ndarray) -> np.ndarray:
        """Look for what hides the face under the first estimate of the light; if found, estimate without it."""
        problem, photo, image = self.problem, energy.photo, evaluation.image
        assert photo is not None and energy.stage is not None
        shaded = self.forward.shade(evaluation.state, image.surface, image.terms, radiance=radiance)
        model = np.zeros_like(photo.photo.color)
        model[photo.index(image.surface)] = shaded.color
        used = (evaluation.base_weight > 0) & ~photo.photo.clipped.any(axis=2)
        factor = photo.photo.usable.shape[1] / problem.camera.width
        self.hidden = flat_occluders(photo.photo.color, model, used, factor * problem.face_size_px)
        if not (self.hidden & used).any():
            return radiance
        if (self.hidden & used).sum() > (1 - VISIBLE_SHARE_MIN) * used.sum():
            # Nothing hides all of a face that has landmarks: photo and light do not belong together, and the few
            # pixels that are left would bend the shape until they did.
            self.hidden = np.ones_like(self.hidden)
        photo.photo = without(photo.photo, self.hidden)
        if self.hidden.all():
            return radiance
        return initial_lights(photo.evaluate(evaluation.state, energy.stage, evaluation.seed), photo, problem.lights)

    def _photo_at(self, factor: float) -> Photo:
        """The photo resized by ``factor``, without what something flat hides."""
        photo = self.problem.photo_at(factor)
        if self.hidden is None or not self.hidden.any():
            return photo
        return without(photo, self._hidden_at(*photo.usable.shape))

    def _hidden_at(self, height: int, width: int) -> np.ndarray:
        """(height, width) bool, the pixels that something flat hides."""
        if self.hidden is None or not self.hidden.any():
            return np.zeros((height, width), bool)
        return resize(self.hidden.astype(np.float32), width, height) > 0

    def _record(self, phase: Phase, item: Iteration, stage: Stage, state: State, seconds: float) -> None:
        row: dict[str, Any] = {
            "seconds": seconds, "stage": phase.name, "iteration": item.number, "energy": item.energy,
            "condition": item.condition, "damping": item.damping.value,
        }  # fmt: skip
        if item.evaluation is not None and stage.energy.photo is not None:
            used = item.evaluation.base_weight > 0
            photo = stage.energy.photo.photo.color
            row["photo_rms"] = float(np.sqrt((item.evaluation.residual[used] ** 2).mean())) if used.any() else None
            row["psnr"] = psnr(photo + item.evaluation.residual, photo, used, self.problem.white)
        if self.truth is not None:
            row |= self.truth.geometry_errors(state)
        self.trace.append(row)

    def _save(self, phase: int, step: int, damping: Damping, state: State, seconds: float, stage: Stage) -> None:
        anchor = self.camera_to_stage if self.camera_to_stage is not None else np.full((4, 4), np.nan)
        casting = None if stage.energy.photo is None else stage.energy.photo.casting
        Checkpoint(
            self.problem.fingerprint, phase, step, (damping.value, damping.growth), self.light_scale,
            seconds, anchor, self.strong, state, self.trace, stage.resting, self.hidden, casting,
        ).save(self.folder)  # fmt: skip

    def _progress(self, number: int, item: Iteration, stage: Stage, state: State, seconds: float) -> Progress:
        phase = self.phases[number]
        done = sum(earlier.share for earlier in self.phases[:number])
        done += phase.share * (1.0 if item.finished else item.number / phase.steps)
        photo = None if stage.energy.photo is None else stage.energy.photo.photo.color
        rms = self.trace[-1].get("photo_rms")
        return Progress(phase.name, item.number, done, seconds, rms, item.evaluation, photo, state)

"""What the plan saves: three scenes fitted with and without it, and a step of each with one rule
off at a time.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TextIO

import numpy as np
from scipy.spatial.transform import Rotation

from facestage.contract.case_files import PHOTO
from facestage.contract.errors import EXIT_DONE, InputError
from facestage.contract.files.atomic import atomic_file
from facestage.contract.job import FULL, LEAN, WITHOUT, Job
from facestage.contract.light_stage import OFF, ON
from facestage.fit.energy.plan import Plan, Rules
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.forward.lamp_derivatives import AXES
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.fineness import USUAL, Fineness
from facestage.fit.given.problem import read_problem
from facestage.fit.given.truth import read_truth
from facestage.fit.runs.driver import FitRun
from facestage.fit.stages.phases import Schedule
from facestage.fit.trust.fitted import Fitted
from facestage.models.registry import load_model
from facestage.render.variant import start_renderer
from facestage.stress.scene import (
    Scene,
    exposed,
    job_of,
    plain_scene,
    render,
    with_stage,
    write_png,
)

TABLE = "plan.txt"
SIDE_PX, QUICK_SIDE_PX, SPECULAR_SIZE = 256, 112, 32
ROUNDS = 3  # of timing each rule; the shortest counts


@dataclass(frozen=True)
class Saving:
    """One scene under both plans.

    Seconds are the photo's steps alone; processor seconds do not count others' work.
    """

    scene: str
    lean_step: float
    full_step: float
    lean_step_cpu: float
    full_step_cpu: float
    lean_total: float
    full_total: float
    lean_mm: float  # similarity-aligned
    full_mm: float
    deviation: float  # largest difference of a parameter, in its standard deviations

    @property
    def ratio(self) -> float:
        """Processor seconds per step, full over lean."""
        return self.full_step_cpu / max(self.lean_step_cpu, 1e-9)


@dataclass(frozen=True)
class RuleSaving:
    """A joint step's processor seconds with all rules, and with one of them off."""

    scene: str
    rule: str
    with_rule: float
    without: float

    @property
    def ratio(self) -> float:
        """Without over with: 1 saves nothing."""
        return self.without / max(self.with_rule, 1e-9)


def run_plan_savings(
    model: str | None, out: Path, quick: bool, stream: TextIO, device: str = "auto", seed: int = 0
) -> int:
    """Measure, print to ``stream`` and write ``out``/plan.txt.

    Raises InputError for a folder that cannot be made.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"Cannot make the folder '{out}' ({error.strerror or error}); choose another."
        ) from error
    start_renderer(device)
    savings: list[Saving] = []
    rules: list[RuleSaving] = []
    with tempfile.TemporaryDirectory(prefix="facestage-plan-") as scratch:
        side = QUICK_SIDE_PX if quick else SIDE_PX
        for name, job in scenes(Path(scratch), model or "default", side, device, seed):
            saving, found = measure(name, job, Path(scratch))
            savings.append(saving)
            rules += found
            print(
                f"{name}: a step takes {saving.ratio:.2f} times as long without the plan",
                file=stream,
                flush=True,
            )
    lines = ["", *table_lines(savings), "", *rule_lines(rules)]
    print("\n".join(lines), file=stream, flush=True)
    with atomic_file(out / TABLE) as temporary:
        temporary.write_text("\n".join(lines[1:]) + "\n", encoding="utf-8")
    return EXIT_DONE


def scenes(
    folder: Path,
    model: str,
    side_px: int,
    device: str = "cpu",
    seed: int = 0,
    specular_size: int = SPECULAR_SIZE,
) -> Iterator[tuple[str, Job]]:
    """Synthetic photos and their jobs: little to fit, the default, and many lights."""
    yield (
        "one light, matte, known identity",
        _little(folder / "one", model, side_px, device, seed, specular_size),
    )
    for name, lights in (("20 lights", 20), ("100 lights", 100)):
        scene = exposed(plain_scene(load_model(model), seed=5, lights=lights, side_px=side_px))
        job = _job(folder / f"lights-{lights}", scene, device, seed)
        # The lights are to be found: their radiance is not told.
        stage = replace(scene.stage, radiance=np.ones_like(scene.stage.radiance))
        initial = {"specular": np.full((specular_size, specular_size), 0.8)}
        yield name, replace(job, stage=stage, initial=initial)


def _little(
    folder: Path, model: str, side_px: int, device: str, seed: int, specular_size: int
) -> Job:
    """One light on of twenty, no highlights, an identity that is known."""
    scene = plain_scene(load_model(model), seed=5, lights=20, side_px=side_px)
    key = int(scene.stage.radiance.max(axis=1).argmax())
    state = np.full(20, OFF)
    state[key] = ON
    radiance = np.where((state == ON)[:, None], scene.stage.radiance, 0.0)
    scene = exposed(with_stage(replace(scene, c_spec=0.0), radiance=radiance, state=state))
    initial = {"specular": np.zeros((specular_size, specular_size)), "identity": scene.identity}
    job = _job(folder, scene, device, seed)
    return replace(job, initial=initial, freeze=("specular", "roughness", "identity"))


def _job(folder: Path, scene: Scene, device: str, seed: int) -> Job:
    folder.mkdir(parents=True, exist_ok=True)
    write_png(folder / PHOTO, render(scene))
    return replace(job_of(folder, scene, folder / PHOTO), device=device, seed=seed)


def measure(
    name: str, job: Job, scratch: Path, rounds: int = ROUNDS, fineness: Fineness = USUAL
) -> tuple[Saving, list[RuleSaving]]:
    """Fit ``job`` under both plans, then time a joint step with each rule off in turn."""
    runs = {
        plan: _Timed(replace(job, plan=plan), scratch / f"{job.image.parent.name}-{plan}", fineness)
        for plan in (LEAN, FULL)
    }
    fitted = {plan: run.fit() for plan, run in runs.items()}
    lean, full = runs[LEAN], runs[FULL]
    saving = Saving(
        name,
        lean.seconds / lean.steps,
        full.seconds / full.steps,
        lean.cpu / lean.steps,
        full.cpu / full.steps,
        lean.seconds,
        full.seconds,
        lean.similarity_mm(fitted[LEAN]),
        full.similarity_mm(fitted[FULL]),
        largest_deviation(fitted[LEAN], fitted[FULL]),
    )
    names = [rule.name for rule in fields(Rules)]
    variants = {"": Rules()} | {rule: replace(Rules(), **{rule: False}) for rule in names}
    best = dict.fromkeys(variants, np.inf)
    for _ in range(rounds):
        for variant, rules in variants.items():
            seconds = lean.step(rules, fitted[LEAN])
            best[variant] = min(best[variant], seconds)
    return saving, [RuleSaving(name, rule, best[""], best[rule]) for rule in names]


class _Timed:
    """A fit, and how long its steps on the photo take."""

    def __init__(self, job: Job, folder: Path, fineness: Fineness) -> None:
        # Both plans and every rule with the same lights.
        job = replace(job, surround=WITHOUT)
        self.job, self.folder, self.problem = job, folder, read_problem(job, fineness=fineness)
        assert job.truth is not None
        self.truth = read_truth(job.truth, self.problem.geometry)
        self.forward = ForwardModel(self.problem.geometry, self.problem.lights)
        folder.mkdir(parents=True, exist_ok=True)

    def fit(self) -> Fitted:
        """The whole schedule, after one of a step each that compiles the kernels."""
        short = Schedule().limited(1)
        FitRun(self.problem, self.forward, self.folder, schedule=short).run(float("inf"))
        cpu: list[float] = []
        run = FitRun(
            self.problem,
            self.forward,
            self.folder,
            self.truth,
            lambda progress: cpu.append(time.process_time()),
        )
        fitted = run.run(float("inf"))
        photo = [number for number, row in enumerate(fitted.trace) if "photo_rms" in row]
        last_before = photo[0] - 1
        self.seconds = fitted.trace[-1]["seconds"] - fitted.trace[last_before]["seconds"]
        self.cpu = cpu[-1] - cpu[last_before]
        self.steps = len(photo)
        return fitted

    def similarity_mm(self, fitted: Fitted) -> float:
        """Mean distance to the truth after similarity alignment."""
        return float(self.truth.geometry_errors(fitted.state)["similarity_mm"])

    def step(self, rules: Rules, fitted: Fitted) -> float:
        """Processor seconds that the photo takes in one step of the last phase under ``rules``,
        where a fit ended.
        """
        run = FitRun(self.problem, self.forward, self.folder)
        run.view.plan, run.view.camera_to_stage = Plan(rules), fitted.camera_to_stage
        phase = run.schedule.last
        descent = run.view.descent(phase, fitted.state)
        assert descent is not None and phase.face_px is not None
        photo, layout = descent.energy.photo, descent.energy.layout
        assert photo is not None
        active = layout.mask(descent.blocks) & ~descent.freeze
        state = replace(
            fitted.state, camera=fitted.state.camera.scaled(self.problem.scale(phase.face_px))
        )

        def once(resting: np.ndarray | None) -> np.ndarray:
            evaluation = photo.evaluate(state, self.job.seed, resting)
            weights = photo.weights(evaluation, photo.noise(evaluation))
            return photo.normal_equations(evaluation, weights, layout, active)[1]

        gradient = once(None)[layout.slices["lights"]]
        resting = self.problem.lights.dark(state.lights, (state.lights <= 0) & (gradient > 0))
        began = time.process_time()
        once(resting)
        return time.process_time() - began


def without_off_lights(fitted: Fitted) -> State:
    """The state without the places of lights that are off, which only the full plan carries
    along.
    """
    return replace(
        fitted.state, light_position=fitted.state.light_position[fitted.stage.state != OFF]
    )


def largest_deviation(first: Fitted, second: Fitted) -> float:
    """The largest difference of a parameter between two fits, in the standard deviations that the
    second states.
    """
    one, other = without_off_lights(first), without_off_lights(second)
    layout = Layout(other)
    difference = np.abs(layout.values(one) - layout.values(other))
    turned = Rotation.from_matrix(first.state.rotation @ second.state.rotation.T).as_rotvec()
    pose = layout.slices["pose"]
    difference[pose] = np.abs(
        np.concatenate([turned, first.state.translation - second.state.translation])
    )
    deviations = dict(second.certainty.deviations)
    deviations["light_position"] = (
        deviations["light_position"].reshape(-1, AXES)[second.stage.state != OFF].ravel()
    )
    deviation = np.concatenate([deviations[name] for name in layout.slices])
    known = np.isfinite(deviation) & (deviation > 0)
    return float((difference[known] / deviation[known]).max()) if known.any() else 0.0


def table_lines(savings: Sequence[Saving]) -> list[str]:
    """The table of both plans."""
    heads = (
        "lean / full",
        "s a step",
        "cpu s a step",
        "photo steps s",
        "similarity mm",
        "differ by",
        "full/lean",
    )
    lines = [f"{heads[0]:36s}" + "".join(f"{head:>18s}" for head in heads[1:])]
    for row in savings:
        cells = (
            f"{row.lean_step:.2f} / {row.full_step:.2f}",
            f"{row.lean_step_cpu:.2f} / {row.full_step_cpu:.2f}",
            f"{row.lean_total:.1f} / {row.full_total:.1f}",
            f"{row.lean_mm:.3f} / {row.full_mm:.3f}",
            f"{row.deviation:.3f} sd",
            f"{row.ratio:.2f}",
        )
        lines.append(f"{row.scene:36s}" + "".join(f"{cell:>18s}" for cell in cells))
    return lines


def rule_lines(rules: Sequence[RuleSaving]) -> list[str]:
    """The table of each rule alone."""
    head = (
        f"{'last phase, one rule off':36s} {'rule':>8s} {'cpu s with / without':>21s} {'ratio':>6s}"
    )
    return [
        head,
        *(
            f"{row.scene:36s} {row.rule:>8s} {row.with_rule:9.3f} / {row.without:9.3f} "
            f"{row.ratio:6.2f}"
            for row in rules
        ),
    ]

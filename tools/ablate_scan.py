"""Where the millimetres of a fit go: fits of photographs of a scanned head, one thing changed at a
time.

python tools/ablate_scan.py CASE... --model ict:PATH [--face-region FILE.npy]
    [--registered FILE.npz] [--rows NAME...] [--pulls]

A CASE is a folder with photo.png, camera.json and scan.npz (docs/scans.md). Rows that give the fit
a piece of the truth need the face model registered to the scan: an .npz with ``identity``,
``expression``, ``vertices`` (n, 3) and ``scan`` (s, 3), the vertices of both in mm in one frame,
and ``albedo`` (n, 3) for its color. ``--pulls`` begins at that truth and says which term of the
energy moves the face how far.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scan_truth_inputs import Placed, Registered
from scipy.linalg import cho_solve

from facestage.contract.camera import Camera
from facestage.contract.errors import InputError
from facestage.contract.job import Job, Weights
from facestage.contract.light_stage import LIGHT_ARRAYS, LightStage, fibonacci_stage
from facestage.contract.scan import MILLIMETRES, Scan
from facestage.fit.energy.silhouette import SilhouetteTerm
from facestage.fit.energy.term import Quadratic
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import SHAPE
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.problem import Problem, read_problem
from facestage.fit.given.scan_truth import ScanTruth
from facestage.fit.solve.cholesky import firm_cholesky
from facestage.fit.stages.passage import Passage, walk
from facestage.fit.stages.phases import SHAPE_HELD, PhaseName, Schedule
from facestage.fit.stages.view import View
from facestage.models.mesh.similarity import procrustes
from facestage.models.registry import load_model
from facestage.render.variant import start_renderer

ROUND_LIGHTS = 40  # on the whole sphere, as dense as the stage's 20 on a half
FINER_FACE_PX = 320.0


@dataclass(frozen=True)
class Row:
    """One line of the table: what is changed of the job, and of the way through the phases."""

    words: str
    weights: Weights = field(default_factory=Weights)
    landmarks_alone: bool = False
    true_landmarks: bool = False
    true_albedo: bool = False
    begun_at_truth: bool = False
    outline: bool = True
    round_lights: bool = False
    face_px: float | None = None  # in the last phase

    @property
    def needs_truth(self) -> bool:
        """Whether it gives a piece of the registered head."""
        return self.true_landmarks or self.true_albedo or self.begun_at_truth


ROWS = {
    "landmarks": Row("landmark stage", landmarks_alone=True),
    "fit": Row("whole fit"),
    "photo3": Row("photo x 3", Weights(photo=3.0)),
    "photo0.3": Row("photo / 3", Weights(photo=1 / 3)),
    "landmarks3": Row("landmarks x 3", Weights(landmarks=3.0)),
    "landmarks0.3": Row("landmarks / 3", Weights(landmarks=1 / 3)),
    "prior3": Row("prior x 3", Weights(prior=3.0)),
    "prior0.3": Row("prior / 3", Weights(prior=1 / 3)),
    "no-light-prior": Row("no prior on the lights", Weights(light=0.0)),
    "no-outline": Row("no outline", outline=False),
    "round-lights": Row("lights all around", round_lights=True),
    "finer": Row("face of 320 pixels at the end", face_px=FINER_FACE_PX),
    "true-landmarks": Row("exact landmarks", true_landmarks=True),
    "true-landmarks100": Row(
        "exact landmarks, a tenth of their deviation", Weights(landmarks=100.0), true_landmarks=True
    ),
    "true-landmarks100-alone": Row(
        "... landmark stage", Weights(landmarks=100.0), landmarks_alone=True, true_landmarks=True
    ),
    "true-albedo": Row("the scan's color given", true_albedo=True),
    "true-start": Row("begun at the truth", begun_at_truth=True),
}


@dataclass(frozen=True)
class Case:
    """A photograph of a scanned head."""

    folder: Path
    scan: Scan
    geometry: FaceGeometry
    specification: str  # of the face model
    placed: Placed | None

    def problem(self, row: Row) -> Problem:
        """What ``row`` fits. Raises InputError."""
        camera, geometry = Camera.read(self.folder / "camera.json"), self.geometry
        job = Job(self.folder / "photo.png", self.specification, camera=camera, weights=row.weights)
        if row.round_lights:
            job = replace(job, stage=_all_around(ROUND_LIGHTS))
        if row.needs_truth:
            if self.placed is None:
                raise InputError(f"'{row.words}' needs --registered.")
            if row.true_landmarks:
                job = replace(job, landmarks=self.placed.landmarks(camera))
            if row.begun_at_truth:
                job = replace(job, initial=self.placed.initial)
            if row.true_albedo:
                geometry = FaceGeometry(self.placed.colored())
                job = replace(job, freeze=("albedo",))
        return read_problem(job, geometry=geometry)


def _all_around(count: int) -> LightStage:
    """The stage and its mirror image behind the face, together ``count`` lights."""
    front = fibonacci_stage(count // 2)
    behind = front.transformed(np.diag([-1.0, 1.0, -1.0, 1.0]))
    both = {
        name: np.concatenate([getattr(front, name), getattr(behind, name)]) for name in LIGHT_ARRAYS
    }
    return LightStage(**both)


def fitted(problem: Problem, row: Row, view: View) -> State:
    """Where the fit of ``row`` ends."""
    schedule = Schedule.of(problem.job.quality)
    state = view.start_state()
    phases = schedule.landmark_phases if row.landmarks_alone else schedule.phases
    for phase in phases:
        if row.begun_at_truth and not phase.with_photo:
            continue
        if phase.name == PhaseName.JOINT and row.face_px is not None:
            phase = replace(phase, face_px=row.face_px)
        passage = Passage.prepared(view, phase, state)
        if passage is None:
            continue
        if not row.outline:
            passage.descent.energy = passage.descent.energy.without(SilhouetteTerm)
        for _ in passage.steps(float("inf")):
            pass
        state = passage.state
    return state


def table(cases: Sequence[Case], names: Sequence[str]) -> None:
    """Print a line of Markdown for each row: the median distance in mm of each case and their mean
    over the points that the mesh covers, and over all points.
    """
    titles = [case.folder.name for case in cases]
    print(f"| | {' | '.join(titles)} | mean | all points | seconds |", flush=True)
    print(f"|---|{'---|' * len(cases)}---|---|---|")
    for name in names:
        row, covered, every, began = ROWS[name], [], [], time.monotonic()
        for case in cases:
            problem = case.problem(row)
            view = View(problem, ForwardModel(problem.geometry, problem.lights))
            state = fitted(problem, row, view)
            truth = ScanTruth(case.scan, case.geometry)
            covered.append(truth.covered_errors(state)["covered_mm"])
            every.append(truth.geometry_errors(state)["similarity_mm"])
        figures = " | ".join(f"{value:.2f}" for value in (*covered, np.mean(covered)))
        seconds = time.monotonic() - began
        print(f"| {row.words} | {figures} | {np.mean(every):.2f} | {seconds:.0f} |", flush=True)


def pulls(case: Case) -> None:
    """Print by how far each term would move the face from the truth: one Gauss-Newton system of the
    last phase there, light and skin fitted to the true shape and free; the step of each term's
    gradient alone. The steps add up to that of all.
    """
    problem = case.problem(Row("pulls", begun_at_truth=True))
    view = View(problem, ForwardModel(problem.geometry, problem.lights))
    schedule = Schedule.of(problem.job.quality)
    held = [phase.varied(SHAPE_HELD, SHAPE) for phase in schedule.photo_phases]
    truth = walk(view, held, view.start_state())
    passage = Passage.prepared(view, schedule[PhaseName.JOINT], truth, keep_light=True)
    assert passage is not None and case.placed is not None
    descent, state = passage.descent, passage.scaled
    evaluation = descent.evaluate(state, passage.seed, everything=True)
    system = descent.energy.at(state, evaluation).system(state, descent.active)
    values = descent.values(state)
    stays = (values <= descent.low) & (system.gradient > 0)
    stays |= (values >= descent.high) & (system.gradient < 0)
    free = np.flatnonzero(descent.active & ~stays & (np.diag(system.hessian) > 0))
    scale = 1.0 / np.sqrt(np.diag(system.hessian)[free])
    factor = firm_cholesky(system.hessian[np.ix_(free, free)] * np.outer(scale, scale))
    print(f"| {case.folder.name} | energy | along the normal, RMS mm | any way, median mm |")
    print("|---|---|---|---|")
    gradients = {"all": system.gradient}
    for part in system.parts:
        alone = Quadratic.zero(descent.energy.layout, descent.active)
        part.add_to(alone)
        gradients[", ".join(part.energies) if len(part.energies) == 1 else "priors"] = (
            alone.gradient
        )
    for name, gradient in gradients.items():
        step = np.zeros(len(values))
        step[free] = -scale * cho_solve(factor, scale * gradient[free])
        normal, anyway = _moved(case, descent.moved(state, step), state)
        energy = system.energies.get(name)
        words = "" if energy is None else f"{energy:.0f}"
        print(f"| {name} | {words} | {normal:.2f} | {anyway:.2f} |", flush=True)


def _moved(case: Case, there: State, here: State) -> tuple[float, float]:
    """How far the narrow face goes from ``here`` to ``there`` after a similarity, in mm: root mean
    square along its normals, and median.
    """
    geometry = case.geometry
    region = geometry.new_index[geometry.model.regions["narrow_face"]]
    after, before = (
        geometry.at(state) @ state.rotation.T + state.translation for state in (there, here)
    )
    normals = geometry.vertex_normals(before)[0][region]
    laid = procrustes(after[region], before[region]).apply(after[region])
    offset = MILLIMETRES * (laid - before[region])
    along = np.einsum("nx,nx->n", offset, normals)
    return float(np.sqrt((along**2).mean())), float(np.median(np.linalg.norm(offset, axis=1)))


def main() -> None:
    """Print the table, or the pulls."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("cases", type=Path, nargs="+", metavar="CASE")
    parser.add_argument("--model", required=True)
    parser.add_argument("--face-region", type=Path)
    parser.add_argument("--registered", type=Path)
    parser.add_argument("--rows", nargs="+", choices=tuple(ROWS), metavar="NAME")
    parser.add_argument("--pulls", action="store_true")
    options = parser.parse_args()
    start_renderer("cpu")
    model = load_model(options.model)
    geometry = FaceGeometry(model)
    known = Registered.load(options.registered, model) if options.registered else None
    cases = []
    for folder in options.cases:
        scan = Scan.load(folder / "scan.npz", options.face_region)
        placed = known.in_photo(scan, model) if known else None
        cases.append(Case(folder, scan, geometry, options.model, placed))
    if options.pulls:
        if known is None:
            parser.error("--pulls needs --registered")
        for case in cases:
            pulls(case)
        return
    table(
        cases, options.rows or [name for name, row in ROWS.items() if known or not row.needs_truth]
    )


if __name__ == "__main__":
    main()

"""A run that was stopped goes on to the same end; a checkpoint of another job is refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.camera import Camera
from facestage.contract.errors import InputError
from facestage.contract.job import Job, Weights
from facestage.contract.landmarks import Landmarks
from facestage.contract.light_stage import fibonacci_stage
from facestage.contract.storage import read_arrays, write_arrays
from facestage.fit.checkpoint import FILE, Checkpoint
from facestage.fit.driver import FitRun
from facestage.fit.fitted import Fitted, Progress
from facestage.fit.parameters import Layout, State
from facestage.fit.problem import read_problem
from facestage.fit.shading import ForwardModel
from reference.small_fit import SMALL
from reference.synthetic_case import Case
from reference.synthetic_scene import Scene

FOREVER = float("inf")


class StopError(Exception):
    """Raised by a listener in place of a kill."""


def job_of(case: Case, **changes) -> Job:
    job = Job(
        case.photo, case.model_option, Landmarks.read(case.landmarks), Camera.read(case.camera),
        stage=fibonacci_stage(4), device="cpu",
    )  # fmt: skip
    return replace(job, **changes)


def run_of(job: Job, folder: Path, listen=lambda progress: None) -> FitRun:
    problem = read_problem(job, fineness=SMALL)
    folder.mkdir(exist_ok=True)
    return FitRun(problem, ForwardModel(problem.geometry, problem.lights), folder, listen=listen)


def interrupted(job: Job, folder: Path, steps: int) -> None:
    """Run ``steps`` steps, then stop as a crash would."""
    heard: list[Progress] = []

    def listen(progress: Progress) -> None:
        heard.append(progress)
        if len(heard) == steps:
            raise StopError

    with pytest.raises(StopError):
        run_of(job, folder, listen).run(FOREVER)


def assert_same(found: Fitted, wanted: Fitted) -> None:
    layout = Layout(wanted.state)
    for name, where in layout.slices.items():
        np.testing.assert_allclose(
            layout.values(found.state)[where], layout.values(wanted.state)[where], rtol=1e-7, atol=1e-9, err_msg=name
        )
    np.testing.assert_allclose(found.state.model_to_camera, wanted.state.model_to_camera, atol=1e-9)
    np.testing.assert_allclose(found.camera_to_stage, wanted.camera_to_stage, atol=1e-9)
    np.testing.assert_allclose(found.stage.radiance, wanted.stage.radiance, rtol=1e-7)
    assert [(row["stage"], row["iteration"]) for row in found.trace] == [
        (row["stage"], row["iteration"]) for row in wanted.trace
    ]


@pytest.fixture(scope="module")
def whole(case: Case, tmp_path_factory: pytest.TempPathFactory) -> Fitted:
    """The run that nothing stopped, with the small maps."""
    return run_of(job_of(case), tmp_path_factory.mktemp("whole")).run(FOREVER)


def test_the_schedule_runs_every_phase(whole: Fitted):
    stages = list(dict.fromkeys(row["stage"] for row in whole.trace))
    assert stages == ["pose", "landmarks", "light and albedo", "geometry", "specular", "joint"]
    assert whole.in_time and np.isfinite(Layout(whole.state).values(whole.state)).all()
    seconds = [row["seconds"] for row in whole.trace]
    assert seconds == sorted(seconds)


@pytest.mark.parametrize("share", [0.05, 0.3, 0.5, 0.75, 0.999])
def test_stopped_anywhere_it_ends_at_the_same_place(case: Case, whole: Fitted, tmp_path: Path, share: float):
    steps = max(1, int(share * len(whole.trace)))
    interrupted(job_of(case), tmp_path, steps)
    checkpoint = Checkpoint.load(tmp_path)
    assert checkpoint is not None and len(checkpoint.trace) == steps
    assert_same(run_of(job_of(case), tmp_path).run(FOREVER, checkpoint), whole)


def test_stopped_twice(case: Case, whole: Fitted, tmp_path: Path):
    interrupted(job_of(case), tmp_path, 6)
    second = run_of(job_of(case), tmp_path)
    limit = len(whole.trace) - 2

    def listen(_progress: Progress) -> None:
        if len(second.trace) == limit:
            raise StopError

    second.listen = listen
    with pytest.raises(StopError):
        second.run(FOREVER, Checkpoint.load(tmp_path))
    assert_same(run_of(job_of(case), tmp_path).run(FOREVER, Checkpoint.load(tmp_path)), whole)


@pytest.mark.parametrize(
    "change",
    [
        {"seed": 5}, {"freeze": ("albedo",)}, {"light_color": "uniform"}, {"stage": fibonacci_stage(5)},
        {"weights": Weights(prior=2.0)}, {"camera": Camera(96, 96, 210.0, (48.0, 48.0))},
        {"initial": {"roughness": np.array(0.3)}}, {"camera_to_stage": np.eye(4)},
    ],
    ids=lambda change: next(iter(change)),
)  # fmt: skip
def test_a_checkpoint_of_another_job_is_refused(case: Case, tmp_path: Path, change: dict):
    interrupted(job_of(case), tmp_path, 2)
    with pytest.raises(InputError, match=r"belongs to another job.*--resume"):
        run_of(job_of(case, **change), tmp_path).run(FOREVER, Checkpoint.load(tmp_path))


def test_the_budget_may_change(case: Case, tmp_path: Path):
    interrupted(job_of(case, budget_seconds=1.0), tmp_path, 2)
    checkpoint = Checkpoint.load(tmp_path)
    assert checkpoint is not None and len(checkpoint.trace) == 2
    found = run_of(job_of(case, budget_seconds=900.0), tmp_path).run(0.0, checkpoint)
    assert found.trace[:2] == checkpoint.trace


def test_round_trip(scene: Scene, tmp_path: Path):
    saved = Checkpoint(
        "abc",
        3,
        2,
        (1e-4, 8.0),
        2.5,
        7.25,
        np.eye(4),
        np.zeros(4, bool),
        scene.state,
        [{"stage": "pose", "seconds": 0.1}],
    )
    saved.save(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [FILE]
    loaded = Checkpoint.load(tmp_path)
    assert loaded is not None
    for name in ("fingerprint", "phase", "step", "damping", "light_scale", "seconds", "trace"):
        assert getattr(loaded, name) == getattr(saved, name)
    for name in State.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(loaded.state, name), getattr(saved.state, name))


def test_no_checkpoint_and_damaged_ones(scene: Scene, tmp_path: Path):
    assert Checkpoint.load(tmp_path) is None
    (tmp_path / FILE).write_bytes(b"half")
    with pytest.raises(InputError, match="checkpoint"):
        Checkpoint.load(tmp_path)
    Checkpoint("abc", 3, 2, (1e-4, 8.0), 2.5, 7.25, np.eye(4), np.zeros(4, bool), scene.state, []).save(tmp_path)
    arrays = read_arrays(tmp_path / FILE, "checkpoint")
    meta = json.loads(str(arrays["meta"]))
    del meta["damping"]
    for change in ({"meta": np.array(json.dumps(meta))}, {"meta": np.array("{")}):
        write_arrays(tmp_path / FILE, arrays | change)
        with pytest.raises(InputError, match=r"damaged.*without --resume"):
            Checkpoint.load(tmp_path)
    write_arrays(tmp_path / FILE, {name: array for name, array in arrays.items() if name != "rotation"})
    with pytest.raises(InputError, match=r"damaged.*rotation"):
        Checkpoint.load(tmp_path)

"""A run that was stopped goes on to the same end; a checkpoint of another job is refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.camera import Camera
from facestage.contract.errors import InputError
from facestage.contract.files.partial import CHECKPOINT
from facestage.contract.files.storage import read_arrays, write_arrays
from facestage.contract.job import Job, Weights
from facestage.contract.light_stage import fibonacci_stage
from facestage.fit.energy.plan import Ledger, Work
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.problem import read_problem
from facestage.fit.runs.checkpoint import Checkpoint
from facestage.fit.runs.driver import FitRun
from facestage.fit.runs.progress import Progress
from facestage.fit.stages.passage import Within
from facestage.fit.stages.skin_to_skin import SkinToSkin
from facestage.fit.stages.surround import Surround
from facestage.fit.stages.view import Memory
from facestage.fit.trust.fitted import Fitted
from reference.small_fit import SMALL, StopError
from reference.synthetic_case import Case, write_case
from reference.synthetic_scene import Scene

FOREVER = float("inf")
STATES = ("began", "start", "within")


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
    for name in State.__dataclass_fields__:
        np.testing.assert_array_equal(
            getattr(found.state, name), getattr(wanted.state, name), err_msg=name
        )
    np.testing.assert_array_equal(found.camera_to_stage, wanted.camera_to_stage)
    np.testing.assert_array_equal(found.stage.radiance, wanted.stage.radiance)
    assert found.energy == wanted.energy and found.condition == wanted.condition
    assert found.certainty.unobserved == wanted.certainty.unobserved
    for name, deviation in wanted.certainty.deviations.items():
        np.testing.assert_array_equal(found.certainty.deviations[name], deviation, err_msg=name)
    assert [row | {"seconds": 0} for row in found.trace] == [
        row | {"seconds": 0} for row in wanted.trace
    ]
    assert found.ledger.skipped == wanted.ledger.skipped
    assert {kind: work.units for kind, work in found.ledger.work.items()} == {
        kind: work.units for kind, work in wanted.ledger.work.items()
    }


@pytest.fixture(scope="module")
def whole(case: Case, tmp_path_factory: pytest.TempPathFactory) -> Fitted:
    """The run that nothing stopped, with the small maps."""
    return run_of(case.job(truth=None), tmp_path_factory.mktemp("whole")).run(FOREVER)


def test_the_schedule_runs_every_phase(whole: Fitted):
    stages = list(dict.fromkeys(row["stage"] for row in whole.trace))
    assert stages == ["pose", "landmarks", "light and albedo", "geometry", "specular", "joint"]
    assert whole.in_time and np.isfinite(Layout(whole.state).values(whole.state)).all()
    seconds = [row["seconds"] for row in whole.trace]
    assert seconds == sorted(seconds)


@pytest.mark.parametrize("share", [0.05, 1.0])
def test_stopped_anywhere_it_ends_at_the_same_place(
    case: Case, whole: Fitted, tmp_path: Path, share: float
):
    steps = max(1, int(share * len(whole.trace)))
    interrupted(case.job(truth=None), tmp_path, steps)
    checkpoint = Checkpoint.load(tmp_path)
    assert checkpoint is not None and len(checkpoint.trace) == steps - 1, (
        "where the last step began"
    )
    assert_same(run_of(case.job(truth=None), tmp_path).run(FOREVER, checkpoint), whole)


@pytest.mark.parametrize("share", [0.45, 0.95])
def test_a_shadow_that_was_found_stays_so(scene: Scene, tmp_path: Path, share: float):
    shadowed = write_case(tmp_path, scene, shadow=0.5)
    wanted = run_of(shadowed.job(lights=6, truth=None), tmp_path / "whole").run(FOREVER)
    assert wanted.dark.any()
    interrupted(
        shadowed.job(lights=6, truth=None), tmp_path / "stopped", int(share * len(wanted.trace))
    )
    checkpoint = Checkpoint.load(tmp_path / "stopped")
    found = run_of(shadowed.job(lights=6, truth=None), tmp_path / "stopped").run(
        FOREVER, checkpoint
    )
    assert_same(found, wanted)
    np.testing.assert_array_equal(found.dark, wanted.dark)


def test_stopped_twice(case: Case, whole: Fitted, tmp_path: Path):
    interrupted(case.job(truth=None), tmp_path, 6)
    second = run_of(case.job(truth=None), tmp_path)
    limit = len(whole.trace) - 2

    def listen(_progress: Progress) -> None:
        if len(second.trace) == limit:
            raise StopError

    second.listen = listen
    with pytest.raises(StopError):
        second.run(FOREVER, Checkpoint.load(tmp_path))
    assert_same(
        run_of(case.job(truth=None), tmp_path).run(FOREVER, Checkpoint.load(tmp_path)), whole
    )


@pytest.mark.parametrize(
    "change",
    [
        {"seed": 5},
        {"freeze": ("albedo",)},
        {"light_color": "uniform"},
        {"stage": fibonacci_stage(5)},
        {"weights": Weights(prior=2.0)},
        {"camera": Camera(96, 96, 210.0, (48.0, 48.0))},
        {"initial": {"roughness": np.array(0.3)}},
        {"camera_to_stage": np.eye(4)},
    ],
    ids=lambda change: next(iter(change)),
)
def test_a_checkpoint_of_another_job_is_refused(case: Case, tmp_path: Path, change: dict):
    interrupted(case.job(truth=None), tmp_path, 2)
    with pytest.raises(InputError, match=r"belongs to another job.*--resume"):
        run_of(case.job(**change, truth=None), tmp_path).run(FOREVER, Checkpoint.load(tmp_path))


def test_the_budget_may_change(case: Case, tmp_path: Path):
    interrupted(case.job(budget_seconds=1.0, truth=None), tmp_path, 2)
    checkpoint = Checkpoint.load(tmp_path)
    # The second step, where it was stopped, is taken again.
    assert checkpoint is not None and len(checkpoint.trace) == 1
    found = run_of(case.job(budget_seconds=900.0, truth=None), tmp_path).run(0.0, checkpoint)
    assert found.trace[:1] == checkpoint.trace and len(found.trace) > 1


def test_a_checkpoint_of_a_phase_that_the_schedule_has_not_is_refused(case: Case, tmp_path: Path):
    interrupted(case.job(truth=None), tmp_path, 2)
    checkpoint = Checkpoint.load(tmp_path)
    assert checkpoint is not None
    with pytest.raises(InputError, match=r"damaged.*lens.*--resume"):
        run_of(case.job(truth=None), tmp_path).run(FOREVER, replace(checkpoint, phase="lens"))


@pytest.mark.parametrize("budget", [0.0, FOREVER])
def test_the_step_that_was_taken_last_is_taken_again_whatever_the_time(
    case: Case, whole: Fitted, tmp_path: Path, budget: float
):
    interrupted(case.job(truth=None), tmp_path, len(whole.trace))
    fitted = run_of(case.job(truth=None), tmp_path).run(budget, Checkpoint.load(tmp_path))
    assert fitted.energy == whole.energy and fitted.certainty.deviations


def a_checkpoint(scene: Scene) -> Checkpoint:
    """With something in every field."""
    surround = Surround((0, 4), 70.5, 0.25, joined=True)
    hidden, dark = np.ones((3, 4), bool), np.eye(3, 4) > 0
    between, strong = SkinToSkin(0.3, float("inf")), np.zeros(4, bool)
    memory = Memory(2.5, 0.01, np.eye(4), strong, hidden, dark, surround, 2.5, between)
    ledger = Ledger({"lit": Work(0.5, 12.0)}, {("pixels", "lit"): 3.0})
    row = {"stage": "pose", "seconds": 0.1}
    within = Within(2, scene.state, (1e-4, 8.0), np.ones(4, bool))
    return Checkpoint(
        "abc", "geometry", 7.25, scene.state, scene.state, memory, ledger, [row], within
    )


def test_a_state_of_a_version_without_relief_is_flat(scene: Scene, tmp_path: Path):
    a_checkpoint(scene).save(tmp_path)
    arrays = dict(read_arrays(tmp_path / CHECKPOINT, "checkpoint"))
    for name in STATES:
        del arrays[f"{name}/relief"]
    write_arrays(tmp_path / CHECKPOINT, arrays)
    loaded = Checkpoint.load(tmp_path)
    assert loaded is not None and loaded.within is not None and loaded.start is not None
    assert not len(loaded.began.relief)
    full = loaded.with_relief(2)
    assert full.within is not None and full.start is not None
    for state in (full.began, full.start, full.within.state):
        np.testing.assert_array_equal(state.relief, [0, 0])
    kept = replace(scene.state, relief=np.ones(2))
    assert replace(loaded, began=kept).with_relief(2).began is kept


def test_round_trip(scene: Scene, tmp_path: Path):
    saved = a_checkpoint(scene)
    saved.save(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [CHECKPOINT]
    loaded = Checkpoint.load(tmp_path)
    assert loaded is not None and loaded.within is not None and saved.within is not None
    for name in ("fingerprint", "phase", "seconds", "trace", "ledger"):
        assert getattr(loaded, name) == getattr(saved, name)
    for one, other in ((loaded.memory, saved.memory), (loaded.within, saved.within)):
        for name in other.__dataclass_fields__:
            if name in ("surround", "between"):
                assert getattr(one, name) == getattr(other, name)
            elif name != "state":
                np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    for state in (loaded.start, loaded.began, loaded.within.state):
        for name in State.__dataclass_fields__:
            np.testing.assert_array_equal(getattr(state, name), getattr(scene.state, name))


def test_a_file_of_the_first_version_with_this_number_is_read(scene: Scene, tmp_path: Path):
    """Arrays of that time, and no more, under the names that they had."""
    own = ("strong", "camera_to_stage", "hidden", "resting")
    state = ("rotation", "translation", "identity", "expression", "lights", "light_position")
    names = {f"{of}/{name}" for of in STATES for name in (*state, "albedo", "specular")}
    arrays = a_checkpoint(scene).arrays()
    meta = json.loads(str(arrays["meta"]))
    assert meta["schema"] == 2
    assert meta["phase"] == 3, "geometry"
    meta["states"] = {
        of: {name: meta["states"][of][name] for name in ("camera", "roughness")} for of in STATES
    }
    del meta["surround"], meta["exposure"], meta["between"]
    old = {name: arrays[name] for name in {*own, *names}} | {"meta": np.array(json.dumps(meta))}
    write_arrays(tmp_path / CHECKPOINT, old)
    loaded = Checkpoint.load(tmp_path)
    assert loaded is not None and loaded.within is not None and loaded.start is not None
    flat = replace(scene.state, relief=np.zeros(0))
    for found in (loaded.start, loaded.began, loaded.within.state):
        np.testing.assert_array_equal(Layout(found).values(found), Layout(flat).values(flat))


def test_what_is_not_there_yet_comes_back_as_nothing(scene: Scene, tmp_path: Path):
    memory = Memory(1.0, None, None, np.zeros(4, bool), None)
    Checkpoint("abc", "pose", 0.0, None, scene.state, memory, Ledger(), []).save(tmp_path)
    loaded = Checkpoint.load(tmp_path)
    assert loaded is not None and loaded.start is None and loaded.within is None
    assert (
        loaded.memory.penumbra is None
        and loaded.memory.camera_to_stage is None
        and loaded.memory.hidden is None
    )


def test_no_checkpoint_and_damaged_ones(scene: Scene, tmp_path: Path):
    assert Checkpoint.load(tmp_path) is None
    (tmp_path / CHECKPOINT).write_bytes(b"half")
    with pytest.raises(InputError, match="checkpoint"):
        Checkpoint.load(tmp_path)
    a_checkpoint(scene).save(tmp_path)
    arrays = read_arrays(tmp_path / CHECKPOINT, "checkpoint")
    meta = json.loads(str(arrays["meta"]))
    del meta["ledger"]
    unknown = json.dumps(json.loads(str(arrays["meta"])) | {"phase": -1})
    spoiled = (
        json.dumps(json.loads(str(arrays["meta"])) | each)
        for each in (
            {"surround": {"lights": "x"}},
            {"between": {"strength": 1.0}},
            {"between": {"strength": 1.0, "deviation": 0.0}},
        )
    )
    for text in (
        json.dumps(meta),
        unknown,
        *spoiled,
        "{",
        "[]",
        '{"schema": 2, "trace": ' + "[" * 5000,
    ):
        change = {"meta": np.array(text)}
        write_arrays(tmp_path / CHECKPOINT, arrays | change)
        with pytest.raises(InputError, match=r"damaged.*without --resume"):
            Checkpoint.load(tmp_path)
    for wrong in (np.full((3, 3), np.nan), np.eye(4), np.full((3, 3), "x")):
        write_arrays(tmp_path / CHECKPOINT, arrays | {"began/rotation": wrong})
        with pytest.raises(InputError, match=r"rotation.*without --resume"):
            Checkpoint.load(tmp_path)
    write_arrays(
        tmp_path / CHECKPOINT,
        {name: array for name, array in arrays.items() if name != "began/rotation"},
    )
    with pytest.raises(InputError, match=r"lacks began\.rotation"):
        Checkpoint.load(tmp_path)
    others: list[dict[str, int]] = [{"schema": 1}, {}]
    for other in others:
        write_arrays(tmp_path / CHECKPOINT, arrays | {"meta": np.array(json.dumps(other))})
        with pytest.raises(InputError, match=r"another version.*without --resume"):
            Checkpoint.load(tmp_path)

"""Jobs: folder round trip, and messages for what is wrong."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from facestage.contract.errors import InputError
from facestage.contract.files.storage import read_arrays, write_arrays
from facestage.contract.job import DEVICES, LIGHT_COLORS, Job, Weights
from facestage.contract.parameters import PARAMETERS
from facestage.contract.skin_tone import ANGLES


def assert_same(first: Any, second: Any, what: str = "") -> None:
    """Compare field by field, arrays included."""
    if hasattr(first, "__dataclass_fields__"):
        for item in fields(first):
            assert_same(
                getattr(first, item.name), getattr(second, item.name), f"{what}.{item.name}"
            )
    elif isinstance(first, dict):
        assert set(first) == set(second), what
        for name in first:
            assert_same(first[name], second[name], f"{what}[{name}]")
    elif isinstance(first, np.ndarray):
        np.testing.assert_array_equal(first, second, err_msg=what)
    else:
        assert first == second, what


def test_round_trip_keeps_everything_and_copies_the_image(tmp_path: Path, job: Job):
    job.save(tmp_path / "job")
    loaded = Job.load(tmp_path / "job")
    assert loaded.image.parent == tmp_path / "job"
    assert loaded.image.read_bytes() == job.image.read_bytes()
    assert_same(replace(loaded, image=job.image), job)
    job.image.unlink()
    assert loaded.image.is_file(), "the job folder stands alone"


def test_a_minimal_job_keeps_its_defaults(tmp_path: Path, photo: Path):
    Job(photo).save(tmp_path / "job")
    assert_same(replace(Job.load(tmp_path / "job"), image=photo), Job(photo))


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=25)
@given(
    st.sampled_from(LIGHT_COLORS),
    st.sampled_from(DEVICES),
    st.sets(st.sampled_from(PARAMETERS)),
    st.none() | st.floats(1e-3, 1e6),
    st.integers(0, 2**20),
    st.floats(0, 1e6),
    st.fixed_dictionaries(
        {
            "white_balance": st.none()
            | st.tuples(st.floats(0, 1e4), st.floats(0, 1e4))
            | st.tuples(*3 * [st.floats(1e-6, 1e6)]),
            "skin_tone": st.none() | st.floats(*ANGLES),
        }
    ),
)
def test_options_round_trip(
    photo: Path,
    color: str,
    device: str,
    freeze: set[str],
    budget: float | None,
    seed: int,
    weight: float,
    known: dict[str, Any],
):
    original = Job(
        photo,
        light_color=color,
        device=device,
        freeze=tuple(freeze),
        budget_seconds=budget,
        seed=seed,
        weights=Weights(photo=weight),
        **known,
    )
    original.save(photo.parent / "job")
    assert_same(replace(Job.load(photo.parent / "job"), image=photo), original)


def test_a_job_beside_a_result_refers_to_the_photo_where_it_is(tmp_path: Path, job: Job):
    job.write_into(tmp_path, copy_image=False)
    assert Job.load(tmp_path).image == job.image


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"light_color": "rainbow"}, ["light_color", "rainbow", "multi, uniform"]),
        ({"skin_tone": -90.0}, ["skin tone", "-90", "-80 (darkest) to 70"]),
        ({"skin_tone": float("nan")}, ["skin tone", "nan", "-80 (darkest) to 70"]),
        ({"device": "tpu"}, ["device", "tpu", "auto, cpu, cuda"]),
        ({"freeze": ("nose",)}, ["nose", "identity, expression"]),
        ({"budget_seconds": 0.0}, ["budget", "0.0", "greater than 0"]),
        ({"budget_seconds": -3.0}, ["budget", "-3.0", "greater than 0"]),
        ({"budget_seconds": float("nan")}, ["budget", "nan", "greater than 0"]),
        ({"seed": -1}, ["seed", "-1", "0 to"]),
        ({"face": 0}, ["face", "0", "1"]),
        ({"plan": "some"}, ["plan", "some", "lean", "full"]),
        ({"surround": "some"}, ["surround", "some", "auto, on, off"]),
        ({"texture_size": 1000}, ["texture size", "1000", "512, 1024, 2048, 4096"]),
        ({"exposure": "some"}, ["exposure", "some", "known, unknown"]),
        ({"seed": 2**40}, ["seed", str(2**40), "0 to"]),
    ],
)
def test_wrong_options_are_named(photo: Path, change: dict, words: list[str]):
    with pytest.raises(InputError) as caught:
        Job(photo, **change)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize("value", [-1.0, float("nan"), float("inf")])
def test_wrong_weights_are_named(value: float):
    with pytest.raises(InputError, match=rf"weight 'landmarks' is {value}; expected"):
        Weights(landmarks=value)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"schema": 99}, "schema 99, expected 1"),
        ({"schema": None}, "schema null, expected 1"),
        ({"light_color": 3}, "light_color is 3, expected one of multi"),
        ({"freeze": 5}, "freeze is 5, expected a list"),
        ({"model": 5}, "model is 5, expected text"),
        ({"photo_weight": 5}, "photo_weight is not known, expected .*image"),
        ({"weights": {"beauty": 1}}, "beauty"),
        ({"weights": {"photo": "much"}}, "weights.photo is 'much'"),
        ({"weights": []}, "weights is a list of 0"),
        ({"budget_seconds": "long"}, "budget_seconds is 'long'"),
        ({"seed": "x"}, "seed is 'x'"),
        ({"camera": {"width": 3}}, "lacks camera.height"),
        ({"camera": [1]}, "camera is a list of 1"),
        (
            {"landmarks": {"scheme": "ibug68", "points": [[1, 2]]}},
            r"points has shape \(1, 2\), expected \(68, 2\)",
        ),
        ({"landmarks": [1]}, "landmarks is a list of 1"),
    ],
)
def test_a_damaged_job_file_is_refused(tmp_path: Path, job: Job, change: dict, words: str):
    job.save(tmp_path / "job")
    path = tmp_path / "job" / "job.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(InputError, match=words):
        Job.load(tmp_path / "job")


def test_a_job_without_an_image_is_refused(tmp_path: Path, job: Job):
    job.save(tmp_path / "job")
    path = tmp_path / "job" / "job.json"
    data = json.loads(path.read_text())
    del data["image"]
    path.write_text(json.dumps(data))
    with pytest.raises(InputError, match="image"):
        Job.load(tmp_path / "job")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"camera_to_stage": np.diag([2.0, 2, 2, 1])}, "not a rigid"),
        ({"camera_to_stage": np.diag([1.0, 1, -1, 1])}, "not a rigid"),
        ({"camera_to_stage": np.eye(3)}, r"shape \(3, 3\), expected \(4, 4\)"),
        ({"camera_to_stage": np.full((4, 4), np.nan)}, "NaN"),
        ({"camera_to_stage": np.array("text")}, "<U4 values, expected numbers"),
        ({"stage/side": np.zeros(5)}, "side"),
        ({"stage/radiance": np.full((5, 3), np.nan)}, "NaN"),
        ({"stage/position": np.full((5, 3), "left")}, "position"),
    ],
)
def test_damaged_arrays_are_refused(tmp_path: Path, job: Job, change: dict, words: str):
    job.save(tmp_path / "job")
    path = tmp_path / "job" / "job.npz"
    write_arrays(path, read_arrays(path, "arrays") | change)
    with pytest.raises(InputError, match=words):
        Job.load(tmp_path / "job")


def test_a_translation_that_is_no_number_is_refused(tmp_path: Path, job: Job):
    job.save(tmp_path / "job")
    path = tmp_path / "job" / "job.npz"
    matrix = np.eye(4)
    matrix[0, 3] = np.nan
    write_arrays(path, read_arrays(path, "arrays") | {"camera_to_stage": matrix})
    with pytest.raises(InputError, match="camera_to_stage holds NaN"):
        Job.load(tmp_path / "job")


def test_half_a_stage_is_refused(tmp_path: Path, job: Job):
    job.save(tmp_path / "job")
    path = tmp_path / "job" / "job.npz"
    arrays = read_arrays(path, "arrays")
    del arrays["stage/axis_x"]
    write_arrays(path, arrays)
    with pytest.raises(InputError, match=r"lacks stage\.axis_x"):
        Job.load(tmp_path / "job")


def test_missing_files_are_named(tmp_path: Path, job: Job):
    with pytest.raises(InputError, match=r"job folder '.*nothing' does not exist"):
        Job.load(tmp_path / "nothing")
    job.save(tmp_path / "job")
    (tmp_path / "job" / "job.npz").unlink()
    with pytest.raises(InputError, match=r"job\.npz' does not exist"):
        Job.load(tmp_path / "job")
    (tmp_path / "job" / "job.json").unlink()
    with pytest.raises(InputError, match=r"job\.json' does not exist"):
        Job.load(tmp_path / "job")


def test_saving_without_the_photo_leaves_nothing(tmp_path: Path, job: Job):
    job.image.unlink()
    with pytest.raises((InputError, FileNotFoundError)):
        job.save(tmp_path / "job")
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize("plan", ["lean", "full"])
def test_the_plan_round_trips_and_older_jobs_are_lean(tmp_path: Path, photo: Path, plan: str):
    Job(photo, plan=plan).save(tmp_path / "job")
    assert Job.load(tmp_path / "job").plan == plan
    data = json.loads((tmp_path / "job" / "job.json").read_text())
    assert data.pop("plan") == plan
    (tmp_path / "job" / "job.json").write_text(json.dumps(data))
    assert Job.load(tmp_path / "job").plan == "lean"


def rewritten(folder: Path, **changes: Any) -> None:
    """The job file with other values; one that is ... is left out."""
    path = folder / "job.json"
    data = json.loads(path.read_text()) | changes
    path.write_text(json.dumps({name: value for name, value in data.items() if value is not ...}))


def test_what_a_job_file_leaves_out_is_the_usual(tmp_path: Path, photo: Path):
    folder = tmp_path / "job"
    Job(photo).save(folder)
    assert json.loads((folder / "job.json").read_text()) == {
        "schema": 1,
        "image": "photo.png",
        "model": "default",
        "landmarks": None,
        "camera": None,
        "light_color": "multi",
        "freeze": [],
        "weights": {"photo": 1.0, "landmarks": 1.0, "prior": 1.0, "light": 1.0},
        "budget_seconds": None,
        "seed": 0,
        "device": "auto",
        "truth": None,
        "face_region": None,
        "plan": "lean",
        "quality": "good",
        "face": None,
        "surround": "auto",
        "exposure": "known",
        "white_balance": None,
        "skin_tone": None,
        "texture_size": None,
        "pins": None,
    }
    (folder / "job.json").write_text(json.dumps({"schema": 1, "image": "photo.png"}))
    assert_same(replace(Job.load(folder), image=photo), Job(photo))
    rewritten(folder, weights={})
    assert Job.load(folder).weights == Weights(1.0, 1.0, 1.0, 1.0)


@pytest.mark.parametrize(
    ("name", "right", "wrong"),
    [
        ("seed", [0, 10**9], [-1, 10**9 + 1]),
        ("face", [1, 10**6], [0, 10**6 + 1]),
        ("budget_seconds", [1e-9, 1e9], [0, 1.001e9]),
        *(
            ("weights", [{term: 0}, {term: 1e9}], [{term: -1e-9}, {term: 1.001e9}])
            for term in ("photo", "landmarks", "prior", "light")
        ),
    ],
)
def test_limits_of_numbers(tmp_path: Path, photo: Path, name: str, right: list, wrong: list):
    Job(photo).save(tmp_path / "job")
    for value in right:
        rewritten(tmp_path / "job", **{name: value})
        found = getattr(Job.load(tmp_path / "job"), name)
        assert found == (replace(Weights(), **value) if name == "weights" else value)
    for value in wrong:
        rewritten(tmp_path / "job", **{name: value})
        with pytest.raises(InputError, match="budget" if name == "budget_seconds" else name):
            Job.load(tmp_path / "job")


def test_a_job_for_light_that_counts_for_nothing_and_the_largest_seed_is_one(photo: Path):
    job = Job(
        photo, weights=Weights(0, 0, 0, 0), seed=10**9, face=1, budget_seconds=1e-9, quality="good"
    )
    assert vars(job.weights) == {"photo": 0, "landmarks": 0, "prior": 0, "light": 0}
    with pytest.raises(InputError, match="The quality is 'superb'; expected one of"):
        Job(photo, quality="superb")


def test_the_photo_is_copied_under_a_plain_name(tmp_path: Path, job: Job):
    job.save(tmp_path / "job")
    assert sorted(path.name for path in (tmp_path / "job").iterdir()) == [
        "job.json",
        "job.npz",
        "photo.png",
    ]

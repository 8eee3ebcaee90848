"""A whole fit of a small job: what it writes, what it holds fixed, what it does with time, options
and bad input.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path, PurePath
from typing import Any

import numpy as np
import pytest

from facestage.contract.camera import Camera
from facestage.contract.errors import InputError
from facestage.contract.events import DONE, STARTED, Event
from facestage.contract.files.partial import partial_folder
from facestage.contract.job import Job, Weights
from facestage.contract.light_stage import FROZEN, OFF, ON, fibonacci_stage
from facestage.contract.parameters import PARAMETERS
from facestage.contract.quality import DRAFT
from facestage.contract.relight_cache import RelightCache
from facestage.contract.result import BUDGET_SPENT, CONVERGED, PICTURES, Result
from facestage.contract.result_files import is_result_file
from facestage.fit.given.fineness import TEXELS_PER_FACE_PX
from facestage.fit.result import run
from facestage.images.image_io import read_exr, resize
from reference.known import known
from reference.small_fit import QUICK, REPORTED
from reference.synthetic_case import Case

fit_job = partial(run.fit_job, fineness=QUICK)


@pytest.fixture(scope="module")
def job(case: Case) -> Job:
    return case.job()


@dataclass(frozen=True)
class Plain:
    """The job fitted without any option: many tests compare with it, and none may change it."""

    result: Result
    events: list[Event]


@pytest.fixture(scope="module")
def plain(job: Job, tmp_path_factory: pytest.TempPathFactory) -> Plain:
    events: list[Event] = []
    out = tmp_path_factory.mktemp("plain") / "out"
    return Plain(run.fit_job(job, out, emit=events.append, fineness=REPORTED), events)


def test_the_result_folder_is_complete(plain: Plain):
    result, events, out = plain.result, plain.events, known(plain.result.folder)
    for name in (
        "result.json",
        "result.npz",
        "job.json",
        "job.npz",
        "trace.jsonl",
        "report.html",
        *PICTURES,
    ):
        assert (out / name).is_file(), name
    assert [path.name for path in out.parent.iterdir()] == ["out"], "nothing else stays behind"
    loaded = Result.load(out)
    assert loaded.status == CONVERGED and loaded.advice == result.advice
    np.testing.assert_array_equal(loaded.vertices, result.vertices)
    assert read_exr(out / "render.exr").shape == (96, 96, 3)
    probe = read_exr(out / "light_probe.exr")
    assert probe.shape[1] == 2 * probe.shape[0] and probe.max() > 0
    assert Job.load(out).landmarks is not None
    rows = [json.loads(line) for line in (out / "trace.jsonl").read_text().splitlines()]
    assert rows[0]["stage"] == "pose" and rows[-1]["stage"] == "albedo detail"
    assert rows[-1]["psnr"] > next(row["psnr"] for row in rows if "psnr" in row)
    assert all("similarity_mm" in row for row in rows)
    print(f"psnr {result.errors['psnr']:.1f} dB, {result.errors['similarity_mm']:.2f} mm")
    assert result.errors["psnr"] > 30
    assert [events[0].kind, events[-1].kind] == [STARTED, DONE]
    assert events[1].message == "Face model: synthetic; licence: CC0; made for tests"
    assert loaded.model_origin == {
        "name": "synthetic",
        "license": "CC0",
        "source": "made for tests",
    }
    fractions = [event.fraction for event in events]
    assert fractions == sorted(fractions) and fractions[-1] == 1.0


def test_the_same_job_gives_the_same_answer(job: Job, plain: Plain, tmp_path: Path):
    """However many threads render."""
    import drjit

    first, threads = plain.result, drjit.thread_count()
    drjit.set_thread_count(2 if threads == 1 else 1)
    try:
        second = fit_job(job, tmp_path / "again")
    finally:
        drjit.set_thread_count(threads)
    np.testing.assert_allclose(first.vertices, second.vertices, atol=1e-9)
    np.testing.assert_allclose(first.stage.radiance, second.stage.radiance, rtol=1e-9)


def test_the_truth_changes_nothing_in_the_fit(job: Job, plain: Plain, tmp_path: Path):
    told, blind = plain.result, fit_job(replace(job, truth=None), tmp_path / "blind")
    np.testing.assert_array_equal(told.vertices, blind.vertices)
    assert "similarity_mm" in told.errors and "similarity_mm" not in blind.errors


def test_off_lights_are_exactly_zero_and_frozen_ones_keep_their_radiance(job: Job, tmp_path: Path):
    stage = fibonacci_stage(4, radiance=0.25)
    stage = replace(stage, state=np.array([ON, OFF, FROZEN, ON])).with_radiance(stage.radiance)
    result = fit_job(replace(job, stage=stage), tmp_path / "out")
    np.testing.assert_array_equal(result.stage.state, stage.state)
    np.testing.assert_array_equal(result.stage.radiance[1], 0.0)
    np.testing.assert_array_equal(result.stage.radiance[2], 0.25)
    assert (result.stage.radiance[[0, 3]] >= 0).all() and result.stage.radiance[0].max() > 0
    assert any("lights" in entry["what"] for entry in result.left_out)


def test_one_light_color_is_one_chromaticity(job: Job, tmp_path: Path):
    radiance = fit_job(replace(job, light_color="uniform"), tmp_path / "out").stage.radiance
    lit = radiance.max(1) > 0
    share = radiance[lit] / radiance[lit].sum(1, keepdims=True)
    np.testing.assert_allclose(share, np.broadcast_to(share[0], share.shape), rtol=1e-9)


FROZEN_VALUES: dict[str, Callable[[Result], Any]] = {
    "identity": lambda result: result.identity,
    "expression": lambda result: result.expression,
    "albedo": lambda result: result.albedo,
    "specular": lambda result: result.specular,
    "roughness": lambda result: result.roughness,
    "interreflection": lambda result: result.parameters["interreflection"],
    "scattering": lambda result: result.parameters["scattering"],
    "translucency": lambda result: result.parameters["translucency"],
    "lights": lambda result: result.stage.radiance,
    "pose": lambda result: result.model_to_camera,
    "focal": lambda result: result.camera.focal_px,
    "light_position": lambda result: result.stage.position,
}


INITIAL = {
    "identity": np.array([0.5, 0.0, -0.5, 0.25]),
    "expression": np.array([0.2, 0.1, 0.3]),
    "albedo": np.array([0.1, 0.2, 0.0, -0.1, 0.0]),
    "roughness": np.array(0.33),
    "interreflection": np.array(0.7),
    "scattering": np.array(0.7),
    "translucency": np.array(0.7),
    "specular": np.full((6, 6), 0.6),
    "model_to_camera": np.array(
        [[1, 0, 0, 0.012], [0, 1, 0, -0.008], [0, 0, 1, -0.6], [0, 0, 0, 1]]
    ),
}


@pytest.fixture(scope="module")
def begun(job: Job) -> Job:
    """The job with values to start from, its camera unknown."""
    return replace(job, initial=INITIAL, stage=fibonacci_stage(4, radiance=3.0), camera=None)


@pytest.fixture(scope="module")
def free(begun: Job, tmp_path_factory: pytest.TempPathFactory) -> Result:
    return fit_job(begun, tmp_path_factory.mktemp("free") / "out")


# One photo has no relief (tests of several photos: test_person.py).
MAY_MOVE = [name for name in PARAMETERS if name != "relief"]


@pytest.mark.parametrize("names", [MAY_MOVE[::3], MAY_MOVE[1::3], MAY_MOVE[2::3]], ids="-".join)
def test_frozen_parameters_do_not_move(begun: Job, free: Result, tmp_path: Path, names: list[str]):
    held = fit_job(replace(begun, freeze=tuple(names)), tmp_path / "held")
    starts: dict[str, Any] = INITIAL | {
        "lights": 3.0,
        "pose": INITIAL["model_to_camera"],
        "focal": Camera.default(96, 96).focal_px,
        "light_position": fibonacci_stage(4).position,
    }
    for name in names:
        value, start = FROZEN_VALUES[name], starts[name]
        np.testing.assert_allclose(value(held), start, rtol=1e-12, atol=1e-12, err_msg=name)
        assert not np.allclose(value(free), start, rtol=1e-3), f"{name} does move when it is free"


def test_everything_frozen_is_a_render(job: Job, tmp_path: Path):
    result = fit_job(
        replace(job, freeze=PARAMETERS, stage=fibonacci_stage(4, radiance=3.0)), tmp_path / "out"
    )
    assert not result.identity.any() and read_exr(tmp_path / "out" / "render.exr").max() > 0


def test_frozen_lights_of_one_color(job: Job, tmp_path: Path):
    stage = fibonacci_stage(4, radiance=2.0)
    result = fit_job(
        replace(job, freeze=("lights",), light_color="uniform", stage=stage), tmp_path / "out"
    )
    np.testing.assert_array_equal(result.stage.radiance, 2.0)


@pytest.mark.parametrize(
    "change",
    [
        {"seed": 1},
        {"weights": Weights(photo=0.01)},
        {"weights": Weights(prior=30.0)},
        {"weights": Weights(landmarks=30)},
        {"weights": Weights(light=300.0)},
        {"light_color": "uniform"},
        {"stage": fibonacci_stage(7)},
        {"camera": None},
        {"camera_to_stage": np.diag([-1.0, 1, -1, 1]) + np.outer([0, 0, -0.6, 0], [0, 0, 0, 1])},
    ],
    ids=lambda change: next(iter(change)),
)
def test_every_option_changes_something(job: Job, plain: Plain, tmp_path: Path, change: dict):
    other = fit_job(replace(job, **change), tmp_path / "other")
    assert np.abs(other.vertices - plain.result.vertices).max() > 1e-8


class Clock:
    """A clock that advances by a second whenever it is read."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        self.now += 1.0
        return self.now


@pytest.mark.parametrize("budget", [1e-3, 30.0])
def test_a_spent_budget_ends_early_with_a_result(
    job: Job, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, budget: float
):
    import time

    monkeypatch.setattr(time, "monotonic", Clock())
    result = fit_job(replace(job, budget_seconds=budget), tmp_path / "out")
    assert (
        result.status == BUDGET_SPENT
        and "--budget" in result.advice
        and "--resume" in result.advice
    )
    assert (partial_folder(tmp_path / "out") / "checkpoint.npz").is_file(), (
        "so that --resume can go on"
    )
    assert (tmp_path / "out" / "render.exr").is_file()
    stages = {
        row["stage"]
        for row in map(json.loads, (tmp_path / "out" / "trace.jsonl").read_text().splitlines())
    }
    assert "joint" not in stages


def test_resume_after_a_spent_budget_finishes(
    job: Job, plain: Plain, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    with monkeypatch.context() as patch:
        import time

        patch.setattr(time, "monotonic", Clock())
        fit_job(replace(job, budget_seconds=25.0), tmp_path / "out")
    resumed = fit_job(job, tmp_path / "out", resume=True)
    assert resumed.status == CONVERGED
    whole = plain.result
    # The budget stops between phases or after a step, where an unhurried run may take one step
    # more.
    assert resumed.errors["psnr"] == pytest.approx(whole.errors["psnr"], abs=1.0)
    assert not partial_folder(tmp_path / "out").exists()


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def bad_truth(tmp_path: Path) -> Path:
    path = tmp_path / "truth.npz"
    np.savez(path, vertices=np.zeros((3, 3)))
    return path


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda _: {"landmarks": None}, "landmarks.*--landmarks"),
        (lambda _: {"camera": Camera(95, 96, 200.0, (48, 48))}, "95 x 96.*96 x 96"),
        (lambda path: {"truth": bad_truth(path)}, r"truth.*\(3, 3\).*\(529, 3\)"),
        (lambda path: {"truth": path / "none.npz"}, "truth file.*does not exist"),
        (lambda _: {"initial": {"identity": np.zeros(7)}}, r"identity.*\(7,\).*\(4,\)"),
        (lambda _: {"initial": {"albedo": np.full(5, np.nan)}}, "albedo"),
        (lambda _: {"initial": {"specular": np.zeros((3, 4))}}, "specular"),
        (lambda _: {"initial": {"roughness": np.array(np.nan)}}, "roughness"),
        (lambda _: {"initial": {"model_to_camera": np.zeros((4, 4))}}, "model_to_camera"),
        (lambda _: {"initial": {"beauty": np.zeros(2)}}, "beauty"),
        (
            lambda _: {"stage": replace(fibonacci_stage(2, radiance=0.0), state=np.full(2, OFF))},
            "lights.*off",
        ),
        (
            lambda _: {
                "stage": replace(fibonacci_stage(2, radiance=0.0), state=np.full(2, FROZEN))
            },
            "frozen at radiance 0",
        ),
        (lambda _: {"model": "npz:/nowhere.npz"}, "nowhere.npz"),
    ],
)
def test_bad_jobs_write_nothing(job: Job, tmp_path: Path, change, words: str):
    changed = replace(job, **change(tmp_path))
    before = names(tmp_path)
    with pytest.raises(InputError, match=words):
        fit_job(changed, tmp_path / "out")
    assert names(tmp_path) == before


def test_a_folder_that_is_no_result_is_never_replaced(job: Job, tmp_path: Path):
    out = tmp_path / "pictures"
    out.mkdir()
    (out / "holiday.jpg").touch()
    with pytest.raises(InputError, match="not a result"):
        fit_job(job, out)
    assert names(tmp_path) == ["pictures"] and names(out) == ["holiday.jpg"]


def test_an_earlier_result_is_replaced(job: Job, plain: Plain, tmp_path: Path):
    shutil.copytree(known(plain.result.folder), tmp_path / "out")
    (tmp_path / "out" / "relit_from_below.png").touch()
    fit_job(job, tmp_path / "out")
    assert "relit_from_below.png" not in names(tmp_path / "out") and "result.json" in names(
        tmp_path / "out"
    )
    assert [name for name in names(tmp_path / "out") if not is_result_file(PurePath(name))] == []


@pytest.mark.parametrize("place", [(3.0, 0, -0.6), (0, 0, 0.6)])
def test_a_face_outside_the_photo_is_refused_in_words(
    job: Job, tmp_path: Path, place: tuple[float, float, float]
):
    pose = np.eye(4)
    pose[:3, 3] = place
    job = replace(job, initial={"model_to_camera": pose}, freeze=("pose", "identity", "expression"))
    with pytest.raises(InputError, match="landmarks"):
        fit_job(job, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_fully_masked_face_is_refused_in_words(job: Job, case: Case, tmp_path: Path):
    from PIL import Image

    pixels = np.asarray(Image.open(case.photo).convert("RGBA")).copy()
    pixels[..., 3] = 0
    pixels[:3, :3, 3] = 255
    Image.fromarray(pixels).save(tmp_path / "masked.png")
    with pytest.raises(InputError, match="usable pixels"):
        fit_job(replace(job, image=tmp_path / "masked.png"), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def _with_lens(job: Job, folder: Path, millimeters: int) -> Job:
    """The job on a JPEG of its photo whose EXIF names a lens, its camera left out."""
    from PIL import Image

    exif = Image.Exif()
    with Image.open(job.image) as photo:
        exif.get_ifd(0x8769).update(
            {0xA405: millimeters, 0xA002: 4 * photo.width, 0xA003: 3 * photo.width}
        )
        # The shape of a sensor: the photo in the corner of a 4:3 picture, the rest transparent to
        # no one.
        wide = Image.new("RGB", (4 * photo.height // 3, photo.height))
        wide.paste(photo.convert("RGB"))
    wide.save(folder / "lens.jpg", exif=exif, quality=95)
    return replace(job, image=folder / "lens.jpg", camera=None)


def test_the_lens_of_the_exif_is_where_the_fit_starts(job: Job, tmp_path: Path):
    from facestage.fit.given.problem import read_problem

    lens = _with_lens(job, tmp_path, 85)
    problem = read_problem(lens)
    width, height = problem.photograph.size
    expected = 85 * np.hypot(width, height) / np.hypot(36, 24)
    assert problem.fit_focal and problem.focal_sigma == 0.05
    assert problem.camera.focal_px == pytest.approx(expected)
    result = fit_job(lens, tmp_path / "out")
    assert "85 mm" in result.photo["focal"] and result.photo["color"] == "sRGB"
    # Landmarks and photo may move it, but not as far as they would from a mere guess.
    assert abs(np.log(result.camera.focal_px / expected)) < 0.15
    deviation = result.arrays["deviation/focal"]
    assert 0 < float(deviation.max()) <= 0.05
    assert Result.load(tmp_path / "out").photo == result.photo


def test_a_given_camera_is_held_whatever_the_exif_says(job: Job, tmp_path: Path):
    from facestage.fit.given.problem import read_problem

    lens = _with_lens(job, tmp_path, 24)
    size = read_problem(lens).photograph.size
    given = replace(lens, camera=Camera.default(*size, 300.0))
    problem = read_problem(given)
    assert not problem.fit_focal and problem.camera.focal_px == 300.0
    assert "as given" in problem.read_from_photo()["focal"]
    assert "guess" in read_problem(replace(job, camera=None)).read_from_photo()["focal"]


def test_a_large_photo_comes_back_in_its_own_pixels(job: Job, tmp_path: Path):
    """The same photo, and the same enlarged beyond what is worked on at full size, end at the same
    face.
    """
    from PIL import Image

    # What is large begins between the two; the face is made as small as it was.
    factor = 3
    fineness = replace(QUICK, photo_pixels=30_000, face_px=60.0)
    with Image.open(job.image) as photo:
        large = photo.convert("RGB").resize(
            (factor * photo.width, factor * photo.height), Image.Resampling.BICUBIC
        )
    large.save(tmp_path / "large.png")
    assert job.landmarks is not None and job.camera is not None
    camera = job.camera
    enlarged = Camera(
        factor * camera.width,
        factor * camera.height,
        factor * camera.focal_px,
        (factor * camera.principal_px[0], factor * camera.principal_px[1]),
    )
    landmarks = replace(job.landmarks, points=factor * job.landmarks.points)
    small = run.fit_job(job, tmp_path / "small", fineness=fineness)
    result = run.fit_job(
        replace(job, image=tmp_path / "large.png", landmarks=landmarks, camera=enlarged),
        tmp_path / "large",
        fineness=fineness,
    )
    assert (result.camera.width, result.camera.height) == (enlarged.width, enlarged.height)
    assert result.camera.focal_px == pytest.approx(enlarged.focal_px)
    np.testing.assert_allclose(result.camera.principal_px, enlarged.principal_px)
    assert "worked on" in result.photo["size"] and "worked on" not in small.photo["size"]
    assert read_exr(tmp_path / "large" / "render.exr").shape[:2] == (
        enlarged.height,
        enlarged.width,
    )
    np.testing.assert_allclose(
        result.camera.project(result.vertices),
        factor * small.camera.project(small.vertices),
        atol=0.02 * factor * camera.width,
    )
    assert result.errors["similarity_mm"] < small.errors["similarity_mm"] + 0.4
    assert result.errors["landmark_px"] == pytest.approx(
        factor * small.errors["landmark_px"], rel=0.3
    )


def test_a_draft_of_a_large_face_is_smaller_and_can_be_relit(job: Job, tmp_path: Path):
    """Its relight cache is of the size that was worked on, and of the whole photo."""
    from facestage.fit.given.problem import read_problem

    texels = round(TEXELS_PER_FACE_PX * read_problem(job).face_size_px / 2)
    result = run.fit_job(
        replace(job, quality=DRAFT), tmp_path, fineness=replace(QUICK, draft_texture=texels)
    )
    assert "worked on" in result.photo["size"] and result.camera.width == 96
    cache, render = RelightCache.load(result), read_exr(tmp_path / "render.exr")
    assert cache is not None and 40 < cache.width < 56 and render.shape[:2] == (96, 96)
    small = resize(render, cache.width, cache.height)
    relit = cache.relight(result.stage.radiance)
    assert np.abs(relit - small).mean() < 0.05 * small.mean()

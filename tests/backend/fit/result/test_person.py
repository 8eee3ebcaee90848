"""Several small photos of one person, from the jobs to the folder."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from PIL import Image

from facestage.contract.errors import InputError
from facestage.contract.events import DONE, STARTED, Event
from facestage.contract.files.partial import partial_folder
from facestage.contract.job import Job
from facestage.contract.person import Person
from facestage.contract.result import CONVERGED, STOPPED, Result
from facestage.contract.result_files import is_result_file
from facestage.fit.face.joint_layout import JointLayout
from facestage.fit.given.metrics import aligned_distance
from facestage.fit.given.problem import read_problem
from facestage.fit.result import person as person_fit
from facestage.fit.result import run
from facestage.fit.result.relight import render_result
from facestage.fit.runs import joint_run
from facestage.fit.stages.matching import LOOKS, Look
from facestage.fit.stereo.joint_term import JointTerm, JointWeighed, States
from facestage.images.image_io import read_exr
from facestage.models.anatomy.relief import relief_basis
from facestage.models.registry import load_model
from reference.known import known
from reference.small_fit import QUICK, SMALL, StopError
from reference.synthetic_case import Case, write_case
from reference.synthetic_scene import Scene
from reference.two_photos import another_photo

pytestmark = pytest.mark.usefixtures("renderer")

fit_job = partial(run.fit_job, fineness=SMALL)
fit_person = partial(person_fit.fit_person, fineness=SMALL)
quick_fit = partial(person_fit.fit_person, fineness=QUICK)


@pytest.fixture(scope="module")
def jobs(case: Case, scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> list[Job]:
    """Two photos of the person, and one of another."""
    second = write_case(tmp_path_factory.mktemp("second"), another_photo(scene))
    other = replace(scene.state, identity=np.array([-1.5, 1.5, -1.2, -1.5]))
    stranger = write_case(
        tmp_path_factory.mktemp("stranger"), another_photo(replace(scene, state=other))
    )
    return [one.job(model=case.model_option) for one in (case, second, stranger)]


@pytest.fixture(scope="module")
def folder(jobs: list[Job], renderer: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The two photos fitted together, with all that is written."""
    out = tmp_path_factory.mktemp("person") / "out"
    events: list[Event] = []
    person_fit.fit_person(jobs[:2], out, emit=events.append, fineness=replace(SMALL, report=True))
    assert [events[0].kind, events[-1].kind] == [STARTED, DONE]
    fractions = [event.fraction for event in events]
    assert fractions == sorted(fractions) and fractions[-1] == 1.0
    words = " ".join(event.message for event in events)
    assert "photo 1 of 2" in words and "photo 2 of 2" in words and "2 photos together" in words
    return out


@pytest.fixture(scope="module")
def pair(jobs: list[Job], renderer: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The two photos fitted quickly together, to compare with; nobody may change it."""
    out = tmp_path_factory.mktemp("pair") / "out"
    quick_fit(jobs[:2], out)
    return out


def identity_error(scene: Scene, identity: np.ndarray) -> float:
    """Mean distance in mm between the faces at rest, after similarity alignment."""
    rest = np.zeros(3)
    found, wanted = scene.model.shape(identity, rest), scene.model.shape(scene.state.identity, rest)
    return 1e3 * float(aligned_distance(found, wanted, scale=True).mean())


def test_two_photos_beat_each_alone(jobs: list[Job], folder: Path, scene: Scene, tmp_path: Path):
    alone = [fit_job(job, tmp_path / str(number)) for number, job in enumerate(jobs[:2])]
    errors = [identity_error(scene, result.identity) for result in alone]
    together = identity_error(scene, Person.load(folder).identity)
    print(f"identity alone {errors[0]:.3f} and {errors[1]:.3f} mm, together {together:.3f} mm")
    assert together < min(errors)


def test_every_photo_has_an_ordinary_result_of_the_same_person(
    folder: Path, jobs: list[Job], tmp_path: Path
):
    person = Person.load(folder)
    assert person.status == CONVERGED and person.advice.startswith("Converged: 2 photos")
    assert [photo.number for photo in person.photos] == [1, 2] and all(
        photo.shares_shape for photo in person.photos
    )
    results = [Result.load(folder / photo.folder) for photo in person.photos]
    for result, photo in zip(results, person.photos, strict=True):
        np.testing.assert_array_equal(result.identity, person.identity)
        np.testing.assert_array_equal(result.albedo, person.albedo)
        assert result.relief is None, "smooth skin says nothing of it"
        np.testing.assert_array_equal(result.specular, person.specular)
        assert result.roughness == person.roughness and result.errors["psnr"] > 30
        assert result.errors == photo.errors
        np.testing.assert_array_equal(
            read_exr(folder / photo.folder / "albedo.exr"), read_exr(folder / "albedo.exr")
        )
        assert (folder / photo.folder / "report.html").is_file()
    assert not np.allclose(results[0].expression, results[1].expression)
    assert not np.allclose(results[0].model_to_camera, results[1].model_to_camera)
    assert [result.camera.width for result in results] == [96, 80]
    render_result(folder / person.photos[1].folder, tmp_path / "relit.png", None, None, None)
    with Image.open(tmp_path / "relit.png") as picture:
        assert picture.size == (80, 80)
    page = (folder / "person.html").read_text()
    assert f"{person.photos[1].folder}/report.html" in page
    with Image.open(folder / "person.png") as picture:
        assert picture.width > picture.height > 300
    assert not partial_folder(folder).exists()
    files = [path.relative_to(folder) for path in folder.rglob("*") if path.is_file()]
    assert [str(path) for path in files if not is_result_file(path)] == []


class Towards(JointTerm, JointWeighed):
    """A term that wants the first weights of the relief to be TARGET."""

    words: ClassVar = {"towards": "Towards"}
    TARGET, STIFF = np.array([1.5, -1.0]), 1e4

    def __init__(self, states: States = ()) -> None:
        self.states = states

    def weighed(self, states: States) -> JointWeighed:
        return Towards(states)

    def off(self, states: States) -> np.ndarray:
        return states[0].relief[: len(self.TARGET)] - self.TARGET

    @property
    def energies(self) -> tuple[dict[str, float], ...]:
        return tuple({"towards": 0.0} for _ in self.states)

    def add_to(self, hessian: np.ndarray, gradient: np.ndarray, layout: JointLayout) -> None:
        first = layout.columns[0][layout.layouts[0].slices["relief"]][: len(self.TARGET)]
        hessian[first, first] += self.STIFF
        gradient[first] += self.STIFF * self.off(self.states)

    def decrease(self, states: States) -> float:
        before, after = (float((self.off(each) ** 2).sum()) for each in (self.states, states))
        return 0.5 * self.STIFF * (before - after)


def test_relief_that_matches_say_is_one_for_all_and_rendered_again(
    jobs: list[Job], pair: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(joint_run, "stereo_between", lambda photos, look: Towards())
    out = tmp_path / "out"
    person = quick_fit(jobs[:2], out)
    results = [Result.load(out / photo.folder) for photo in person.photos]
    relief = known(results[0].relief)
    model = load_model(jobs[0].model)
    basis = relief_basis(model)
    fields = basis.reshape(len(basis), -1).T
    weights = np.linalg.lstsq(fields.astype(float), relief.ravel().astype(float), rcond=None)[0]
    np.testing.assert_allclose(weights[:2], Towards.TARGET, atol=0.05)
    for result in results:
        np.testing.assert_array_equal(known(result.relief), relief)
        shape = model.shape(result.identity, result.expression) + relief
        matrix = result.model_to_camera
        np.testing.assert_allclose(
            result.vertices, shape @ matrix[:3, :3].T + matrix[:3, 3], atol=1e-6
        )
        assert result.arrays["deviation/relief"].any()
    folder = out / person.photos[0].folder
    render_result(folder, tmp_path / "same.exr", None, {}, 4)
    replace(results[0], arrays={}).write_into(folder)
    render_result(folder, tmp_path / "flat.exr", None, {}, 4)
    same, flat = (read_exr(tmp_path / name) for name in ("same.exr", "flat.exr"))
    assert np.abs(same - flat).max() > 1e-3


def test_frozen_relief_stays_flat(jobs: list[Job], tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(joint_run, "stereo_between", lambda photos, look: Towards())
    frozen = [replace(job, freeze=("relief",)) for job in jobs[:2]]
    person = quick_fit(frozen, tmp_path / "out")
    assert Result.load(tmp_path / "out" / person.photos[0].folder).relief is None


def test_stopped_in_the_middle_it_ends_at_the_same_place(
    jobs: list[Job], pair: Path, tmp_path: Path
):
    whole = Person.load(pair)

    def stop(event: Event) -> None:
        if "together: geometry, step 1" in event.message:
            raise StopError

    with pytest.raises(StopError):
        quick_fit(jobs[:2], tmp_path / "out", emit=stop)
    again = quick_fit(jobs[:2], tmp_path / "out", resume=True)
    np.testing.assert_allclose(again.identity, whole.identity, rtol=1e-6, atol=1e-9)
    for photo in whole.photos:
        one, other = (Result.load(out / photo.folder) for out in (pair, tmp_path / "out"))
        np.testing.assert_allclose(one.vertices, other.vertices, atol=1e-7)


def test_lights_behind_the_face_join_in_each_photo_that_needs_them(jobs: list[Job], tmp_path: Path):
    pair = [replace(jobs[0], surround="on"), replace(jobs[1], surround="off")]
    whole = quick_fit(pair, tmp_path / "whole")

    def stop(event: Event) -> None:
        if "together: geometry, step 1" in event.message:
            raise StopError

    with pytest.raises(StopError):
        quick_fit(pair, tmp_path / "out", emit=stop)
    again = quick_fit(pair, tmp_path / "out", resume=True)
    np.testing.assert_allclose(again.identity, whole.identity, rtol=1e-6, atol=1e-9)
    for number, photo in enumerate(whole.photos):
        one, other = (Result.load(tmp_path / out / photo.folder) for out in ("whole", "out"))
        np.testing.assert_allclose(one.stage.radiance, other.stage.radiance, atol=1e-6)
        own = len(known(pair[number].stage))
        assert (len(one.stage) > own) == ("light" in one.photo) == (number == 0)


def test_a_checkpoint_of_other_photos_is_refused(jobs: list[Job], tmp_path: Path):
    def stop(event: Event) -> None:
        if "together: light" in event.message:
            raise StopError

    with pytest.raises(StopError):
        quick_fit(jobs[:2], tmp_path / "out", emit=stop)
    with pytest.raises(InputError, match=r"belongs to another job.*--resume"):
        quick_fit(jobs[1::-1], tmp_path / "out", resume=True)
    with pytest.raises(InputError, match="of 2 photos, and 3"):
        quick_fit(jobs, tmp_path / "out", resume=True)


def test_large_photos_are_fitted_small_and_shown_whole(jobs: list[Job], pair: Path, tmp_path: Path):
    small = [read_problem(job).face_size_px for job in jobs[:2]]
    plain = Person.load(pair)
    # As if the faces were larger than what the phases look at.
    fineness = replace(QUICK, joint_face_px=0.8 * max(small))
    person = person_fit.fit_person(jobs[:2], tmp_path / "out", fineness=fineness)
    results = [Result.load(tmp_path / "out" / photo.folder) for photo in person.photos]
    assert [result.camera.width for result in results] == [96, 80]
    for result, photo, job in zip(results, plain.photos, jobs, strict=False):
        assert result.camera == job.camera
        assert (
            read_exr(tmp_path / "out" / f"{photo.folder}" / "render.exr").shape[1]
            == job.camera.width
        )
        print(f"PSNR {photo.errors['psnr']:.1f} dB, fitted smaller {result.errors['psnr']:.1f} dB")
        assert result.errors["psnr"] > photo.errors["psnr"] - 3
        assert result.errors["landmark_px"] == pytest.approx(photo.errors["landmark_px"], abs=0.3)


def test_another_person_is_named(jobs: list[Job], tmp_path: Path):
    person = quick_fit([jobs[0], jobs[2]], tmp_path / "two")
    assert person.status == STOPPED and "Photos 1 and 2 may show different people" in person.advice


def test_another_person_among_three_is_left_out(jobs: list[Job], pair: Path, tmp_path: Path):
    person = quick_fit(jobs, tmp_path / "three")
    assert person.status == STOPPED and person.advice.startswith(
        "Photo 3 (photo.png): This photo may show another"
    )
    assert [photo.shares_shape for photo in person.photos] == [True, True, False]
    two = Person.load(pair)
    np.testing.assert_allclose(person.identity, two.identity, rtol=1e-6, atol=1e-9)


def test_a_photo_of_no_face_is_left_out(jobs: list[Job], tmp_path: Path):
    noise = np.random.default_rng(5).integers(0, 255, (80, 80, 3), np.uint8)
    Image.fromarray(noise).save(tmp_path / "noise.png")
    person = quick_fit([jobs[0], replace(jobs[1], image=tmp_path / "noise.png")], tmp_path / "out")
    assert (
        person.status == STOPPED
        and "left out of the shape" in person.advice
        and "noise.png" in person.advice
    )
    assert [photo.shares_shape for photo in person.photos] == [True, False]
    first, second = (Result.load(tmp_path / "out" / photo.folder) for photo in person.photos)
    np.testing.assert_array_equal(first.identity, second.identity)
    assert np.isfinite(second.vertices).all() and second.status == STOPPED


def test_where_no_photo_is_believed_the_shape_is_the_landmarks(jobs: list[Job], tmp_path: Path):
    for number in (0, 1):
        size = (96, 80)[number]
        noise = np.random.default_rng(number).integers(0, 255, (size, size, 3), np.uint8)
        Image.fromarray(noise).save(tmp_path / f"noise{number}.png")
    changed = [
        replace(job, image=tmp_path / f"noise{number}.png") for number, job in enumerate(jobs[:2])
    ]
    person = quick_fit(changed, tmp_path / "out")
    assert person.status == STOPPED and "landmarks' own" in person.advice
    assert not any(photo.shares_shape for photo in person.photos)


Change = Callable[[list[Job]], list[Job]]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda jobs: jobs[:1], "1 photo of one person given; expected 2 to 8"),
        (lambda jobs: jobs * 3, "9 photos"),
        (lambda jobs: [jobs[0], jobs[0]], "same file"),
        (lambda jobs: [jobs[0], replace(jobs[1], model="default")], "differ in the face model"),
        (lambda jobs: [jobs[0], replace(jobs[1], freeze=("albedo",))], "differ in what is frozen"),
        (lambda jobs: [replace(job, texture_size=4096) for job in jobs], "2048 pixels at most"),
        (
            lambda jobs: [jobs[0], replace(jobs[1], image=Path("missing.png"))],
            "Photo 2 of 2 .'missing.png'",
        ),
    ],
)
def test_refusals(jobs: list[Job], tmp_path: Path, change: Change, words: str):
    with pytest.raises(InputError, match=words):
        fit_person(change(jobs), tmp_path / "out")
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_no_person_stays(jobs: list[Job], tmp_path: Path):
    (tmp_path / "note.txt").write_text("mine")
    with pytest.raises(InputError, match="not a result"):
        fit_person(jobs[:2], tmp_path)
    assert (tmp_path / "note.txt").read_text() == "mine"


@pytest.mark.parametrize("change", [{"schema": 9}, {"identity": "x"}, {"photos": None}])
def test_a_damaged_person_file_is_refused(folder: Path, tmp_path: Path, change: dict):
    data = json.loads((folder / "person.json").read_text()) | change
    (tmp_path / "person.json").write_text(json.dumps(data))
    with pytest.raises(InputError, match="person file"):
        Person.load(tmp_path)


def test_skins_are_compared_as_long_as_there_is_time(
    jobs: list[Job], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    looks: list[Look] = []
    monkeypatch.setattr(joint_run, "stereo_between", lambda photos, look: looks.append(look))
    hurried = [replace(job, budget_seconds=1e-3) for job in jobs[:2]]
    quick_fit(hurried, tmp_path / "hurried")
    assert not looks
    quick_fit(jobs[:2], tmp_path / "whole")
    assert looks[: len(LOOKS)] == list(LOOKS)

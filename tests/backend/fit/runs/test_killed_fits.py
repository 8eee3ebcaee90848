"""A fit that is stopped at any moment, its end included, and resumed writes what the undisturbed
fit writes.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from facestage.contract.events import Event
from facestage.contract.files.partial import partial_folder
from facestage.contract.job import Job
from facestage.contract.person import Person
from facestage.contract.result import STOPPED, Result
from facestage.fit.result.person import fit_person
from facestage.fit.result.run import fit_job
from facestage.fit.runs.member import Member
from reference.same_answer import differences
from reference.small_fit import QUICK, StopError
from reference.synthetic_case import Case, write_case
from reference.synthetic_scene import Scene
from reference.two_photos import another_photo

Fit = Callable[[Path, bool, Callable[[Event], None]], object]
DRAWING = "Drawing textures and pictures"

pytestmark = pytest.mark.usefixtures("renderer")


def noise(path: Path, side: int) -> Path:
    """A photo of nothing."""
    pixels = np.random.default_rng(side).integers(0, 255, (side, side, 3), np.uint8)
    Image.fromarray(pixels).save(path)
    return path


@pytest.fixture(scope="module")
def jobs(case: Case, scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> list[Job]:
    """Two photos of the person, and one with the second's landmarks that shows nothing."""
    folder = tmp_path_factory.mktemp("second")
    second = write_case(folder, another_photo(scene)).job(model=case.model_option)
    return [case.job(), second, replace(second, image=noise(folder / "noise.png", 80))]


def one(job: Job) -> Fit:
    return lambda out, resume, emit: fit_job(job, out, resume, emit, fineness=QUICK)


def together(jobs: Sequence[Job]) -> Fit:
    return lambda out, resume, emit: fit_person(jobs, out, resume, emit, fineness=QUICK)


def undisturbed(fit: Fit, out: Path, moment: str | None = None) -> list[str]:
    """The words of its events. ``again/out.partial`` beside ``out``'s folder is what a kill at the
    last event would leave whose words hold ``moment``.
    """
    heard: list[str] = []
    left = partial_folder(out.parent.parent / "again" / "out")

    def listen(event: Event) -> None:
        heard.append(event.message)
        if moment is not None and moment in event.message:
            shutil.rmtree(left, ignore_errors=True)
            shutil.copytree(partial_folder(out), left)

    fit(out, False, listen)
    return heard


def stopped(fit: Fit, out: Path, moment: str, resume: bool = False) -> None:
    """Stop at the last event whose words hold ``moment``; each has words of its own."""

    def stop(event: Event) -> None:
        if moment in event.message:
            raise StopError

    with pytest.raises(StopError):
        fit(out, resume, stop)


def assert_same_end(fit: Fit, out: Path, whole: Path) -> list[str]:
    """Resume; the words of its events."""
    heard: list[str] = []
    fit(out, True, lambda event: heard.append(event.message))
    assert differences(whole, out) == []
    assert [path.name for path in out.parent.iterdir()] == [out.name], "nothing is left behind"
    return heard


@pytest.fixture(scope="module")
def whole(jobs: list[Job], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """The first photo, undisturbed."""
    out = tmp_path_factory.mktemp("whole") / "out"
    return out, undisturbed(one(jobs[0]), out)


def last_step(heard: list[str]) -> str:
    return [words for words in heard if ", step " in words][-1]


@pytest.mark.parametrize("moment", ["geometry, step 2", "", DRAWING])
def test_one_photo(jobs: list[Job], whole: tuple[Path, list[str]], tmp_path: Path, moment: str):
    folder, heard = whole
    assert "Fitting: geometry, step 2" in heard
    stopped(one(jobs[0]), tmp_path / "out", moment or last_step(heard))
    assert [path.name for path in tmp_path.iterdir()] == ["out.partial"]
    assert_same_end(one(jobs[0]), tmp_path / "out", folder)


def test_one_photo_stopped_twice(jobs: list[Job], whole: tuple[Path, list[str]], tmp_path: Path):
    stopped(one(jobs[0]), tmp_path / "out", "geometry, step 1")
    stopped(one(jobs[0]), tmp_path / "out", DRAWING, resume=True)
    assert_same_end(one(jobs[0]), tmp_path / "out", whole[0])


def test_one_photo_stopped_before_its_first_step(
    jobs: list[Job], whole: tuple[Path, list[str]], tmp_path: Path
):
    stopped(one(jobs[0]), tmp_path / "out", "Face model")
    assert not list(tmp_path.iterdir())
    assert_same_end(one(jobs[0]), tmp_path / "out", whole[0])


def test_the_focal_length_is_fitted_to_the_last_bit(jobs: list[Job], tmp_path: Path):
    """A state of a phase has the phase's camera; there and back it would not be the same number."""
    fit = one(replace(jobs[0], camera=None))
    undisturbed(fit, tmp_path / "whole" / "out", "geometry, step 2")
    assert_same_end(fit, tmp_path / "again" / "out", tmp_path / "whole" / "out")


def test_a_photo_that_is_not_believed_is_not_believed_after_its_end_either(
    jobs: list[Job], tmp_path: Path
):
    fit = one(jobs[2])
    undisturbed(fit, tmp_path / "whole" / "out", DRAWING)
    assert Result.load(tmp_path / "whole" / "out").status == STOPPED
    assert_same_end(fit, tmp_path / "again" / "out", tmp_path / "whole" / "out")


def test_where_no_step_follows_the_checks_know_the_last_one(
    jobs: list[Job], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """The last phase takes no step, so that what is known is from the phase before."""
    from facestage.fit.stages.photo_descent import PhotoDescent

    run = PhotoDescent.run

    def none_in_the_end(self: PhotoDescent, *arguments, **options):
        return iter(()) if self.name == "joint" else run(self, *arguments, **options)

    monkeypatch.setattr(PhotoDescent, "run", none_in_the_end)
    fit = one(jobs[0])
    undisturbed(fit, tmp_path / "whole" / "out", DRAWING)
    assert Result.load(tmp_path / "whole" / "out").null_directions
    assert_same_end(fit, tmp_path / "again" / "out", tmp_path / "whole" / "out")


@pytest.fixture(scope="module")
def both(jobs: list[Job], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """The two photos, undisturbed."""
    out = tmp_path_factory.mktemp("both") / "out"
    return out, undisturbed(together(jobs[:2]), out)


@pytest.mark.parametrize("moment", ["together: geometry, step 2", ""])
def test_two_photos(jobs: list[Job], both: tuple[Path, list[str]], tmp_path: Path, moment: str):
    folder, heard = both
    stopped(together(jobs[:2]), tmp_path / "out", moment or last_step(heard))
    assert_same_end(together(jobs[:2]), tmp_path / "out", folder)


def test_a_photo_that_was_left_out(jobs: list[Job], tmp_path: Path):
    """The first photo with one that shows nothing."""
    fit, out = together(jobs[::2]), tmp_path / "whole" / "out"
    undisturbed(fit, out, "specular, step 1")
    assert [photo.shares_shape for photo in Person.load(out).photos] == [True, False]
    assert_same_end(fit, tmp_path / "again" / "out", out)


def test_a_photo_whose_last_step_was_before_the_checkpoint(
    jobs: list[Job], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """One that is left out and takes no step of its own: the fit begins anew to know it."""
    monkeypatch.setattr(Member, "follow", lambda *_: None)
    fit = together(jobs[::2])
    undisturbed(fit, tmp_path / "whole" / "out", "Painting")
    heard = assert_same_end(fit, tmp_path / "again" / "out", tmp_path / "whole" / "out")
    assert any("photo 1 of 2: pose, step 1" in words for words in heard)


def test_where_no_photo_is_believed(jobs: list[Job], tmp_path: Path):
    fit = together([replace(jobs[0], image=noise(tmp_path / "noise.png", 96)), jobs[2]])
    undisturbed(fit, tmp_path / "whole" / "out", "Painting")
    assert not any(photo.shares_shape for photo in Person.load(tmp_path / "whole" / "out").photos)
    assert_same_end(fit, tmp_path / "again" / "out", tmp_path / "whole" / "out")

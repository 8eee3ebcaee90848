"""Options of a fit of several photos: one per photo in their order, and sentences for what does not
fit.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from facestage import cli
from facestage.cli.jobs import read_jobs
from facestage.cli.parser import build_parser
from facestage.contract.errors import InputError
from reference.known import known
from reference.synthetic_case import Case


def parsed(*arguments: object):
    return build_parser().parse_args(["fit", *map(str, arguments), "--out", "o"])


@pytest.fixture
def photos(case: Case, tmp_path: Path) -> list[Path]:
    """The photo under three names."""
    paths = [tmp_path / f"{name}.png" for name in "abc"]
    for path in paths:
        path.write_bytes(case.photo.read_bytes())
    return paths


def landmark_files(case: Case, folder: Path, count: int) -> list[Path]:
    data, files = json.loads(case.landmarks.read_text()), []
    for number in range(count):
        data["points"][0][0] = 10.0 + number
        files.append(folder / f"landmarks{number}.json")
        files[-1].write_text(json.dumps(data))
    return files


def test_each_photo_has_its_own_landmarks_and_truth(case: Case, photos: list[Path], tmp_path: Path):
    options: list[object] = [*photos]
    for number, file in enumerate(landmark_files(case, tmp_path, 3)):
        options += ["--landmarks", file, "--truth", f"/truth{number}.npz"]
    jobs = read_jobs(parsed(*options, "--same-person", "--camera", case.camera, "--seed", 4))
    assert [job.image for job in jobs] == photos
    assert [known(job.landmarks).points[0, 0] for job in jobs] == [10.0, 11.0, 12.0]
    assert [job.truth for job in jobs] == [Path(f"/truth{number}.npz") for number in range(3)]
    assert all(
        job.camera == jobs[0].camera and job.camera is not None and job.seed == 4 for job in jobs
    )


def test_focal_lengths_are_for_each_photo_or_for_all(photos: list[Path]):
    each = read_jobs(parsed(*photos[:2], "--focal-px", 100, "--focal-px", 200))
    assert [known(job.camera).focal_px for job in each] == [100, 200]
    assert [
        known(job.camera).focal_px for job in read_jobs(parsed(*photos, "--focal-px", 100))
    ] == [100, 100, 100]
    assert [job.camera for job in read_jobs(parsed(*photos))] == [None, None, None]


def test_job_folders_may_be_several(photos: list[Path], tmp_path: Path):
    for job, name in zip(read_jobs(parsed(*photos[:2], "--seed", 3)), "xy", strict=True):
        job.save(tmp_path / name)
    jobs = read_jobs(
        parsed("--job", tmp_path / "x", tmp_path / "y", "--same-person", "--budget", "9")
    )
    assert [job.image.parent for job in jobs] == [tmp_path / "x", tmp_path / "y"]
    assert all(job.seed == 3 and job.budget_seconds == 9 for job in jobs)
    with pytest.raises(InputError, match="leave out seed"):
        read_jobs(parsed("--job", tmp_path / "x", tmp_path / "y", "--seed", "1"))


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (["--landmarks"], "1 landmark files were given for 3 photos"),
        (["--landmarks", "--landmarks"], "2 landmark files were given for 3 photos"),
        (["--truth", "--truth"], "2 truth files"),
        (["--camera", "--camera"], "2 camera files"),
    ],
)
def test_a_wrong_number_of_files_is_refused(
    case: Case, photos: list[Path], values: list[str], words: str
):
    arguments = [item for value in values for item in (value, case.landmarks)]
    with pytest.raises(InputError, match=words):
        read_jobs(parsed(*photos, *arguments, "--same-person"))


def test_several_photos_without_a_word_about_them_are_refused(
    photos: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert cli.main(["fit", *map(str, photos), "--out", str(tmp_path / "out")]) == 2
    assert "3 photos were given; add --same-person" in capsys.readouterr().err


def test_one_photo_is_not_several(
    photos: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert cli.main(["fit", str(photos[0]), "--same-person", "--out", str(tmp_path / "out")]) == 2
    assert "expected 2 to 8" in capsys.readouterr().err and not (tmp_path / "out").exists()

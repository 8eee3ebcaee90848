"""``facestage batch``: bad photos and dead workers never stop the rest."""

from __future__ import annotations

import csv
import shutil
import subprocess
from pathlib import Path

import numpy as np
import psutil
import pytest

from facestage.cli.batch import read_tasks
from facestage.cli.film_options import read_request
from facestage.cli.jobs import read_jobs
from facestage.cli.parser import build_parser
from facestage.contract.batch import FITS, JOURNAL, read_journal
from facestage.contract.events import Event
from facestage.contract.person import Person
from facestage.contract.result import Result
from facestage.images.image_io import write_png
from reference.command_line import PATIENCE, QUICK, events_of, listing, refuse, start, write
from reference.synthetic_case import Case

# What is left is fitted in two seconds.
FROZEN = ("identity", "expression", "lights")
HEAD = "photo,landmarks,camera,truth,name"


@pytest.fixture
def photos(case: Case, tmp_path: Path) -> Path:
    """A manifest of seven rows: three photos, one person of two, and three that are no use."""
    folder = tmp_path / "photos"
    folder.mkdir()
    beside = (case.landmarks, case.camera, case.truth)
    rows = []
    for name in "abc":
        shutil.copyfile(case.photo, folder / f"{name}.png")
        rows.append(",".join(map(str, (f"{name}.png", *beside, ""))))
    both = [f"{path};{path}" for path in beside]
    rows.append(",".join(("a.png;b.png", *both, "both")))
    write(folder / "cut.png", case.photo.read_bytes()[:900])
    noise = np.random.default_rng(0).integers(0, 255, (96, 96, 3), np.uint8)
    write_png(folder / "noise.png", noise)
    rows += [f"cut.png,{case.landmarks},,,", "noise.png,,,,", "gone.png,,,,"]
    return write(folder / "photos.csv", "\n".join([HEAD, *rows, ""]))


def batch(
    case: Case, photos: Path, out: Path, *more: str, workers: int = 2
) -> subprocess.Popen[str]:
    quick = ["--budget", "draft", "--texture-size", "512", "--freeze", *FROZEN]
    options = [*QUICK, *quick, "--workers", str(workers), *more]
    # Dask leaves sockets to the garbage.
    return start(
        "batch",
        photos,
        "--out",
        out,
        "--model",
        case.model_option,
        *options,
        warnings="ignore::ResourceWarning",
    )


def ended(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    try:
        out, err = process.communicate(timeout=PATIENCE)
    finally:
        process.kill()
    return process.returncode, out, err


def kill_a_worker(process: subprocess.Popen[str], among: int = 2) -> None:
    """Once the first row has ended, so that another is being fitted."""
    assert process.stdout is not None
    for line in process.stdout:
        event = Event.from_line(line)
        if event is not None and event.iteration >= 1:
            break
    children = psutil.Process(process.pid).children()
    workers = [child for child in children if "spawn_main" in " ".join(child.cmdline())]
    assert len(workers) == among
    workers[0].kill()


@pytest.mark.slow
def test_bad_photos_and_a_dead_worker_do_not_stop_the_rest(
    case: Case, photos: Path, tmp_path: Path
):
    out = tmp_path / "out"
    process = batch(case, photos, out)
    kill_a_worker(process)
    code, said, sentences = ended(process)
    assert code == 5, sentences
    assert events_of(said)[-1].message == "4 of 7 fitted, 3 not."
    told = sentences.splitlines()
    assert len(told) == 3, sentences
    for line, name, words in zip(
        told,
        ("cut", "noise", "gone"),
        ("not a readable image", "No face was found", "does not exist"),
        strict=True,
    ):
        assert line.startswith(f"facestage: {name} ({name}.png): ") and words in line
    for name in "abc":
        assert "similarity_mm" in Result.load(out / FITS / name).errors
    assert len(Person.load(out / FITS / "both").photos) == 2
    with (out / "summary.csv").open(encoding="utf-8", newline="") as stream:
        table = list(csv.DictReader(stream))
    assert [row["name"] for row in table] == [*"abc", "both", "cut", "noise", "gone"]
    assert [row["status"] == "failed" for row in table] == 4 * [False] + 3 * [True]
    assert all((out / row["picture"]).is_file() for row in table[:4])
    assert float(table[3]["similarity_mm"]) > 0 and float(table[3]["seconds"]) > 0
    page = (out / "report.html").read_text(encoding="utf-8")
    assert page.count("data:image/jpeg") == 3 * 2 + 1 and page.count('<tr class="failed">') == 3

    # Again: what is done is left, what failed is tried, and what has changed is fitted anew.
    before = {name: (out / FITS / name / "result.json").stat().st_mtime_ns for name in "abc"}
    shutil.copyfile(case.photo, photos.parent / "gone.png")
    (photos.parent / "c.png").touch()
    with (out / JOURNAL).open("a", encoding="utf-8") as journal:
        journal.write('{"number": 1, "na')  # as of a kill
    code, said, sentences = ended(batch(case, photos, out, "--resume"))
    assert code == 5 and len(sentences.splitlines()) == 3, sentences
    assert events_of(said)[0].message == "4 of 7 rows to fit"
    after = {name: (out / FITS / name / "result.json").stat().st_mtime_ns for name in "abc"}
    assert {name for name in after if after[name] != before[name]} == {"c"}
    assert not [path for path in listing(out) if path.name.startswith(".facestage")]


@pytest.mark.slow
def test_a_dead_worker_costs_the_row_that_it_fitted_and_none_that_waits(
    case: Case, photos: Path, tmp_path: Path
):
    head, *rows = photos.read_text().splitlines()
    write(photos, "\n".join([head, rows[-1], rows[0], rows[1], ""]))  # gone, a, b
    out = tmp_path / "out"
    process = batch(case, photos, out, "--retries", "0", workers=1)
    kill_a_worker(process, among=1)
    code, _, sentences = ended(process)
    assert code == 5 and len(sentences.splitlines()) == 2, sentences
    assert "a (a.png): The process that fitted it died, once in all" in sentences
    assert {row.name: row.failed for row in read_journal(out).values()} == {
        "gone": True,
        "a": True,
        "b": False,
    }


@pytest.mark.slow
def test_ctrl_c_keeps_what_is_done(case: Case, photos: Path, tmp_path: Path):
    head, *rows = photos.read_text().splitlines()
    write(photos, "\n".join([head, *rows[:3], ""]))
    out = tmp_path / "out"
    process = batch(case, photos, out)
    assert process.stdout is not None
    next(line for line in process.stdout if '"iteration": 1' in line)
    children = psutil.Process(process.pid).children(recursive=True)
    process.terminate()
    code, _, sentences = ended(process)
    assert code == 3 and "--resume goes on with the rest." in sentences, sentences
    done = read_journal(out)
    assert done and (out / "summary.csv").is_file()
    assert all((out / FITS / name / "result.json").is_file() for name in done)
    assert not psutil.wait_procs(children, timeout=20)[1], "a worker lives on"


def test_a_cell_takes_the_place_of_the_command_line(case: Case, photos: Path):
    write(
        photos,
        "photo,camera,focal_px,model,freeze,environment,seed\n"
        f"a.png,,300,,,,\n"
        f"a.png,{case.camera},,npz:m.npz,pose;focal,sky.exr@40,7\n"
        "a.png;b.png,,,,,,\n",
    )
    shared = ["--focal-px", "200", "--freeze", "albedo", "--model", "default", "--seed", "1"]
    options = build_parser().parse_args(["batch", str(photos), "--out", "o", *shared])
    first, second, third = read_tasks(options)
    (job,) = read_jobs(first.options)
    assert job.camera is not None and job.camera.focal_px == 300
    assert job.freeze == ("albedo",) and job.seed == 1 and job.model == "default"
    assert job.image == photos.parent / "a.png"
    said = second.options
    assert said.camera == [case.camera] and said.focal_px is None
    assert said.freeze == ["pose", "focal"] and said.seed == 7
    assert said.model == f"npz:{photos.parent / 'm.npz'}"
    assert said.environment == f"{photos.parent / 'sky.exr'}@40"
    assert [job.image.name for job in read_jobs(third.options)] == ["a.png", "b.png"]
    assert len({first.asked, second.asked, third.asked}) == 3
    assert first.asked == read_tasks(options)[0].asked


def test_a_film_is_asked_for_as_track_asks(case: Case, photos: Path):
    write(
        photos,
        "photo,film,camera,rate,texture_size\n"
        "a.png,,,,512\n"
        f",takes/one,{case.camera},25,\n"
        ",two.mov,,,\n",
    )
    more = ["--focal-px", "200", "--freeze", "albedo", "--vertices", "--chunk", "99"]
    more += ["--lights", "7"]
    options = build_parser().parse_args(["batch", str(photos), "--out", "o", *more])
    photo, first, second = read_tasks(options)
    assert [photo.film, first.film, second.film] == [False, True, True]
    (job,) = read_jobs(photo.options)
    assert job.stage is not None and len(job.stage) == 7 and job.texture_size == 512
    assert not {"chunk", "rate", "vertices"} & vars(photo.options).keys()
    request = read_request(first.options)
    assert request.film == photos.parent / "takes" / "one" and request.rate == 25
    assert request.camera is not None and request.focal_px is None
    request = read_request(second.options)
    assert request.focal_px == 200 and request.camera is None and request.rate is None
    assert request.with_vertices and request.freeze == ("albedo",) and request.quality == "good"
    assert second.options.chunk == 99


def test_an_option_that_no_row_hears_is_refused(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    out = tmp_path / "out"
    for file, option, words in (
        (case.photo, ["--rate", "25"], "--rate is of films, and there are photos alone"),
        (tmp_path / "take.mp4", ["--lights", "9"], "--lights is of photos, and there are films"),
        (case.photo, ["--chunk", "3"], "--chunk is 3; expected 24 to"),
        (
            tmp_path / "take.mp4",
            ["--focal-px", "200", "--focal-px", "300"],
            "there are 2 values of 'focal_px', of one film; leave all but one out",
        ),
    ):
        assert words in refuse(capsys, "batch", file, "--out", out, *option)
    assert not out.exists()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("film,lights\na.mp4,5\n", "'lights' is of a photo, and the row is a film"),
        ("photo,rate\na.png,5\n", "'rate' is of a film, and the row is a photo"),
        ("film,camera\na.mp4,a.json;b.json\n", "there are 2 values of 'camera', of one film"),
        ("film,vertices\na.mp4,yes\n", "has a column 'vertices'"),
        ("photo,focal_px\na.png,\na.png,long\n", "Line 3 of the manifest"),
        ("photo,out\na.png,x\n", "has a column 'out'"),
        ("photo,surround\na.png,maybe\n", "invalid choice: 'maybe'"),
    ],
)
def test_a_bad_manifest_is_refused_before_anything_is_written(
    photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, words: str
):
    write(photos, text)
    before = listing(tmp_path)
    assert words in refuse(capsys, "batch", photos, "--out", tmp_path / "out")
    assert listing(tmp_path) == before


def test_the_output_may_not_be_somebody_elses(
    photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / "out").mkdir()
    write(tmp_path / "out" / "mine.txt", "mine")
    sentence = refuse(capsys, "batch", photos, "--out", tmp_path / "out")
    assert "holds files that are not a batch" in sentence
    assert listing(tmp_path / "out") == [tmp_path / "out" / "mine.txt"]
    sentence = refuse(capsys, "batch", photos, photos.parent, "--out", tmp_path / "new")
    assert "was given beside other files" in sentence

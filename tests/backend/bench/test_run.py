"""A whole bench on a tiny case: what it prints and writes, which cases it takes, what it
refuses.
"""

from __future__ import annotations

import csv
import io
import shutil
from pathlib import Path

import pytest

from facestage import cli
from facestage.bench.cases import Case, find_cases, synthetic_case
from facestage.bench.run import run_bench
from facestage.bench.settings import Lineup, SolverSettings
from facestage.contract.errors import InputError
from facestage.contract.files.storage import read_arrays
from reference.tiny_bench import SHORT, TINY

TRACE_COLUMNS = [
    "case",
    "family",
    "contender",
    "seconds",
    "stage",
    "psnr",
    "similarity_mm",
    "rigid_mm",
]


def read(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


@pytest.mark.slow
def test_a_bench_measures_every_contender_alike(case: Case, tmp_path: Path):
    sweep = (SolverSettings("budget 0.1 s", resolution=0.4, budget=0.1),)
    lineup = Lineup(TINY, (), sweep, warm_up=False)
    stream = io.StringIO()
    out = tmp_path / "out"
    assert (
        run_bench(
            [case.folder],
            case.model,
            out,
            False,
            stream,
            device="cpu",
            lineup=lineup,
            fineness=SHORT,
        )
        == 0
    )
    rows = read(out / "trace.csv")
    assert list(rows[0]) == TRACE_COLUMNS
    assert {row["contender"] for row in rows} == {"Facestage", "Adam", "Harmonics", "budget 0.1 s"}
    for name in ("Facestage", "Adam", "Harmonics"):
        seconds = [float(row["seconds"]) for row in rows if row["contender"] == name]
        assert seconds == sorted(seconds)
    # All start from the same landmark stage.
    starts = {
        [
            row["similarity_mm"]
            for row in rows
            if (row["contender"], row["stage"]) == (name, "landmarks")
        ][-1]
        for name in ("Facestage", "Adam", "Harmonics")
    }
    assert len(starts) == 1
    finals = read(out / "final.csv")
    assert [row["contender"] for row in finals] == [
        "Facestage",
        "Adam",
        "Harmonics",
        "budget 0.1 s",
    ]
    assert finals[0]["detail_psnr"] and not finals[2]["detail_psnr"]
    assert "ratio" in read(out / "reach.csv")[0]
    page = (out / "bench.html").read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == 2 and "http" not in page
    assert {path.name for path in out.glob("*.png")} == {
        f"curves_{case.folder.name}.png",
        f"settings_{case.folder.name}.png",
    }
    text = stream.getvalue()
    assert (out / "bench.txt").read_text(encoding="utf-8") in text
    assert "Facestage s" in text and "Adam s" in text


def test_given_cases_are_taken_with_the_given_model(case: Case, tmp_path: Path):
    cases, sentence = find_cases([case.folder], case.model, tmp_path)
    assert cases == [Case(case.folder.name, case.folder, case.model)]
    assert case.model in sentence


def test_cases_of_the_data_folder(case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    for name in ("b", "a"):
        shutil.copytree(case.folder, tmp_path / "cases" / name)
    monkeypatch.setenv("FACESTAGE_DATA", str(tmp_path))
    cases, sentence = find_cases([], case.model, tmp_path / "scratch")
    assert [item.name for item in cases] == ["a", "b"]
    assert "data folder" in sentence


def test_without_any_case_the_photo_is_synthetic_and_the_bench_says_so(
    case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("FACESTAGE_DATA", str(tmp_path / "nowhere"))
    cases, sentence = find_cases([], case.model, tmp_path, side_px=64)
    assert [item.name for item in cases] == ["synthetic"]
    assert "synthetic" in sentence and "own forward model" in sentence
    assert cases[0].job().truth == tmp_path / "synthetic" / "truth.npz"


def test_a_synthetic_case_is_complete(case: Case, tmp_path: Path):
    made = synthetic_case(tmp_path / "made", case.model, side_px=64)
    job = made.job("cpu")
    assert job.camera is not None and job.camera.width == 64 and job.landmarks is not None
    assert read_arrays(tmp_path / "made" / "truth.npz", "truth file")["vertices"].shape[1] == 3


@pytest.mark.parametrize("missing", ["photo.png", "landmarks.json", "camera.json", "truth.npz"])
def test_a_case_that_lacks_a_file_is_refused(case: Case, tmp_path: Path, missing: str):
    folder = tmp_path / "broken"
    shutil.copytree(case.folder, folder)
    (folder / missing).unlink()
    with pytest.raises(InputError, match=missing):
        Case("broken", folder, case.model).job()


def test_command_line_refuses_in_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    taken = tmp_path / "file"
    taken.touch()
    assert cli.main(["bench", "--case", str(tmp_path), "--out", str(taken)]) == 2
    assert "is a file" in capsys.readouterr().err
    assert (
        cli.main(
            ["bench", "--case", str(tmp_path), "--out", str(tmp_path / "out"), "--device", "cpu"]
        )
        == 2
    )
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "photo.png" in error


def test_help_teaches(capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit):
        cli.main(["bench", "--help"])
    text = capsys.readouterr().out
    assert "--quick" in text and "Example" in text and "truth.npz" in text

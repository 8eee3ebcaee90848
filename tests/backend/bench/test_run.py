"""A whole bench on a tiny case: what it prints and writes, which cases it takes, what it
refuses.
"""

from __future__ import annotations

import csv
import io
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from facestage import cli
from facestage.bench.cases import Case, find_cases, synthetic_case
from facestage.bench.run import open_case, run_bench, run_contender
from facestage.bench.settings import Lineup, SolverSettings
from facestage.bench.summary import summary_lines
from facestage.bench.table import final
from facestage.contract.errors import InputError
from facestage.contract.files.storage import read_arrays
from facestage.contract.scan import Scan
from reference.known import known
from reference.synthetic_scene import Scene
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
    assert page.count("data:image/png;base64,") == 2 and "://" not in page
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


def scanned(case: Case, scene: Scene, folder: Path) -> Path:
    """The case with its own head for a scan: photo, camera and landmarks, no truth.npz."""
    shutil.copytree(case.folder, folder)
    (folder / "truth.npz").unlink()
    narrow = scene.model.regions["narrow_face"]
    vertices = 1e3 * scene.forward.pose(scene.state)[1]
    Scan(vertices, scene.geometry.triangles, scene.geometry.new_index[narrow]).save(
        folder / "scan.npz"
    )
    return folder


def test_a_scan_is_a_truth_too(case: Case, scene: Scene, tmp_path: Path):
    folder = scanned(case, scene, tmp_path / "scanned")
    problem, truth, judge = open_case(
        Case("scanned", folder, case.model), "cpu", fineness=replace(SHORT, steps_max=1)
    )
    track = run_contender(problem, truth, TINY[0])
    rows = judge.rows("scanned", "ours", "Facestage", track)
    found = final(rows, track.errors)
    # The judge looks at the scan's face: nothing of the photo's background is in it.
    assert 0.1 < judge.mask.mean() < 0.5 and known(found.psnr) > 15
    start = truth.geometry_errors(track.snapshots[-1].state)
    assert rows[-1].similarity_mm == pytest.approx(start["similarity_mm"])
    assert 0 < known(found.start_mm) < 2 and 0 < known(found.covered_mm) < 2
    assert 0 <= known(found.within_1) <= known(found.within_2) <= 1
    assert "Scan scanned: the points that the mesh covers" in "\n".join(summary_lines([found]))


def test_the_face_of_a_scan_is_found_where_it_has_no_landmarks(
    case: Case, scene: Scene, tmp_path: Path
):
    folder, region = scanned(case, scene, tmp_path / "scanned"), tmp_path / "face.npy"
    (folder / "landmarks.json").unlink()
    cases, _ = find_cases([folder], case.model, tmp_path, face_region=region)
    job = cases[0].job("cpu")
    assert job.landmarks is None and job.truth == folder / "scan.npz"
    assert job.face_region == region and job.camera is not None
    (folder / "camera.json").unlink()
    with pytest.raises(InputError, match=r"has no camera\.json.*scan\.npz"):
        cases[0].job("cpu")


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
    assert cli.main(["bench", "--face-region", "f.npy", "--out", str(tmp_path / "out")]) == 2
    assert "give the cases with --case" in capsys.readouterr().err


def test_help_teaches(capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit):
        cli.main(["bench", "--help"])
    text = capsys.readouterr().out
    assert "--quick" in text and "Example" in text and "truth.npz" in text and "scan.npz" in text

"""``facestage detect``, and a fit that finds its landmarks itself."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from facestage import cli
from facestage.contract.errors import InputError
from facestage.contract.events import Event
from facestage.contract.job import Job
from facestage.contract.landmarks import Landmarks
from facestage.fit.given.detection import known_to
from facestage.fit.given.problem import read_problem
from facestage.landmarks.finder import Face
from facestage.landmarks.ibug68 import to_ibug68
from facestage.landmarks.model_file import Bundle
from reference.command_line import listing, refuse
from reference.synthetic_face import synthetic_face


@pytest.fixture(scope="session")
def group(bundle: Bundle, astronaut: np.ndarray, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A photo of the astronaut and, on the left, a face of two thirds her size."""
    import cv2
    from PIL import Image

    small = cv2.resize(
        astronaut[:300, 100:350], None, fx=0.66, fy=0.66, interpolation=cv2.INTER_AREA
    )
    photo = np.full((320, 420, 3), 60, np.uint8)
    photo[20 : 20 + len(small), : small.shape[1]] = small
    photo[:, 180:] = astronaut[:320, 100:340]
    path = tmp_path_factory.mktemp("group") / "group.png"
    Image.fromarray(photo).save(path)
    return path


def detect(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> dict[str, Any]:
    """The summary on stdout of a command that succeeds."""
    assert cli.main(["detect", *map(str, arguments)]) == 0
    return dict(json.loads(capsys.readouterr().out))


def test_the_file_can_be_given_to_a_fit(
    group: Path, found: Face, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    summary = detect(capsys, group, "--out", tmp_path / "points.json")
    landmarks = Landmarks.read(tmp_path / "points.json")
    landmarks.check_inside(420, 320)
    assert landmarks.scheme == "mediapipe478" and summary["visible"] == landmarks.visible.sum()
    assert summary["face"] == 1 and summary["faces"] == 2 and summary["confidence"] > 0.8
    # The larger face is the astronaut at her own size.
    np.testing.assert_allclose(landmarks.points, found.mesh.points[:, :2] + [80, 0], atol=1.5)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["points.json"]


def test_another_face_all_faces_and_the_picture(
    group: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    from PIL import Image

    first = detect(capsys, group, "--out", tmp_path / "1.json")
    second = detect(
        capsys,
        group,
        "--out",
        tmp_path / "2.json",
        "--face",
        "2",
        "--all",
        "--picture",
        tmp_path / "2.png",
    )
    assert (
        second["face"] == 2
        and second["size_px"] < 0.8 * first["size_px"]
        and second["box"][2] < 180
    )
    data = json.loads((tmp_path / "2.json").read_text())
    assert [face["face"] for face in data["faces"]] == [1, 2]
    assert (
        data["points"] == data["faces"][1]["points"]
        and data["visible"] == data["faces"][1]["visible"]
    )
    assert "points" not in json.loads((tmp_path / "1.json").read_text())["faces"][1]
    np.testing.assert_allclose(
        data["faces"][0]["points"], Landmarks.read(tmp_path / "1.json").points
    )

    with Image.open(tmp_path / "2.png") as image:
        drawn = np.asarray(image.convert("RGB")).astype(int)
    assert drawn.shape == (780, 1024, 3), "a small photo is enlarged"
    # Where points are seen the picture is green, and nowhere on the other face.
    green = (drawn[..., 1] > 180) & (drawn[..., 0] < 130) & (drawn[..., 2] < 160)
    x, y = np.nonzero(green)[1].mean() / 1024 * 420, np.nonzero(green)[0].mean() / 1024 * 420
    centre = Landmarks.read(tmp_path / "2.json").points.mean(axis=0)
    np.testing.assert_allclose([x, y], centre, atol=6)


@pytest.mark.usefixtures("bundle")
def test_refusals_write_nothing(group: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    from PIL import Image

    out = tmp_path / "out"
    out.mkdir()
    Image.new("RGB", (64, 48), (90, 120, 90)).save(tmp_path / "green.png")
    for arguments, words in (
        ((tmp_path / "green.png",), ("No face", "--landmarks")),
        ((group, "--face", "3"), ("Face 3", "2 faces", "--face 1 to 2")),
        ((group, "--face", "0"), ("Face 0", "2 faces")),
        ((group, "--picture", out / "p.jpg"), ("p.jpg", ".png")),
        ((group, "--landmark-model", group), ("group.png", "not the expected file")),
    ):
        sentence = refuse(
            capsys, "detect", arguments[0], "--out", out / "points.json", *arguments[1:]
        )
        assert all(word in sentence for word in words), sentence
    assert listing(out) == []


def test_a_job_without_landmarks_gets_those_of_the_face_it_names(group: Path, tmp_path: Path):
    model = tmp_path / "model.npz"
    synthetic_face().save(model)
    job = Job(image=group, model=f"npz:{model}", face=2)
    events: list[Event] = []
    problem = read_problem(job, events.append)
    assert [event.stage for event in events] == ["detection"] and "Face 2 of 2" in events[0].message
    used = problem.job.landmarks
    assert used is not None and used.scheme == "mediapipe478" and used.points[:, 0].max() < 180
    # This model knows ibug68 only.
    assert problem.landmarks.scheme == "ibug68"
    np.testing.assert_array_equal(problem.landmarks.points, to_ibug68(used).points)
    again = read_problem(replace(problem.job, face=None), events.append)
    assert len(events) == 1 and again.fingerprint == problem.fingerprint, (
        "the job can be repeated as it was"
    )
    with pytest.raises(InputError, match="Face 3 was asked for but 2 faces"):
        read_problem(replace(job, face=3))


def test_landmarks_that_the_model_knows_are_taken_as_they_are():
    model = synthetic_face()
    points = Landmarks(
        "mediapipe478", np.random.default_rng(0).uniform(0, 9, (478, 2)), np.ones(478, bool)
    )
    first_corners = np.tile([0, 0, 0, 1, 0, 0], (478, 1))
    knows_both = replace(model, landmarks=dict(model.landmarks) | {"mediapipe478": first_corners})
    assert known_to(knows_both, points) is points
    assert known_to(replace(model, landmarks={}), points) is points
    assert known_to(model, to_ibug68(points)).scheme == "ibug68"

"""What photographs show of a scan: a ball with a wall before its lower half."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import trimesh

from facestage.contract.errors import InputError
from facestage.contract.scan import Scan, read_region
from facestage.render.variant import start_renderer


@pytest.fixture
def script(tools: None) -> ModuleType:
    """The module tools/seen_by_photos.py."""
    import seen_by_photos

    start_renderer("cpu")

    return seen_by_photos


def write_case(folder: Path, wall: float) -> Scan:
    """A ball of 100 mm, 1 m from the camera, with a wall before what lies below a height of
    ``wall`` mm; the ball is the face.
    """
    ball = trimesh.creation.icosphere(subdivisions=3, radius=100.0)
    corners = np.array([[-500, -500, 300], [500, -500, 300], [500, wall, 300], [-500, wall, 300]])
    vertices = np.concatenate([ball.vertices, corners])
    vertices[:, 2] -= 1000
    triangles = np.concatenate([ball.faces, len(ball.vertices) + np.array([[0, 1, 2], [0, 2, 3]])])
    scan = Scan(vertices, triangles, np.arange(len(ball.vertices)))
    folder.mkdir()
    scan.save(folder / "scan.npz")
    return scan


def test_a_vertex_is_seen_that_nothing_hides(script: ModuleType, tmp_path: Path):
    scan = write_case(tmp_path / "a", wall=0.0)
    found = np.zeros(len(scan.face), bool)
    found[script.seen_region([tmp_path / "a"], None)] = True
    _x, y, z = scan.vertices[scan.face].T
    # The ball hides what lies behind its horizon, as of the camera: 100 / 1000 towards it.
    towards = z + 1000 > 10
    assert found[towards & (y > 5)].all()
    # A ray may pass between two triangles.
    assert found[(y < -5) | (z + 1000 < -10)].mean() < 0.01


def test_of_several_photos_one_is_enough(
    script: ModuleType,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    for name, wall in (("a", 0.0), ("b", -500.0)):
        write_case(tmp_path / name, wall)
    alone, both = (
        script.seen_region([tmp_path / name for name in names], None) for names in ("a", "ab")
    )
    assert set(alone) < set(both)
    out = tmp_path / "seen.npy"
    words = ["seen_by_photos", str(tmp_path / "a"), str(tmp_path / "b"), "--out", str(out)]
    monkeypatch.setattr(sys, "argv", words)
    script.main()
    np.testing.assert_array_equal(read_region(out, 10_000), both)
    assert f"{len(both)} of 642" in capsys.readouterr().out


def test_another_scan_is_refused_in_one_sentence(
    script: ModuleType,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    write_case(tmp_path / "a", 0.0)
    scan = Scan.load(tmp_path / "a" / "scan.npz")
    (tmp_path / "b").mkdir()
    Scan(scan.vertices, scan.triangles, scan.face[::2]).save(tmp_path / "b" / "scan.npz")
    words = [
        "seen_by_photos",
        str(tmp_path / "a"),
        str(tmp_path / "b"),
        "--out",
        str(tmp_path / "x"),
    ]
    monkeypatch.setattr(sys, "argv", words)
    with pytest.raises(SystemExit) as ended:
        script.main()
    said = capsys.readouterr().err.strip()
    assert ended.value.code == InputError.exit_code and said.count("\n") == 0
    assert "another face" in said and not (tmp_path / "x").exists()

"""Scans: round trip, the ways to say which vertices are the face, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.scan import Scan


def grid(side: int = 20, spacing: float = 8.0) -> Scan:
    """A flat sheet of ``side`` x ``side`` points, 90 cm before the camera; half of it is face."""
    row, column = np.mgrid[:side, :side]
    points = np.stack([spacing * column, spacing * row, np.full(row.shape, -900.0)], axis=-1)
    a = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    triangles = np.concatenate(
        [np.stack([a, a + 1, a + side], 1), np.stack([a + 1, a + side + 1, a + side], 1)]
    )
    return Scan(points.reshape(-1, 3), triangles, np.arange(side * side // 2))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A scan that does not say where its face is."""
    scan, path = grid(), tmp_path / "scan.npz"
    np.savez(path, vertices=scan.vertices, triangles=scan.triangles)
    return path


def test_a_scan_comes_back_as_it_was(tmp_path: Path):
    scan = grid()
    scan.save(tmp_path / "scan.npz")
    loaded = Scan.load(tmp_path / "scan.npz")
    np.testing.assert_allclose(loaded.vertices, scan.vertices, atol=1e-4)
    np.testing.assert_array_equal(loaded.triangles, scan.triangles)
    np.testing.assert_array_equal(loaded.face, scan.face)


@pytest.mark.parametrize("flags", [False, True])
def test_the_face_stands_in_a_file_of_its_own(path: Path, tmp_path: Path, flags: bool):
    numbers = np.arange(50, 250)[::-1]
    np.save(tmp_path / "mine.npy", np.isin(np.arange(400), numbers) if flags else numbers)
    np.testing.assert_array_equal(Scan.load(path, tmp_path / "mine.npy").face, np.arange(50, 250))


def test_the_face_may_lie_beside_the_scan_but_what_is_given_counts(path: Path, tmp_path: Path):
    np.save(tmp_path / "face_region.npy", np.arange(120))
    assert len(Scan.load(path).face) == 120
    np.save(tmp_path / "mine.npy", np.arange(130))
    assert len(Scan.load(path, tmp_path / "mine.npy").face) == 130
    scan = grid()
    np.savez(path, vertices=scan.vertices, triangles=scan.triangles, face=np.arange(140))
    assert len(Scan.load(path).face) == 140


def test_a_scan_without_a_face_is_refused(path: Path):
    with pytest.raises(InputError, match=r"which of its vertices are the face.*--face-region"):
        Scan.load(path)


@pytest.mark.parametrize(
    ("region", "words"),
    [
        (np.arange(400.0), "float64 values, expected the numbers"),
        (np.ones(399, bool), "true and false for each of 400"),
        (np.arange(300, 401), "names vertex 400 of a scan of 400"),
        (np.arange(-3, 200), "names vertex -3"),
        (np.arange(99), "names 99 vertices"),
        (np.zeros((200, 2), int), r"shape \(200, 2\)"),
    ],
)
def test_a_region_that_is_none_is_refused(
    path: Path, tmp_path: Path, region: np.ndarray, words: str
):
    np.save(tmp_path / "mine.npy", region)
    with pytest.raises(InputError, match=words):
        Scan.load(path, tmp_path / "mine.npy")


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (0.001, "face of 0.152 millimetres"),
        (0.1, "face of 15.2 millimetres"),
        (10.0, "face of 1.52e\\+03 millimetres"),
    ],
)
def test_other_units_are_refused(tmp_path: Path, factor: float, words: str):
    scan = grid()
    Scan(factor * scan.vertices, scan.triangles, scan.face).save(tmp_path / "scan.npz")
    with pytest.raises(InputError, match=words):
        Scan.load(tmp_path / "scan.npz")


def test_a_scan_behind_the_camera_or_with_foreign_triangles_is_refused(tmp_path: Path):
    scan, path = grid(), tmp_path / "scan.npz"
    Scan(scan.vertices * [1, 1, -1], scan.triangles, scan.face).save(path)
    with pytest.raises(InputError, match="behind the camera"):
        Scan.load(path)
    Scan(scan.vertices, scan.triangles + 1, scan.face).save(path)
    with pytest.raises(InputError, match="triangle at vertex 400, but 400 vertices"):
        Scan.load(path)
    np.savez(path, vertices=scan.vertices[:, :2], triangles=scan.triangles)
    with pytest.raises(InputError, match=r"vertices has shape \(400, 2\)"):
        Scan.load(path)

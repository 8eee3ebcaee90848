"""What is measured of a relief, on surfaces whose relief is known."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from PIL import Image

SPACING, SIDE = 0.5, 120  # mm between pixels, and pixels


@pytest.fixture
def score(tools: None) -> ModuleType:
    """The module tools/score_relief.py."""
    import score_relief

    return score_relief


def plane() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Columns, rows and points (p, 3) in mm of pixels that look at a slanted plane."""
    row, column = (each.ravel() for each in np.mgrid[:SIDE, :SIDE])
    points = SPACING * np.stack([column, -row, 0.4 * column], axis=1).astype(float)
    return column, row, points


def wave(points: np.ndarray, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Heights (p,) of a wave down the plane, 0.1 mm, and the normals (p, 3) that it makes."""
    way = 2 * np.pi * points[:, 1] / length
    base = np.array([-0.4, 0.0, 1.0]) / np.hypot(1, 0.4)
    slope = 0.1 * 2 * np.pi / length * np.cos(way)
    normals = base - slope[:, None] * np.array([0.0, 1.0, 0.0])
    return 0.1 * np.sin(way), normals / np.linalg.norm(normals, axis=1, keepdims=True)


def test_heights_come_back_from_their_normals(score: ModuleType):
    column, row, points = plane()
    height, normals = wave(points, 6.0)
    lattice = score.Lattice(column, row, points)
    base = np.broadcast_to(np.array([-0.4, 0.0, 1.0]) / np.hypot(1, 0.4), points.shape)
    found = lattice.height(base, normals)
    error = np.abs(found - found.mean() - height + height.mean()).max()
    print(f"off by {error:.4f} mm, 0.01 allowed")
    assert error < 0.01
    slope = np.tan(np.arccos(np.clip((base * normals).sum(axis=1), -1, 1)))
    assert slope.max() == pytest.approx(0.1 * 2 * np.pi / 6, rel=1e-3)
    assert score.degrees(base, normals) == pytest.approx(np.degrees(np.arctan(slope)).mean())


def test_the_band_holds_its_own_waves(score: ModuleType):
    column, row, points = plane()
    lattice = score.Lattice(column, row, points)
    left = {
        length: lattice.band(wave(points, length)[0], 1.0, 5.0).std()
        / wave(points, length)[0].std()
        for length in (3.0, 30.0)
    }
    assert left[3.0] > 0.6 and left[30.0] < 0.1


def test_equal_heights_correlate_and_others_do_not(score: ModuleType):
    random = np.random.default_rng(0)
    column, row, points = plane()
    height, normals = wave(points, 3.0)
    base = np.broadcast_to(np.array([-0.4, 0.0, 1.0]) / np.hypot(1, 0.4), points.shape)

    def seen(heights: np.ndarray) -> dict[str, float]:
        found = score.Found(column, row, points, base, normals, base, normals, heights)
        result: dict[str, float] = score.scores(found, (1.0, 5.0))
        return result

    right, wrong = seen(height), seen(random.normal(size=len(height)))
    assert right["correlation"] > 0.99 and abs(wrong["correlation"]) < 0.1
    assert right["normal_degrees"] < 1e-3 < right["mesh_normal_degrees"]
    assert right["true_relief_degrees"] < 1e-3
    assert right["found_mm"] == pytest.approx(right["true_mm"], rel=0.15)


def test_a_normal_map_bends_the_normals_of_its_triangles(score: ModuleType, tmp_path: Path):
    """A square of 2 cm, whose u runs along y and whose v against x."""
    (tmp_path / "square.obj").write_text(
        "v 0 0 0\nv 2 0 0\nv 2 2 0\nv 0 2 0\nvt 0 1\nvt 0 0\nvt 1 0\nvt 1 1\nf 1/1 2/2 3/3 4/4\n"
    )
    red = np.full((4, 4, 3), (255 * np.array([0.8, 0.5, 0.9])).round(), np.uint8)
    Image.fromarray(red).save(tmp_path / "normal.png")
    mapped, count = score.read_mapped(tmp_path / "square.obj", tmp_path / "normal.png")
    vertices = np.array([[0.0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]])
    assert count == 4 and len(mapped.triangles) == 2
    weights = np.full((2, 3), 1 / 3)
    normals = mapped.normals(vertices, np.array([0, 1]), weights, 1.0)
    wanted = np.array([0.0, 0.6, 0.8]) / np.hypot(0.6, 0.8)
    np.testing.assert_allclose(normals, [wanted, wanted], atol=0.01)
    half = mapped.normals(vertices, np.array([0, 1]), weights, 0.5)
    assert 0 < half[0, 1] < normals[0, 1]


def test_causes_of_a_photo_s_detail_are_told_apart(score: ModuleType):
    random = np.random.default_rng(1)
    color, shade, rest = random.normal(size=(3, 20_000)) * np.array([[0.03], [0.02], [0.02]])
    row = score.explained(0.9 * color + 0.5 * shade + rest, color, shade)
    variances = np.array([0.9 * 0.03, 0.5 * 0.02, 0.02]) ** 2
    assert row["by_color"] == pytest.approx(variances[0] / variances.sum(), abs=0.05)
    assert row["by_relief"] == pytest.approx(variances[1] / variances.sum(), abs=0.05)
    assert row["relief_gain"] == pytest.approx(0.5, abs=0.05)
    wanted = np.sqrt(variances[1] / variances[1:].sum())
    assert row["relief_correlation"] == pytest.approx(wanted, abs=0.05)

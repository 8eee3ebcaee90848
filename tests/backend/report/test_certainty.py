"""The picture of the vertices' standard deviations, and what the page says of certainty."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from backend.report.example import report_data, result, stage
from facestage.contract.certainty import DEVIATION
from facestage.contract.result import Result
from facestage.report import ReportData, write_report
from facestage.report.certainty import CERTAINTY, MARGIN, PANEL, draw_certainty
from facestage.report.tables import certainty_rows
from reference.rendering.meshes import sphere


def ball(deviation: np.ndarray) -> ReportData:
    """A ball 80 cm away whose vertices have ``deviation`` (n, 3)."""
    mesh = sphere()
    vertices = np.float32(mesh.vertices - np.array([0, 0, 0.8]))
    found = result(
        stage(),
        vertices=vertices,
        triangles=mesh.triangles.astype(np.int32),
        arrays={DEVIATION: deviation},
    )
    return report_data(result=found)


def middle(path: Path, panel: int) -> np.ndarray:
    """Mean color of the centre of a panel."""
    pixels = np.asarray(Image.open(path).convert("RGB")).astype(float)
    left, top = MARGIN + panel * (PANEL + 14) + PANEL // 2, 44 + PANEL // 2
    return pixels[top - 15 : top + 15, left - 15 : left + 15].mean(axis=(0, 1))


def test_depth_shows_from_the_side_and_alone(tmp_path: Path) -> None:
    count = len(sphere().vertices)
    deviation = np.zeros((count, 3), np.float32)
    deviation[:, 0] = 1.0
    path = tmp_path / CERTAINTY
    draw_certainty(path, ball(deviation))
    total, side, depth = (middle(path, panel) for panel in range(3))
    # Viridis: yellow at the limit, dark violet at 0.
    assert total[0] > 200 and total[1] > 180 and total[2] < 90
    np.testing.assert_allclose(side, total, atol=25)
    assert depth.max() < 110 and depth[2] > depth[1]


def test_nearer_polygons_cover_farther_ones(tmp_path: Path) -> None:
    deviation = np.zeros((len(sphere().vertices), 3), np.float32)
    deviation[sphere().vertices[:, 2] > 0, 1] = 1.0
    path = tmp_path / CERTAINTY
    draw_certainty(path, ball(deviation))
    assert middle(path, 0)[0] > 200, "the half that faces the camera"


def test_what_is_not_finite_is_drawn_all_the_same(tmp_path: Path) -> None:
    deviation = np.full((len(sphere().vertices), 3), np.inf, np.float32)
    draw_certainty(tmp_path / CERTAINTY, ball(deviation))
    assert (tmp_path / CERTAINTY).is_file()


def certain(**changes: Any) -> Result:
    arrays = {
        "deviation/identity": np.array([0.2, 0.9, 1.0]),
        "deviation_before/identity": np.ones(3),
        "deviation/expression": np.array([0.0, 0.1]),
        "deviation_before/expression": np.full(2, 0.35),
    }
    return result(stage(), arrays=arrays, unobserved={"identity": ["chin"]}, **changes)


def test_the_table_holds_what_is_observed_least_certain_first() -> None:
    rows = certainty_rows(certain())
    assert [(row.name, row.kind) for row in rows] == [
        ("nose", "identity"),
        ("smile", "expression"),
        ("width", "identity"),
    ]
    np.testing.assert_allclose([row.left for row in rows], [0.9, 0.1 / 0.35, 0.2])
    assert certainty_rows(result(stage())) == []


def test_the_page_names_what_is_open(tmp_path: Path) -> None:
    found = certain(
        null_directions={
            "count": 7,
            "of": 90,
            "by_block": {"lights": 6.2},
            "sentences": ["head <size> & distance"],
        }
    )
    deviation = np.full((3, 3), 0.5, np.float32)
    write_report(
        tmp_path, report_data(result=replace(found, arrays=found.arrays | {DEVIATION: deviation}))
    )
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Of 90 independent directions, 7 rest on the priors alone: about 6 of lights" in page
    assert "head &lt;size&gt; &amp; distance" in page and "±" in page
    assert "One standard deviation of each vertex" in page

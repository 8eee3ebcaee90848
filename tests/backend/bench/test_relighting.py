"""Relighting in the bench: rows that hold what they say."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from facestage.bench.relighting import RELIGHTING_CSV, bench_relighting, measure_relighting
from facestage.bench.trace import Snapshot, Track
from reference.synthetic_scene import Scene


def test_cached_and_traced_pictures_agree_at_every_size(scene: Scene):
    small, large = measure_relighting(scene.forward, scene.state, scene.stage, (32, 64))
    for row in (small, large):
        print(row.sentence())
        assert row.lights == 6 and row.difference < 5e-4
        assert row.megabytes == pytest.approx(6e-6 * row.lights * row.face_pixels)
        assert row.cached_ms > 0 and row.ratio == pytest.approx(row.traced_ms / row.cached_ms)
    assert large.face_pixels == pytest.approx(4 * small.face_pixels, rel=0.15)


def test_the_rows_are_written_and_told(scene: Scene, tmp_path: Path):
    track = Track([Snapshot(1.0, "joint", scene.state, True)], scene.forward, scene.stage)
    sentences = bench_relighting(tmp_path, track, (32,))
    with (tmp_path / RELIGHTING_CSV).open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert len(sentences) == len(rows) == 1
    assert f"{float(rows[0]['ratio']):.0f}x" in sentences[0] and rows[0]["side_px"] == "32"

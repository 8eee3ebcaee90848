from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from backend.report.example import result, stage
from facestage.report.charts import largest, stage_bands
from facestage.report.tables import (
    Row,
    energy_rows,
    error_row,
    error_tables,
    left_out_table,
    light_place,
    light_rows,
    number,
    relief_sentence,
    setup_rows,
    timing_rows,
    total_seconds,
)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0, "0"),
        (0.0, "0"),
        (1.0, "1"),
        (33.17, "33.17"),
        (-0.0312345, "−0.03123"),
        (123456.0, "123500"),
        (2.5e7, "2.50 × 10⁷"),
        (-3e-9, "−3.00 × 10⁻⁹"),
        (None, "–"),
        (float("nan"), "–"),
        (np.float32(0.25), "0.25"),
        (1234567, "1 234 567"),
        ("some text", "some text"),
    ],
)
def test_numbers_are_written_for_people(value: object, text: str) -> None:
    assert number(value) == text


def test_errors_carry_units_and_truth_is_kept_apart() -> None:
    on_photo, against_truth = error_tables(
        {"psnr": 30.0, "landmark_px": 1.25, "rigid_mm": 2.0, "albedo": 0.05}
    )
    assert [(row.value, row.unit) for row in on_photo] == [("30", "dB"), ("1.25", "px")]
    assert [(row.value, row.unit) for row in against_truth] == [("2", "mm"), ("0.05", "linear")]
    assert error_row("worst_vertex_mm", 3.0) == Row("Worst vertex", "3", "mm")


def test_shares_of_energy_and_time() -> None:
    assert energy_rows(
        {"photo": 1.0, "specular_level": 3.0, "total": 4.0}, {"photo": "The photo"}
    ) == [("Specular level", 0.75, "3"), ("The photo", 0.25, "1")]
    assert timing_rows({"cold_start": 1.0, "render": 1.0, "total": 4.0}) == [
        ("Cold start", 0.25, "1"),
        ("Render", 0.25, "1"),
    ]
    assert total_seconds({"a": 1.0, "b": 2.0}) == 3.0
    assert total_seconds({"a": 1.0, "total": 5.0}) == 5.0


def test_lights_are_ordered_by_power() -> None:
    lights = stage()
    rows = light_rows(lights)
    assert sorted(row.number for row in rows) == list(range(1, 21))
    assert sum(row.share for row in rows) == pytest.approx(1.0)
    assert [row.share for row in rows] == sorted((row.share for row in rows), reverse=True)
    assert {row.state for row in rows if row.share == 0.0} == {"off"}


def test_where_a_light_stands() -> None:
    assert light_place(np.array([1.0, 0.0, 1.0])) == "45° right, 0° up"
    assert light_place(np.array([-1.0, -1.0, 1.0])) == "45° left, 35° down"


def test_the_head_pose_is_shown_in_degrees() -> None:
    pose = np.eye(4)
    angle = np.radians(30)
    pose[:3, :3] = [
        [np.cos(angle), 0, np.sin(angle)],
        [0, 1, 0],
        [-np.sin(angle), 0, np.cos(angle)],
    ]
    rows = {row.label: row.value for row in setup_rows(result(stage(), model_to_camera=pose))}
    assert rows["Head yaw, pitch, roll"] == "+30.0, +0.0, +0.0"
    assert rows["Lights"] == "13 on of 20"


def test_the_left_out_table_has_a_column_for_each_key() -> None:
    heads, rows = left_out_table(
        [{"what": "a", "saved_seconds": 1.5}, {"what": "b", "why": "hidden"}]
    )
    assert heads == ["What", "Saved", "Why"]
    assert rows == [["a", "1.5 s", "–"], ["b", "–", "hidden"]]


def test_the_largest_weights_come_first_and_zeros_not_at_all() -> None:
    assert largest(("a", "b", "c"), np.array([0.5, -2.0, 0.0])) == [("b", -2.0), ("a", 0.5)]
    assert largest((), np.array([0.0, 3.0])) == [("mode 2", 3.0)]
    assert len(largest((), np.ones(40), count=12)) == 12


def test_stage_bands_join_up() -> None:
    bands = stage_bands(["a", "a", "b"], np.array([1.0, 2.0, 8.0]))
    assert bands == [("a", pytest.approx(0.8), 2.0), ("b", 2.0, 8.0)]


def test_relief_is_said_in_millimetres_where_there_is_any():
    plain = result(stage())
    assert not relief_sentence(plain)
    relief = np.array([[0, 0, 3e-4], [0, 4e-4, 0], [0, 0, 0]])
    said = relief_sentence(replace(plain, arrays={"relief": relief}))
    assert "0.35 mm (root mean square over the face), at most 0.40 mm" in said

"""Pins of a job: what is kept, and what is refused in which words."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.job import Job
from facestage.contract.pins import PIN_SIGMA_SHARE, Pins

GIVEN: dict[str, list[Any]] = {
    "corners": [[0, 1, 2], [7, 5, 9]],
    "weights": [[0.5, 0.25, 0.25], [0.0, 1.0, 0.0]],
    "points": [[3.5, -7.25], [100.0, 2.0]],
    "deviation": [0.125, 2.0],
}


def test_pins_are_kept_as_they_are() -> None:
    pins = Pins.from_json(GIVEN)
    assert pins.to_json() == GIVEN and len(pins) == 2
    assert [value.dtype.kind for value in vars(pins).values()] == ["i", "f", "f", "f"]


def test_a_job_without_pins_has_none(tmp_path: Path, photo: Path) -> None:
    none = Pins(np.zeros((0, 3), int), np.zeros((0, 3)), np.zeros((0, 2)), np.zeros(0))
    Job(photo, pins=none).save(tmp_path / "job")
    assert Job.load(tmp_path / "job").pins is None


def test_weights_may_miss_one_by_a_thousandth() -> None:
    Pins.from_json(GIVEN | {"weights": [[0.5, 0.25, 0.2505], [0.0, 0.9995, 0.0]]})
    with pytest.raises(
        InputError, match=r"The pins: the weights of a pin add up to 0\.7, expected 1"
    ):
        Pins.from_json(GIVEN | {"weights": [[0.5, 0.25, 0.25], [0.0, 0.7, 0.0]]})
    with pytest.raises(InputError, match="add up to 1, exp"):  # 1.0015
        Pins.from_json(GIVEN | {"weights": [[0.5, 0.25, 0.2515], [0.0, 1.0, 0.0]]})


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("corners", [[0, 1, -2], [7, 5, 9]]),
        ("corners", [[0, 1, 2.5], [7, 5, 9]]),
        ("corners", [[0, 1, 5_000_001], [7, 5, 9]]),
        ("weights", [[-0.25, 1.0, 0.25], [0.0, 1.0, 0.0]]),
        ("weights", [[1.25, -0.25, 0.0], [0.0, 1.0, 0.0]]),
        ("points", [[3.5, 1e8], [100.0, 2.0]]),
        ("points", [[3.5, None], [100.0, 2.0]]),
        ("deviation", [0.0, 2.0]),
        ("deviation", [0.5, 2e6]),
        ("deviation", [0.5]),
        ("colour", []),
    ],
)
def test_what_is_no_pin_is_refused_by_name(name: str, value: Any) -> None:
    with pytest.raises(InputError, match=name) as caught:
        Pins.from_json(GIVEN | {name: value}, "job file 'a' (pins)")
    assert str(caught.value).startswith("The job file 'a' (pins)")


def test_limits_are_allowed() -> None:
    found = Pins.from_json(
        GIVEN
        | {
            "corners": [[0, 5_000_000, 2], [7, 5, 9]],
            "points": [[1e7, -1e7], [0.0, 0.0]],
            "deviation": [1e-4, 1e6],
        }
    )
    assert found.corners.max() == 5_000_000
    many = {name: [rows[0]] * 10_000 for name, rows in GIVEN.items()}
    assert len(Pins.from_json(many)) == 10_000
    with pytest.raises(InputError, match="pins from 0 to 10000"):
        Pins.from_json({name: [*rows, rows[0]] for name, rows in many.items()})


def test_a_pin_counts_a_hundred_times_a_sharp_landmark() -> None:
    from facestage.fit.energy.landmark_term import LANDMARK_SIGMA_SHARE

    assert pytest.approx(10.0) == LANDMARK_SIGMA_SHARE / PIN_SIGMA_SHARE

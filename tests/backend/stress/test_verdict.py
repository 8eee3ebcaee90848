"""What counts as a fault, and what does not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from facestage.contract.job import Job
from facestage.contract.result import CONVERGED
from facestage.stress.case import DOUBT, REFUSAL, Case, Suite
from facestage.stress.outcome import ADVISED, CRASHED, HUNG, REFUSED, Outcome, judge


def _build(folder: Path) -> Job:
    return Job(image=folder / "photo.exr")


CASE = Case("name", "about", _build, worst_mm=1.0, worst_psnr=30.0)
GOOD = Outcome(
    "name", CONVERGED, "Converged: fine.", mm=0.5, start_mm=0.9, psnr=40.0, condition=100.0
)


def test_an_honest_fit_passes() -> None:
    assert judge(CASE, GOOD).passed


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"mm": 1.01, "start_mm": 1.2}, "1.01 mm, at most 1 mm"),
        ({"mm": None}, "none mm"),
        ({"psnr": 29.9}, "29.90 dB, at least 30 dB"),
        ({"psnr": None}, "none dB"),
        ({"mm": 0.9, "start_mm": 0.7}, "worse than its start"),
        ({"not_finite": ("vertices",)}, "not finite: vertices"),
        ({"sentence": " "}, "no sentence"),
        ({"kind": CRASHED}, "crashed"),
        ({"kind": HUNG}, "hung"),
        ({"kind": REFUSED}, "should not have been refused"),
    ],
)
def test_each_fault_is_named(change: dict[str, Any], words: str) -> None:
    verdict = judge(CASE, replace(GOOD, **change))
    assert not verdict.passed
    assert len(verdict.faults) == 1 and words in verdict.faults[0]


def test_advice_may_miss_the_bounds_but_not_be_nan() -> None:
    advised = replace(GOOD, kind=ADVISED, mm=9.0, psnr=3.0)
    assert judge(CASE, advised).passed
    assert not judge(CASE, replace(advised, not_finite=("lights",))).passed


@pytest.mark.parametrize(
    ("right", "passing"),
    [(DOUBT, {ADVISED, REFUSED}), (REFUSAL, {REFUSED}), ("fit", {CONVERGED, ADVISED})],
)
def test_what_is_right_decides_which_outcomes_pass(right: str, passing: set[str]) -> None:
    case = replace(CASE, right=right)
    found = {
        kind
        for kind in (CONVERGED, ADVISED, REFUSED, CRASHED, HUNG)
        if judge(case, replace(GOOD, kind=kind)).passed
    }
    assert found == passing


def test_an_outcome_survives_its_file(tmp_path: Path) -> None:
    outcome = replace(GOOD, not_finite=("lights",), warnings=("overflow",), condition=None)
    outcome.save(tmp_path / "outcome.json")
    assert Outcome.load(tmp_path / "outcome.json") == outcome


def test_nan_survives_no_file_unnoticed(tmp_path: Path) -> None:
    replace(GOOD, mm=float(np.nan)).save(tmp_path / "outcome.json")
    assert not judge(CASE, Outcome.load(tmp_path / "outcome.json")).passed


def test_two_cases_of_one_name_are_refused() -> None:
    suite = Suite()
    suite.add("twice", "first")(_build)
    with pytest.raises(ValueError, match="two stress cases are named 'twice'"):
        suite.add("twice", "second")(_build)

"""The arithmetic of the tables, against numbers done by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from facestage.bench.charts import LABEL_STEP, free_height, pareto_front
from facestage.bench.table import (
    PSNR,
    SIMILARITY,
    adam_text,
    final,
    ratio_text,
    reach_table,
    seconds_to_reach,
)
from facestage.bench.trace import Row
from facestage.fit.runs.trace import DETAIL


def run(family: str, contender: str, *points: tuple[float, float, float | None]) -> list[Row]:
    return [Row("c", family, contender, s, "joint", db, mm, mm + 1) for s, mm, db in points]


ROUNDED_DOWN = next(
    place for place in np.linspace(241, 255).tolist() if (place + LABEL_STEP) - place < LABEL_STEP
)
OURS = run(
    "ours", "Facestage", (1, 3.0, None), (2, 1.9, 26), (3, 2.2, 29), (4, 1.6, 31), (5, 1.4, 31.5)
)
SLOW = run("adam", "Adam", (1, 3.0, None), (20, 2.4, 27), (40, 1.9, 28.5))
FAST = run("adam", "Adam, coarse", (1, 3.0, None), (8, 2.45, 25), (12, 2.4, 25.5))
OTHER = run("ours", "budget 2 s", (1, 3.0, None), (1.5, 1.0, 40))


@pytest.mark.parametrize(
    ("threshold", "seconds"), [(3.0, 1), (2.5, 2), (2.0, 4), (1.5, 5), (1.3, None)]
)
def test_an_error_counts_once_it_is_kept(threshold: float, seconds: float | None):
    assert seconds_to_reach(OURS, SIMILARITY, threshold) == seconds


def test_higher_decibels_are_better_and_none_is_not_reached():
    assert seconds_to_reach(OURS, PSNR, 25) == 2
    assert seconds_to_reach(OURS, PSNR, 30) == 4
    assert seconds_to_reach(OURS, PSNR, 32) is None
    assert seconds_to_reach(OURS[:1], PSNR, 1) is None
    assert seconds_to_reach([], PSNR, 1) is None


def test_ratios_are_against_the_fastest_alternative():
    table = {
        (item.measure.unit, item.threshold): item
        for item in reach_table([*OURS, *SLOW, *FAST], ["Facestage"])
    }
    at = table["mm", 2.5]
    assert at.seconds == {"ours": 2, "adam": 8} and at.ratio == 4.0 and not at.is_bound
    assert (adam_text(at), ratio_text(at)) == ("8.0", "4.0x")
    at = table["mm", 2.0]
    assert at.ratio == 10.0
    at = table["mm", 1.5]
    assert at.seconds["adam"] is None and at.is_bound and at.ratio == 40 / 5
    assert (adam_text(at), ratio_text(at)) == ("> 40", "> 8.0x")
    assert ("mm", 1.3) not in table and ("mm", 3.0) not in table
    assert table["dB", 31.0].is_bound and table["dB", 31.0].ratio == 10.0
    # The worst first render has 25 dB.
    assert ("dB", 25.0) not in table and ("dB", 26.0) in table
    assert table["dB", 28.0].seconds == {"ours": 3, "adam": 40}


def test_the_albedo_detail_is_not_what_anybody_reached():
    detail = Row("c", "ours", "Facestage", 6, DETAIL, 39.0, 1.4, 2.4)
    reached = [
        item.threshold
        for item in reach_table([*OURS, detail], ["Facestage"])
        if item.measure is PSNR
    ]
    assert max(reached) == 31.0


def test_a_bound_below_one_is_no_ratio():
    short = [row for row in SLOW if row.seconds < 4]
    table = {
        (item.measure.unit, item.threshold): item
        for item in reach_table([*OURS, *short], ["Facestage"])
    }
    assert table["mm", 1.5].ratio is None and ratio_text(table["mm", 1.5]) == "-"


def test_a_variant_of_our_own_counts_only_when_it_is_a_main_contender():
    table = reach_table([*OURS, *OTHER], ["Facestage"])
    assert all(item.threshold != 1.0 for item in table)
    assert all(item.ratio is None and ratio_text(item) == "-" for item in table)


def test_the_end_of_a_run_keeps_its_own_and_the_detail_picture_apart():
    detail = Row("c", "ours", "Facestage", 6, DETAIL, 39.0, 1.4, 2.4)
    item = final([*OURS, detail], {"albedo": 0.03})
    assert (item.seconds, item.psnr, item.detail_psnr, item.albedo, item.light) == (
        5,
        31.5,
        39.0,
        0.03,
        None,
    )


def test_pareto_front():
    points = [(1, 3.0), (2, 2.0), (2, 2.5), (3, 2.5), (5, 1.0)]
    assert pareto_front(points, lower_is_better=True) == [(1, 3.0), (2, 2.0), (5, 1.0)]
    assert pareto_front(points, lower_is_better=False) == [(1, 3.0)]


@given(st.floats(0, 1000), st.lists(st.floats(0, 1000), max_size=8))
# A step above this place is less than a step away from it, as floats are rounded.
@example(ROUNDED_DOWN, [ROUNDED_DOWN])
def test_a_label_takes_the_lowest_free_place(height, taken):
    place = free_height(height, taken)
    assert place >= height
    assert all(abs(other - place) > LABEL_STEP - 1e-9 for other in taken)
    below = [height, *(other + LABEL_STEP for other in taken)]
    lower = [low for low in below if height <= low < place - 1e-9]
    assert all(any(abs(other - low) < LABEL_STEP for other in taken) for low in lower)

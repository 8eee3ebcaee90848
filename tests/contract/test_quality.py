"""The quality names of a budget."""

from __future__ import annotations

import pytest

from facestage.contract.errors import InputError
from facestage.contract.quality import (
    GOOD,
    QUALITIES,
    Expectation,
    describe,
    expectations,
    parse_budget,
)


def test_a_budget_is_seconds_or_a_name():
    assert parse_budget("12.5") == (12.5, GOOD)
    for name in QUALITIES:
        assert parse_budget(name) == (None, name)


@pytest.mark.parametrize("text", ["", "fast", "0", "-3", "nan", "inf", "Good"])
def test_anything_else_is_refused_in_a_sentence(text: str):
    with pytest.raises(InputError, match=r"expected seconds greater than 0, or draft, good, best"):
        parse_budget(text)


def test_what_was_measured_is_told():
    found = expectations()
    for name in QUALITIES:
        assert found[name].sentence() in describe(name)
    assert Expectation(9.6, 0.71, 37.2).sentence() == "about 10 s, 0.7 mm, 37 dB"

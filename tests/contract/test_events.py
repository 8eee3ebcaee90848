"""Events: one line of JSON each; foreign lines are not events."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from facestage.contract.events import DONE, FAILED, PROGRESS, STARTED, Event

words = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]))
numbers = st.floats(allow_nan=False, allow_infinity=False)
events = st.builds(
    Event,
    kind=st.sampled_from([STARTED, PROGRESS, DONE, FAILED]),
    stage=words,
    iteration=st.integers(-(2**62), 2**62),
    error=st.none() | numbers,
    seconds=numbers,
    seconds_left=st.none() | numbers,
    fraction=st.floats(0, 1),
    preview=st.none() | words,
    message=words,
)


@given(events)
def test_round_trip_in_exactly_one_line(event: Event):
    line = event.to_line()
    assert len(line.splitlines()) == 1 and line.isascii()
    assert Event.from_line(line) == event


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_numbers_that_json_lacks_become_null(value: float):
    line = Event(PROGRESS, error=value, seconds_left=value).to_line()
    assert json.loads(line)["error"] is None and "NaN" not in line and "Infinity" not in line


@given(
    st.text()
    | st.sampled_from(["", "null", "3", "[1]", '"kind"', "{}", '{"a": 1}', "Warning: jit"])
)
def test_a_foreign_line_is_no_event(line: str):
    assert Event.from_line(line) is None


def test_unknown_keys_of_a_newer_backend_are_ignored():
    assert Event.from_line('{"kind": "done", "mood": "good"}') == Event(DONE)


@pytest.mark.parametrize(
    "line",
    [
        '{"kind": 5}',
        '{"kind": "progress", "fraction": "half"}',
        '{"kind": "progress", "fraction": 1e400}',
        '{"kind": "progress", "fraction": NaN}',
        '{"kind": "progress", "stage": null}',
        '{"kind": "progress", "message": {"kind": 1}}',
        '{"kind":' * 5000,
        "[" * 100_000,
        '{"kind": "progress", "seconds": ' + "9" * 5000 + "}",
        '{"kind": "progress", "message": "\\ud800"}',
    ],
)
def test_a_line_of_wrong_values_is_no_event(line: str):
    assert Event.from_line(line) is None

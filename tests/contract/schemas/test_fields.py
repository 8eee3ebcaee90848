"""Each field at its limits: what is just right, what is just wrong, and the words that say so."""

from __future__ import annotations

from typing import Any

import pytest
from marshmallow import ValidationError

from facestage.contract.errors import InputError
from facestage.contract.schemas.fields import (
    Checked,
    Choice,
    Figures,
    Flag,
    Items,
    Name,
    Number,
    Part,
    PathText,
    Plain,
    Table,
    Text,
    Whole,
    range_words,
    within,
    writable,
)
from facestage.contract.schemas.schema import FileSchema, checked


def loaded(field: Checked, value: object) -> Any:
    """What the field makes of a value."""
    schema: Any = FileSchema.from_dict({"value": field})
    return checked(schema(), {"value": value}, "The file")["value"]


class Lamp(FileSchema):
    watts = Number(0)


LONG = f"'{'x' * 60}...' (1001 characters)"

# A field, what stands in the file, and what it is then: the largest and the smallest that pass.
RIGHT: list[tuple[Checked, Any, Any]] = [
    (Text(), "", ""),
    (Text(2, 3), "ab", "ab"),
    (Text(2, 3), "abc", "abc"),
    (Text(), "x" * 20_000, "x" * 20_000),
    (Name(), "a", "a"),
    (Name(), "x" * 1000, "x" * 1000),
    (Name(2), "ab", "ab"),
    (PathText(), "x" * 4096, "x" * 4096),
    (Choice(("a", "b")), "b", "b"),
    (Flag(), False, False),
    (Flag(), True, True),
    (Number(), -1, -1.0),
    (Number(0, 1), 0, 0.0),
    (Number(0, 1), 1, 1.0),
    (Number(maximum=5), 5, 5.0),
    (Whole(1, 5), 1, 1),
    (Whole(1, 5), 5.0, 5),
    (Items(Whole(0, 9)), [], ()),
    (Items(Whole(0, 9), 2, 3), [1, 2], (1, 2)),
    (Items(Whole(0, 9), 2, 3), (1, 2, 3), (1, 2, 3)),
    (Items(Flag(), maximum=3), [True] * 3, (True,) * 3),
    (Items(Text()), ["a", "a"], ("a", "a")),
    (Items(Text(), unique=True), ["a", "b"], ("a", "b")),
    (Table(Number()), {}, {}),
    (Table(Number(), 2), {"x" * 1000: 1, "b": 2}, {"x" * 1000: 1.0, "b": 2.0}),
    (Figures(), {"a": 1, "b": None, "c": 0}, {"a": 1.0, "c": 0.0}),
    (Plain(), None, None),
    (Plain(), [True, "x", {"y": [0.5]}], [True, "x", {"y": [0.5]}]),
    (Part(Lamp), {"watts": 40, "color": "red"}, {"watts": 40.0}),
]


@pytest.mark.parametrize(("field", "value", "wanted"), RIGHT, ids=lambda item: str(item)[:30])
def test_what_is_just_right_passes(field: Checked, value: object, wanted: object):
    found = loaded(field, value)
    assert found == wanted and type(found) is type(wanted)


WRONG: list[tuple[Checked, Any, str]] = [
    (Text(2), "a", " is 'a', expected text"),
    (Text(), "x" * 20_001, " has 20001 characters, expected at most 20000"),
    (Name(), "x" * 1001, " has 1001 characters, expected at most 1000"),
    (Name(2), "abc", " has 3 characters, expected at most 2"),
    (PathText(), "", " is '', expected a path"),
    (PathText(), "x" * 4097, " has 4097 characters, expected at most 4096"),
    (Flag(), None, " is null, expected true or false"),
    (Number(0, 1), -0.001, " is -0.001, expected a number of 0 to 1"),
    (Number(0, 1), 1.001, " is 1.001, expected a number of 0 to 1"),
    (Number(maximum=5), 5.5, " is 5.5, expected a number of at most 5"),
    (Whole(1, 5), 0, " is 0, expected a whole number of 1 to 5"),
    (Whole(1, 5), float("inf"), " is inf, expected a whole number of 1 to 5"),
    (Items(Flag(), 2, 3), [True] * 4, " has 4 entries, expected 2 to 3"),
    (Items(Flag()), [True] * 100_001, " has 100001 entries, expected 0 to 100000"),
    (Items(Flag()), {}, " is an object of 0 keys, expected a list of true or false each"),
    (Items(Text(), unique=True), ["a", "b", "c", "b"], " has 'b' twice, expected each once"),
    (Table(Flag()), 1, " is 1, expected an object of names with true or false each"),
    (
        Table(Flag()),
        dict.fromkeys(map(str, range(100_001)), True),
        " has 100001 entries, expected at most 100000",
    ),
    (Table(Flag()), {5: True}, " has the name 5, expected text of at most 1000 characters"),
    (
        Table(Flag()),
        {"x" * 1001: True},
        f" has the name {LONG}, expected text of at most 1000 characters",
    ),
    (Figures(), {"a": "b"}, ".a is 'b', expected a number"),
    (Plain(), "\ud800", " is '\\ud800', expected plain values"),
    (Plain(), [1, "a\0"], "[1] is 'a\\x00', expected plain values"),
    (Plain(), float("nan"), " is nan, expected plain values"),
    (Part(Lamp, "a lamp"), None, " is null, expected a lamp"),
    (Part(Lamp), {"watts": -1}, ".watts is -1, expected a number of 0 or more"),
    (Items(Part(Lamp, "a lamp")), [{"watts": 1}, 5], "[1] is 5, expected a lamp"),
]


@pytest.mark.parametrize(("field", "value", "words"), WRONG, ids=lambda item: str(item)[:30])
def test_what_is_just_wrong_is_refused_in_these_words(field: Checked, value: object, words: str):
    with pytest.raises(InputError) as caught:
        loaded(field, value)
    assert str(caught.value) == f"The file: value{words}."


@pytest.mark.parametrize(
    ("field", "words"),
    [
        (Items(Flag()), "a list of true or false each"),
        (Items(Flag(), 0, 3), "a list of true or false each, at most 3"),
        (
            Items(Table(Number(0))),
            "a list of an object of names with a number of 0 or more each each",
        ),
        (Choice(("a", "b")), "one of a, b"),
        (Part(Lamp), "an object"),
        (Plain(), "plain values"),
    ],
    ids=lambda item: str(item)[:30],
)
def test_a_field_that_is_missing_says_what_it_would_be(field: Checked, words: str):
    schema: Any = FileSchema.from_dict({"value": field})
    with pytest.raises(InputError) as caught:
        checked(schema(), {}, "The file")
    assert str(caught.value) == f"The file lacks value, expected {words}."


def test_a_field_with_a_default_or_that_is_not_required_may_be_missing():
    schema: Any = FileSchema.from_dict(
        {"watts": Number(load_default=2.0), "color": Text(required=False)}
    )
    assert checked(schema(), {}, "The file") == {"watts": 2.0}


@pytest.mark.parametrize(
    ("minimum", "maximum", "words"),
    [
        (None, None, ""),
        (0, None, " of 0 or more"),
        (-0.5, None, " of -0.5 or more"),
        (None, 5, " of at most 5"),
        (None, 0.25, " of at most 0.25"),
        (0, 1, " of 0 to 1"),
        (1, 10**9, " of 1 to 1000000000"),
        (-1e9, 1e9, " of -1e+09 to 1e+09"),
    ],
)
def test_ranges_in_words(minimum: float | None, maximum: float | None, words: str):
    assert range_words(minimum, maximum) == words


def test_a_whole_number_beyond_all_floats_is_within_no_range():
    assert within(10**400, Number()) is within(-(10**400), Number()) is False
    assert within(10**300, Number()) is True


def test_text_that_cannot_be_written_anywhere():
    assert writable("") is writable("ä\n\U0001f600") is True
    assert writable("a\0") is writable("\udfff") is False


def test_an_entry_keeps_its_place_within_another():
    with pytest.raises(ValidationError) as caught:
        Table(Items(Whole(0, 9))).deserialize({"a": [1], "b": [2, 10]})
    assert caught.value.messages == {"b": {1: ["is 10, expected a whole number of 0 to 9"]}}

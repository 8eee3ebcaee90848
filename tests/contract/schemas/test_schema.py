"""Fields believe nothing, schemas tie arrays together, and an error is one sentence about one
value.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import pytest
from marshmallow import ValidationError

from facestage.contract.errors import InputError
from facestage.contract.schemas.array_field import FLAGS, WHOLE, Array, Words, rigid, unit
from facestage.contract.schemas.fields import (
    Choice,
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
)
from facestage.contract.schemas.schema import (
    FileSchema,
    HandWritten,
    check_version,
    checked,
    decoded_meta,
    sections,
)

WRONG: list[tuple[Any, Any, str]] = [
    (Text(), 5, "is 5, expected text"),
    (Text(), b"x", "is b'x', expected text"),
    (Text(), "\ud800", "characters that no text has"),
    (Text(), "a\0", "characters that no text has"),
    (Text(maximum=3), "abcd", "has 4 characters, expected at most 3"),
    (Name(), "", "is '', expected text that is not empty"),
    (PathText(), "x" * 5000, "has 5000 characters"),
    (Choice(("a", "b")), "c", "is 'c', expected one of a, b"),
    (Choice(("a", "b")), ["a"], "is a list of 1"),
    (Flag(), 1, "is 1, expected true or false"),
    (Flag(), "true", "is 'true'"),
    (Number(), True, "is true, expected a number"),
    (Number(), "1", "is '1', expected a number"),
    (Number(), float("nan"), "is nan"),
    (Number(), 10**400, "is a number of 1329 bits"),
    (Number(0, 1), 1.5, "is 1.5, expected a number of 0 to 1"),
    (Number(0), -1, "expected a number of 0 or more"),
    (Number(), None, "is null, expected a number"),
    (Whole(1, 5), 1.5, "is 1.5, expected a whole number of 1 to 5"),
    (Whole(1, 5), 6, "is 6"),
    (Whole(1, 5), True, "is true"),
    (Items(Whole(0, 9)), "12", "is '12', expected a list"),
    (Items(Whole(0, 9)), [1, "2"], r"\[1\] is '2'"),
    (Items(Whole(0, 9), 2, 2), [1], "has 1 entries, expected 2 to 2"),
    (Items(Text(), unique=True), ["a", "b", "a"], "has 'a' twice"),
    (Table(Number()), [], "is a list of 0"),
    (Table(Number()), {"a": "b"}, "value.a is 'b'"),
    (Table(Number()), {"\ud800": 1}, "has the name"),
    (Table(Number(), 1), {"a": 1, "b": 2}, "has 2 entries, expected at most 1"),
    (Plain(), {"a": [float("inf")]}, r"value\.a\[0\] is inf"),
    (Part(FileSchema), [], "is a list of 0, expected an object"),
    (Array((2,)), np.zeros(3), r"has shape \(3,\), expected \(2,\)"),
    (Array((2,)), np.zeros((2, 1)), r"has shape \(2, 1\)"),
    (Array((2,)), np.array([1, np.nan]), "NaN or infinity"),
    (Array((2,)), np.array(["a", "b"]), "holds <U1 values, expected numbers"),
    (Array((2,), WHOLE), np.zeros(2), "holds float64 values, expected whole numbers"),
    (Array((2,), FLAGS), np.zeros(2), "expected true or false"),
    (Array((2,), minimum=0), np.array([1, -2]), "holds -2, expected numbers of 0 or more"),
    (Array((2,), maximum=5), np.array([1, 7.0]), "holds 7, expected numbers of at most 5"),
    (Array((2,), maximum=5, finite=False), np.array([np.nan, 7.0]), "holds 7"),
    (Array((2, 2)), [[1, 2], [3]], "has rows of 1 and of 2"),
    (Array((2,)), [1, True], r"value\[1\] is true, expected one of numbers"),
    (Array((2,)), [1, None], r"value\[1\] is null"),
    (Array((2,)), [1, 10**400], "beyond all bounds"),
    (Array((2,)), {"a": 1}, "is an object of 1 keys"),
    (Array((4, 4), validate=rigid), 2 * np.eye(4), "not a rigid"),
    (Array((4, 4), validate=rigid), np.diag([1, 1, -1, 1.0]), "not a rigid"),
    (Array((4, 4), validate=rigid), np.eye(4) + np.eye(4)[[3, 0, 1, 2]], "not a rigid"),
    (Array((1, 3), validate=unit), np.zeros((1, 3)), "not of length 1"),
    (Words(), np.array(5), "is an array of shape .* expected text"),
]


@pytest.mark.parametrize(("field", "value", "words"), WRONG, ids=lambda item: str(item)[:30])
def test_wrong_values_are_named(field: Any, value: Any, words: str):
    schema: Any = FileSchema.from_dict({"value": field})
    with pytest.raises(
        InputError, match=rf"The file.*(: value.*)?{words}.*; write it again\.$"
    ) as caught:
        checked(schema(), {"value": value}, "The file 'x'", "write it again")
    assert str(caught.value).isprintable() and len(str(caught.value)) < 300


def test_right_values_pass_as_they_are():
    schema: Any = FileSchema.from_dict(
        {
            "a": Whole(1, 100),
            "b": Items(Number()),
            "c": Array((2, 2), nulls=True, finite=False),
            "d": Plain(),
        }
    )
    found = checked(
        schema(),
        {"a": 96.0, "b": [1, 2.5], "c": [[1, None], [3, 4]], "d": {"x": [None, 1.5]}},
        "The file",
    )
    assert (found["a"], found["b"], found["d"]) == (96, (1.0, 2.5), {"x": [None, 1.5]})
    np.testing.assert_array_equal(found["c"], np.array([[1, np.nan], [3, 4]]))


class Shape(FileSchema):
    dimensions: ClassVar = {"n": (1, 5)}
    points = Array(("n", 3))
    weights = Array(("n",))


def test_a_named_dimension_is_the_same_everywhere():
    checked(Shape(), {"points": np.zeros((4, 3)), "weights": np.zeros(4)}, "The file")
    for known, arrays, words in (
        (
            {},
            {"points": np.zeros((4, 3)), "weights": np.zeros(3)},
            r"weights has shape \(3,\), expected \(4,\)",
        ),
        (
            {"n": 2},
            {"points": np.zeros((4, 3)), "weights": np.zeros(4)},
            r"points has shape .* expected \(2, 3\)",
        ),
        ({}, {"points": np.zeros((0, 3)), "weights": np.zeros(0)}, "with n from 1 to 5"),
        ({}, {"points": np.zeros((6, 3)), "weights": np.zeros(6)}, "with n from 1 to 5"),
        (
            {},
            {"points": np.zeros((4, 3))},
            r"The file lacks weights, expected numbers in the shape \(n,\)",
        ),
    ):
        with pytest.raises(InputError, match=words):
            checked(Shape(**known), arrays, "The file")


def test_unknown_keys_are_ignored_in_results_and_named_in_what_people_write():
    class Written(HandWritten):
        radiance = Number()

    class Result(FileSchema):
        radiance = Number()

    assert checked(Result(), {"radiance": 1, "x": 2}, "The file") == {"radiance": 1}
    with pytest.raises(InputError, match="The file: radience is not known, expected radiance"):
        checked(Written(), {"radiance": 1, "radience": 2}, "The file")


def test_a_million_wrong_entries_cost_one_error():
    with pytest.raises(ValidationError) as caught:
        Items(Number(), maximum=10**7).deserialize(["x"] * 1_000_000)
    assert caught.value.messages == {0: ["is 'x', expected a number"]}


def test_arrays_fall_into_sections():
    found = sections(
        {"a": np.zeros(1), "stage/x": np.zeros(2), "extra/b/c": np.zeros(3)}, "stage", "extra"
    )
    assert (
        set(found) == {"a", "stage", "extra"}
        and set(found["stage"]) == {"x"}
        and set(found["extra"]) == {"b/c"}
    )


@pytest.mark.parametrize("text", ["[" * 5000, "[]", "5", "", '{"a": NaN}'])
def test_damaged_meta_data_is_said(text: str):
    with pytest.raises(InputError, match=r"The model has damaged meta data .*; convert it again"):
        decoded_meta(text, "The model", "convert it again")


@pytest.mark.parametrize("text", ["a\nb", "a\x1b[31mb", "a\u2028b", "\ud800", "x" * 100_000])
def test_every_error_is_one_line_of_bounded_length(text: str):
    sentence = str(InputError(f"The file '{text}' is not there; check the path."))
    assert sentence.isprintable() and len(sentence) < 1000
    assert sentence.startswith("The file '") and sentence.endswith("check the path.")


@pytest.mark.parametrize(
    ("found", "words"), [(2, "2"), (1.0, "1.0"), (True, "true"), ("1", "'1'"), (None, "null")]
)
def test_only_the_number_of_the_version_is_the_version(found: Any, words: str):
    check_version({"schema": 1}, 1, "The file", "write it again")
    with pytest.raises(InputError) as caught:
        check_version({"schema": found}, 1, "The file", "write it again")
    assert str(caught.value) == f"The file has schema {words}, expected 1; write it again."


@pytest.mark.parametrize(
    ("name", "step"),
    [
        ("jaw_open/left-2", "jaw_open/left-2"),
        ("a" * 60, "a" * 60),
        ("a" * 61, f"'{'a' * 60}...' (61 characters)"),
        ("two words", "'two words'"),
        ("", "''"),
        ("a\nb", r"'a\nb'"),
        ("[a", "[a"),
    ],
)
def test_a_value_is_named_by_its_path(name: str, step: str):
    schema: Any = FileSchema.from_dict({"lights": Table(Items(Table(Flag())))})
    with pytest.raises(InputError) as caught:
        checked(schema(), {"lights": {"key": [{}, {name: 1}]}}, "The file")
    dot = "" if step.startswith("[") else "."
    assert str(caught.value) == f"The file: lights.key[1]{dot}{step} is 1, expected true or false."


def test_an_array_of_a_sections_name_is_left_for_the_schema_to_refuse():
    found = sections(
        {"stage/x": np.zeros(2), "stage": np.ones(1), "/": np.zeros(3)}, "stage", "none"
    )
    assert set(found) == {"stage", "/"} and isinstance(found["stage"], np.ndarray)

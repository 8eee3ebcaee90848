"""Arrays at the limits of their field: shape, kind and range; how far a transform may be off."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import pytest
from marshmallow import ValidationError

from facestage.contract.errors import InputError
from facestage.contract.schemas.array_field import FLAGS, WHOLE, Array, Words, rigid, unit
from facestage.contract.schemas.schema import FileSchema, checked

NAN = float("nan")


def loaded(field: Array | Words, value: object) -> Any:
    """What the field makes of a value."""
    schema: Any = FileSchema.from_dict({"value": field})
    return checked(schema(), {"value": value}, "The file")["value"]


@pytest.mark.parametrize(
    ("field", "value"),
    [
        (Array((2,), minimum=0, maximum=5), np.array([0.0, 5.0])),
        (Array((2,), WHOLE, minimum=-1), np.array([-1, 9], np.int32)),
        (Array((0, 3)), np.zeros((0, 3))),
        (Array((0,), minimum=1), np.zeros(0)),
        (Array((2,), FLAGS), np.array([True, False])),
        (Array((), FLAGS), np.array(True)),
        (Array(None), np.zeros((1, 2, 3), np.float16)),
        (Array((2,), finite=False), np.array([NAN, np.inf])),
        (Array((2,), finite=False, minimum=-1, maximum=0.5), np.array([NAN, 0.25])),
    ],
    ids=lambda item: str(item)[:30],
)
def test_an_array_that_is_just_right_is_the_same_object(field: Array, value: np.ndarray):
    assert loaded(field, value) is value


@pytest.mark.parametrize(
    ("field", "value", "kind", "wanted"),
    [
        (Array((2,)), [1, 2.5], np.float64, [1, 2.5]),
        (Array((2,), WHOLE), (1, 2), np.int64, [1, 2]),
        (Array((2,), FLAGS), [True, False], np.bool_, [True, False]),
        (Array(None), [1, 2, 3], np.float64, [1, 2, 3]),
        (Array((1, 2, 1)), [[[1], [2]]], np.float64, [[[1], [2]]]),
        (Array((0,)), [], np.float64, []),
        (Array((2,), nulls=True, finite=False), [None, 1], np.float64, [NAN, 1]),
    ],
    ids=lambda item: str(item)[:30],
)
def test_lists_become_arrays_of_one_type(field: Array, value: object, kind: type, wanted: list):
    found = loaded(field, value)
    assert found.dtype == kind
    np.testing.assert_array_equal(found, np.array(wanted, kind), strict=True)


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        (
            Array((2,), minimum=0, maximum=5),
            np.array([0, 5.5]),
            " holds 5.5, expected numbers of 0 to 5",
        ),
        (
            Array((2,), minimum=0, maximum=5),
            np.array([-0.5, 5]),
            " holds -0.5, expected numbers of 0 to 5",
        ),
        (
            Array((2,), WHOLE, minimum=-1),
            np.array([0, -2]),
            " holds -2, expected whole numbers of -1 or more",
        ),
        (
            Array((2,), minimum=0, finite=False),
            np.array([NAN, -0.5]),
            " holds -0.5, expected numbers of 0 or more",
        ),
        (Array((2,)), np.array([1, np.inf]), " holds NaN or infinity"),
        (Array((2,)), np.array([-np.inf, 1]), " holds NaN or infinity"),
        (Array((2,), WHOLE), [1, 2.0], "[1] is 2.0, expected one of whole numbers"),
        (Array((2,), FLAGS), [0, 1], "[0] is 0, expected one of true or false"),
        (Array((2, 2)), [[1, 2], [3, "x"]], "[1][1] is 'x', expected one of numbers"),
        (Array((2, 2)), [[1, 2], 3], " is 3, expected numbers in the shape (2, 2)"),
        (Array(("n", 3)), [], " has shape (0, 0), expected (n, 3)"),
        (
            Array((2,), words="a place in the photo"),
            [1, 2, 3],
            " has shape (3,), expected (2,): a place in the photo",
        ),
        (Array(None, minimum=0), 5, " is 5, expected numbers of 0 or more"),
        (
            Array((2,), WHOLE, minimum=0),
            5,
            " is 5, expected whole numbers of 0 or more in the shape (2,)",
        ),
        (Array((2,), WHOLE), [1, 2**64], " holds a number beyond all bounds"),
        (Words(), "plain", " is 'plain', expected text"),
        (Words(), np.array(["x"]), " is an array of shape (1,) of <U1, expected text"),
    ],
    ids=lambda item: str(item)[:30],
)
def test_what_is_just_wrong_is_refused_in_these_words(field: Any, value: object, words: str):
    with pytest.raises(InputError) as caught:
        loaded(field, value)
    assert str(caught.value) == f"The file: value{words}."


def test_words_of_an_npz_are_text():
    found = loaded(Words(), np.array("ä b"))
    assert found == "ä b" and type(found) is str


class Cloud(FileSchema):
    dimensions: ClassVar = {"n": (2, 4)}
    points = Array(("n", 3))
    tags = Array(("n", "m"))


@pytest.mark.parametrize("count", [2, 4])
def test_the_least_and_the_most_entries_pass(count: int):
    found = checked(
        Cloud(), {"points": np.zeros((count, 3)), "tags": np.zeros((count, 0))}, "The file"
    )
    assert len(found["points"]) == count


def test_a_dimension_beyond_its_limits_says_which():
    for count in (1, 5):
        arrays = {"points": np.zeros((count, 3)), "tags": np.zeros((count, 0))}
        with pytest.raises(InputError) as caught:
            checked(Cloud(), arrays, "The file")
        words = f"points has shape ({count}, 3), expected (n, 3) with n from 2 to 4"
        assert str(caught.value) == f"The file: {words}."


def turned(degrees: float, scale: float = 1.0) -> np.ndarray:
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    matrix = np.eye(4)
    matrix[:3, :3] = scale * np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
    matrix[:3, 3] = [1, -2, 300]
    return matrix


def test_a_transform_may_be_off_by_what_a_file_rounds_away():
    # R R^T may be off by 1.1e-4: a scale of 5.5e-5.
    for scale in (1.0, 1.00005, 0.99995):
        rigid(turned(40, scale))
    for scale in (1.00006, 0.99994, -1.0):
        with pytest.raises(ValidationError, match="rigid"):
            rigid(turned(40, scale))


@pytest.mark.parametrize("column", [0, 1, 2, 3])
def test_the_last_row_of_a_transform_is_exact(column: int):
    slightly, more = turned(40), turned(40)
    slightly[3, column] += 0.5e-9
    rigid(slightly)
    more[3, column] += 2e-5
    with pytest.raises(ValidationError, match="rigid"):
        rigid(more)


def test_directions_may_be_off_by_what_a_file_rounds_away():
    direction = np.array([[0.6, 0.0, 0.8], [0.0, -1.0, 0.0]])
    unit(np.zeros((0, 3)))
    for scale in (1.0, 1.001, 0.999):
        unit(direction * [[1], [scale]])
    for scale in (1.0011, 0.9989, 2.0):
        with pytest.raises(ValidationError, match="not of length 1"):
            unit(direction * [[1], [scale]])

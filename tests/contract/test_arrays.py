"""The shapes in annotations are checked while the tests run, and cost nothing elsewhere."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator

import jaxtyping
import numpy as np
import pytest

from facestage.contract.arrays import Float
from facestage.contract.camera import Camera
from facestage.contract.errors import InputError
from facestage.contract.landmarks import Landmarks
from facestage.contract.light_stage import fibonacci_stage
from reference.checked import FIRST_CALLS, checked

ONE, TWO = np.zeros(1), np.zeros(2)


@checked
def joined(
    a: Float[np.ndarray, " n"], b: Float[np.ndarray, " n"], *, wrong: bool = False
) -> Float[np.ndarray, "n n"]:
    if len(a) > 1:
        joined(a[:1], b[:1])  # its n is another one
    return np.outer(a, b)[: 0 if wrong else None]


@checked
def each(array: Float[np.ndarray, " n"]) -> Iterator[float]:
    yield from array


@checked
def named(word: str) -> int:
    return len(word) if word else None  # type: ignore[return-value]


def test_a_name_is_one_length_within_a_call():
    assert joined(ONE, ONE).shape == (1, 1)
    assert joined(TWO, TWO).shape == (2, 2)
    with pytest.raises(jaxtyping.TypeCheckError, match=r"\bb\b"):
        joined(TWO, ONE)
    with pytest.raises(jaxtyping.TypeCheckError, match="return"):
        joined(TWO, TWO, wrong=True)


def test_calls_without_arrays_and_generators_are_checked_too():
    assert named("four") == 4
    with pytest.raises(jaxtyping.TypeCheckError, match="word"):
        named(4)  # type: ignore[arg-type]
    with pytest.raises(jaxtyping.TypeCheckError, match="return"):
        named("")
    assert list(each(TWO)) == [0.0, 0.0]
    with pytest.raises(jaxtyping.TypeCheckError, match="array"):
        each([0.0])  # type: ignore[arg-type]


@pytest.mark.parametrize("again", [False, True])
def test_first_calls_are_checked_in_each_test(again: bool):
    """The second time too."""
    with pytest.raises(jaxtyping.TypeCheckError, match=r"\bb\b"):
        joined(TWO, ONE)
    for _ in range(FIRST_CALLS):
        joined(ONE, ONE)
    joined(TWO, ONE)


def test_an_argument_of_another_shape_is_refused():
    camera = Camera.default(40, 30)
    assert camera.project(-np.ones((2, 3))).shape == (2, 2)
    with pytest.raises(jaxtyping.TypeCheckError, match="points"):
        camera.project(-np.ones((2, 4)))
    with pytest.raises(jaxtyping.TypeCheckError, match="points"):
        camera.project(np.ones((2, 3), int))


def test_the_sides_of_one_dataclass_agree():
    Landmarks("ibug68", np.zeros((4, 2)), np.ones(4, bool))
    with pytest.raises(jaxtyping.TypeCheckError, match="visible"):
        Landmarks("ibug68", np.zeros((4, 2)), np.ones(5, bool))


def test_what_a_dataclass_refuses_it_says_itself():
    stage = fibonacci_stage(3)
    with pytest.raises(InputError, match=r"radiance has shape \(4, 3\), expected \(3, 3\)"):
        type(stage)(**(vars(stage) | {"radiance": np.ones((4, 3))}))


def test_the_annotations_are_jaxtypings_here_and_nothing_elsewhere():
    assert Float is jaxtyping.Float
    script = (
        "import sys, typing; from facestage.contract.arrays import Float; assert Float is "
        "typing.Annotated and 'jaxtyping' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", script], check=True, timeout=60)

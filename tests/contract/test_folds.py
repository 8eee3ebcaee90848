"""How much of an expression's folds is gone, and what a result says of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.folds import PLACES, Folds
from facestage.contract.result import Result

PLACE = np.array([[1.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
PULL = np.array([[2.0, 0.0, -1.0], [0.0, 1.25, 0.0], [0.5, 0.5, 0.0]])
FITTED = np.array([0.7, 0.8, 0.4])


def test_all_are_there_in_the_photos_expression_and_gone_at_rest():
    folds = Folds(PLACE, PULL)
    np.testing.assert_array_equal(folds.gone(FITTED)[:2], 0.0)
    np.testing.assert_allclose(folds.gone(np.zeros(3)), PLACE.sum(axis=1))


def test_each_place_goes_as_its_own_sliders_do():
    gone = Folds(PLACE, PULL).gone(np.array([0.3, 0.4, 0.2]))
    np.testing.assert_allclose(gone, [0.6, 0.5 * 0.6 + 0.5 * 0.5, 1 - 0.35, 0.0])
    more, other_way = np.array([9.0, 9.0, 0.0]), np.array([-1.0, -1.0, 1.0])
    np.testing.assert_array_equal(Folds(PLACE, PULL).gone(more), 0.0)
    np.testing.assert_allclose(Folds(PLACE, PULL).gone(other_way), PLACE.sum(axis=1))


def with_folds(result: Result, place: np.ndarray, pull: np.ndarray) -> Result:
    return replace(result, arrays=result.arrays | Folds(place, pull).arrays)


def test_a_result_keeps_them(tmp_path: Path, result: Result):
    assert result.folds is None
    rng = np.random.default_rng(1)
    place = rng.uniform(size=(len(result.vertices), len(PLACES)))
    pull = rng.normal(size=(len(PLACES), len(result.expression)))
    with_folds(result, place, pull).write_into(tmp_path)
    found = Result.load(tmp_path).folds
    assert found is not None
    np.testing.assert_allclose(found.place, place, rtol=1e-6)
    np.testing.assert_allclose(found.pull, pull, rtol=1e-6)


@pytest.mark.parametrize("wrong", ["vertices", "places", "expressions", "NaN"])
def test_what_does_not_fit_the_face_is_refused(tmp_path: Path, result: Result, wrong: str):
    place = np.ones((len(result.vertices) + (wrong == "vertices"), len(PLACES)))
    pull = np.ones((len(PLACES), len(result.expression) + (wrong == "expressions")))
    if wrong == "places":
        place, pull = place[:, :2], pull[:2]
    if wrong == "NaN":
        pull[0, 0] = np.nan
    with_folds(result, place, pull).write_into(tmp_path)
    with pytest.raises(InputError, match="is damaged"):
        Result.load(tmp_path)

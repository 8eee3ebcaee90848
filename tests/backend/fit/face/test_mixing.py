"""Weighted sums of few rows for many points, beside the sum as it is written."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.fit.face.mixing import mixed


@pytest.mark.parametrize("trailing", [(), (3,), (2, 3)])
def test_rows_are_mixed_as_their_weights_say(trailing: tuple[int, ...]):
    random = np.random.default_rng(0)
    values = random.normal(size=(7, *trailing)).astype(np.float32)
    # A row may be named twice.
    index, weights = random.integers(0, 7, (50, 4)), random.random((50, 4))
    gathered = np.einsum("pi,pi...->p...", weights, values[index])
    found = mixed(weights, index, values)
    assert found.shape == gathered.shape
    np.testing.assert_allclose(found, gathered, atol=1e-12)


def test_no_points_are_nothing():
    assert mixed(np.zeros((0, 3)), np.zeros((0, 3), int), np.ones((5, 2))).shape == (0, 2)

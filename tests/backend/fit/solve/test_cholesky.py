"""Factors of matrices that have one, and of those that rounding left without."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import LinAlgError, cho_solve

from facestage.fit.solve.cholesky import firm_cholesky, with_ridge


def test_a_positive_matrix_is_left_as_it_is():
    random = np.random.default_rng(0)
    root = np.tril(random.uniform(0.5, 1.0, (5, 5)))
    np.testing.assert_allclose(np.tril(firm_cholesky(root @ root.T)[0]), root, rtol=1e-10)


@pytest.mark.parametrize(("below", "added"), [(1e-12, 1e-10), (5e-10, 1e-9), (1e-3, 1e-2)])
def test_the_diagonal_grows_tenfold_until_there_is_a_factor(below: float, added: float):
    matrix = np.array([[1.0, 1.0 + below], [1.0 + below, 1.0]])
    solution = cho_solve(firm_cholesky(matrix), np.array([1.0, -1.0]))
    assert solution[0] == pytest.approx(1.0 / (added - below), rel=1e-3)


def test_the_first_growth_is_the_callers():
    matrix = np.array([[1.0, 1.0 + 1e-6], [1.0 + 1e-6, 1.0]])
    solution = cho_solve(firm_cholesky(matrix, first=0.5), np.array([1.0, -1.0]))
    assert solution[0] == pytest.approx(2.0, rel=1e-5)


def test_a_ridge_is_a_share_of_the_largest_eigenvalue():
    np.testing.assert_allclose(with_ridge(np.diag([2.0, 8.0]), 0.25), np.diag([4.0, 10.0]))
    assert (with_ridge(np.zeros((2, 2)), 0.25).diagonal() > 0).all()


def test_what_is_not_finite_has_no_factor():
    with pytest.raises(LinAlgError):
        firm_cholesky(np.array([[1.0, np.inf], [np.inf, 1.0]]))

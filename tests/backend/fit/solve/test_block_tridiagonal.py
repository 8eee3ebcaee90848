"""The block-tridiagonal solver against dense algebra."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.fit.solve.block_tridiagonal import BlockTridiagonal


def random_system(blocks: int, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The whole matrix, its diagonal blocks and those below."""
    random = np.random.default_rng(blocks)
    rows = random.normal(size=(12 * blocks * size, blocks, size))
    for number, row in enumerate(rows):
        first = number % max(blocks - 1, 1)
        row[: max(first, 0)] = 0
        row[first + 2 :] = 0
    flat = rows.reshape(len(rows), -1) * np.geomspace(1e-3, 1e3, blocks * size)
    whole = flat.T @ flat
    cut = whole.reshape(blocks, size, blocks, size)
    each = np.arange(blocks)
    return whole, cut[each, :, each], cut[each[1:], :, each[:-1]]


@pytest.mark.parametrize("blocks", [1, 2, 7])
def test_solution_and_covariance_are_those_of_dense_algebra(blocks: int):
    whole, diagonal, lower = random_system(blocks, 4)
    system = BlockTridiagonal(diagonal, lower)
    right = np.random.default_rng(0).normal(size=(blocks, 4))
    scale = np.sqrt(np.diag(whole))
    error = (system.solve(right).ravel() - np.linalg.solve(whole, right.ravel())) * scale
    assert np.abs(error).max() < 1e-7
    inverse = np.linalg.inv(whole).reshape(blocks, 4, blocks, 4)
    own, beside = system.covariance()
    units = scale.reshape(blocks, 4)
    for t in range(blocks):
        np.testing.assert_allclose(
            own[t] * units[t][:, None] * units[t],
            inverse[t, :, t] * units[t][:, None] * units[t],
            atol=1e-8,
        )
        if t + 1 < blocks:
            np.testing.assert_allclose(
                beside[t] * units[t][:, None] * units[t + 1],
                inverse[t, :, t + 1] * units[t][:, None] * units[t + 1],
                atol=1e-8,
            )


def test_what_nothing_says_anything_about_stays_where_it_is():
    _, diagonal, lower = random_system(3, 4)
    diagonal[:, 2] = diagonal[:, :, 2] = 0
    lower[:, 2] = lower[:, :, 2] = 0
    system = BlockTridiagonal(diagonal, lower)
    assert (system.solve(np.ones((3, 4)))[:, 2] == 0).all()
    assert (np.einsum("tii->ti", system.covariance()[0])[:, 2] == 0).all()

"""The block-tridiagonal solver against dense algebra."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.fit.solve.block_tridiagonal import BlockTridiagonal

SIZE, GROUPS = 3, 2
WIDTH = SIZE * GROUPS


def random_system(blocks: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The whole matrix, its diagonal blocks and what ties an unknown to itself."""
    random = np.random.default_rng(blocks)
    rows = random.normal(size=(40, blocks, WIDTH))
    whole = np.zeros((blocks, WIDTH, blocks, WIDTH))
    for t in range(blocks):
        whole[t, :, t] = rows[:, t].T @ rows[:, t]
    for t in range(blocks - 1):
        for u in range(SIZE):
            tied = np.zeros((blocks, GROUPS, SIZE))
            tied[t : t + 2, :, u] = 5 * random.normal(size=(2, GROUPS))
            whole += np.einsum("ai,bj->aibj", *2 * [tied.reshape(blocks, WIDTH)])
    units = np.geomspace(1e-3, 1e3, blocks * WIDTH)
    whole = whole.reshape(len(units), -1) * units[:, None] * units
    return whole, *parts(whole, blocks)


def parts(whole: np.ndarray, blocks: int) -> tuple[np.ndarray, np.ndarray]:
    """Of a matrix, the diagonal blocks, and of those below what is between an unknown and
    itself.
    """
    cut = whole.reshape(blocks, WIDTH, blocks, WIDTH)
    each = np.arange(blocks)
    return cut[each, :, each], alone(cut[each[1:], :, each[:-1]])


def alone(cut: np.ndarray) -> np.ndarray:
    return np.einsum("tiuju->tiju", cut.reshape(-1, GROUPS, SIZE, GROUPS, SIZE))


@pytest.mark.parametrize("held", [0, 7])
@pytest.mark.parametrize("blocks", [1, 2, 7])
def test_solution_and_covariance_are_those_of_dense_algebra(blocks: int, held: int):
    whole, diagonal, ties = random_system(blocks)
    random = np.random.default_rng(1)
    free = np.ones((blocks, WIDTH), bool)
    free.ravel()[random.choice(free.size, min(held, free.size - 1), replace=False)] = False
    system = BlockTridiagonal(iter(diagonal), ties, free)
    right = random.normal(size=(blocks, WIDTH))
    some = np.flatnonzero(free)
    inverse = np.zeros_like(whole)
    inverse[np.ix_(some, some)] = np.linalg.inv(whole[np.ix_(some, some)])
    scale = np.sqrt(np.diag(whole))
    error = (system.solve(right).ravel() - inverse @ right.ravel()) * scale
    assert np.abs(error).max() < 1e-7
    unitless = inverse * scale[:, None] * scale
    wanted = unitless.reshape(blocks, WIDTH, blocks, WIDTH)
    own, beside = system.covariance()
    units = scale.reshape(blocks, GROUPS, SIZE)
    each = np.arange(blocks)
    found = own * units[:, :, None] * units[:, None]
    np.testing.assert_allclose(found, alone(wanted[each, :, each]), atol=1e-8)
    found = system.diagonal_blocks() * scale.reshape(blocks, -1, 1) * scale.reshape(blocks, 1, -1)
    np.testing.assert_allclose(found, wanted[each, :, each], atol=1e-8)
    found = beside * units[1:, :, None] * units[:-1, None]
    np.testing.assert_allclose(found, alone(wanted[each[1:], :, each[:-1]]), atol=1e-8)


def test_what_nothing_says_anything_about_stays_where_it_is():
    _, diagonal, ties = random_system(3)
    diagonal[:, 2] = diagonal[:, :, 2] = diagonal[:, 5] = diagonal[:, :, 5] = 0
    ties[..., 2] = 0
    system = BlockTridiagonal(diagonal, ties, np.ones((3, WIDTH), bool))
    assert (system.solve(np.ones((3, WIDTH)))[:, 2] == 0).all()
    own, beside = system.covariance()
    assert (own[..., 2] == 0).all()
    assert (beside[..., 2] == 0).all()


def test_a_cut_parts_what_is_before_it_from_what_is_after():
    _, diagonal, ties = random_system(4)
    ties[1] = 0
    right = np.random.default_rng(2).normal(size=(4, WIDTH))
    free = np.ones((4, WIDTH), bool)
    found = BlockTridiagonal(diagonal, ties, free).solve(right)
    alone_found = BlockTridiagonal(diagonal[2:], ties[2:], free[2:]).solve(right[2:])
    np.testing.assert_array_equal(found[2:], alone_found)

"""The bounded damped step against scipy, and the damping's rules."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from facestage.fit.solve.bounded_step import DAMPING_MAX, DAMPING_MIN, GROWTH, Damping, bounded_step

INFINITE = np.full(64, np.inf)


def problem(
    seed: int, size: int, rows: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Jacobian, residual and bounds of a random least-squares problem around values 0.."""
    random = np.random.default_rng(seed)
    jacobian = random.normal(size=(rows, size)) * np.exp(random.normal(size=size))
    residual = random.normal(size=rows)
    low = np.where(random.random(size) < 0.7, -np.exp(random.normal(size=size) - 2), -np.inf)
    high = np.where(random.random(size) < 0.7, np.exp(random.normal(size=size) - 2), np.inf)
    return jacobian, residual, low, high


def quadratic(hessian: np.ndarray, gradient: np.ndarray, step: np.ndarray) -> float:
    return float(gradient @ step + 0.5 * step @ hessian @ step)


@given(st.integers(0, 2**16), st.integers(1, 20))
def test_without_bounds_it_is_the_newton_step(seed: int, size: int):
    jacobian, residual, _, _ = problem(seed, size, size + 8)
    hessian, gradient = jacobian.T @ jacobian, jacobian.T @ residual
    found = bounded_step(
        hessian,
        gradient,
        0.0,
        np.zeros(size),
        -INFINITE[:size],
        INFINITE[:size],
        np.ones(size, bool),
    )
    wanted = np.linalg.lstsq(jacobian, -residual, rcond=None)[0]
    np.testing.assert_allclose(found.step, wanted, rtol=1e-6, atol=1e-9)
    assert found.predicted == pytest.approx(-quadratic(hessian, gradient, wanted), rel=1e-6)


@settings(max_examples=60)
@given(st.integers(0, 2**16), st.integers(20, 60), st.sampled_from([1e-6, 1e-3, 1e-1]))
def test_within_bounds_it_is_close_to_the_best(seed: int, size: int, damping: float):
    """Feasible, downhill, and most of the way to what scipy's exact bounded solver reaches."""
    jacobian, residual, low, high = problem(seed, size, 2 * size)
    hessian, gradient = jacobian.T @ jacobian, jacobian.T @ residual
    found = bounded_step(hessian, gradient, damping, np.zeros(size), low, high, np.ones(size, bool))
    assert (found.step >= low).all() and (found.step <= high).all()
    # The damped problem as least squares: extra rows sqrt(damping * diagonal).
    damped = hessian + damping * np.diag(np.diag(hessian))
    rows = np.concatenate([jacobian, np.diag(np.sqrt(damping * np.diag(hessian)))])
    best = lsq_linear(
        rows, np.concatenate([-residual, np.zeros(size)]), (low, high), method="bvls"
    ).x
    ratio = quadratic(damped, gradient, found.step) / quadratic(damped, gradient, best)
    assert ratio > 0.5, f"only {ratio:.2f} of the possible decrease"
    assert ratio < 1 + 1e-6


def test_quality_over_many_random_problems():
    ratios = []
    for seed in range(300):
        jacobian, residual, low, high = problem(seed, 10, 16)
        hessian, gradient = jacobian.T @ jacobian, jacobian.T @ residual
        found = bounded_step(hessian, gradient, 0.0, np.zeros(10), low, high, np.ones(10, bool))
        best = lsq_linear(jacobian, -residual, (low, high), method="bvls").x
        ratios.append(quadratic(hessian, gradient, found.step) / quadratic(hessian, gradient, best))
    worst, median, uphill = (
        np.percentile(ratios, 5),
        np.median(ratios),
        np.mean(np.array(ratios) < 0),
    )
    print(
        f"share of the best decrease: median {median:.4f}, 5th percentile {worst:.3f}; uphill "
        f"{100 * uphill:.1f} %"
    )
    # Entries that cross together are bound together, so that a large problem takes few rounds:
    # good, not best. A step uphill is refused, and a larger damping makes the problem separable.
    assert median > 0.99 and worst > 0.5 and uphill < 0.03


@given(st.integers(0, 2**16))
def test_separable_problems_are_solved_exactly(seed: int):
    random = np.random.default_rng(seed)
    diagonal, gradient = np.exp(random.normal(size=9)), random.normal(size=9)
    low, high = -random.random(9), random.random(9)
    found = bounded_step(np.diag(diagonal), gradient, 0.0, np.zeros(9), low, high, np.ones(9, bool))
    np.testing.assert_allclose(found.step, np.clip(-gradient / diagonal, low, high), rtol=1e-9)


@given(st.integers(0, 2**16))
def test_only_active_entries_move_and_entries_at_a_bound_stay_inside(seed: int):
    random = np.random.default_rng(seed)
    jacobian, residual, _, _ = problem(seed, 12, 20)
    values = random.random(12)
    values[:4] = 0.0
    values[4:6] = 1.0
    active = random.random(12) > 0.3
    found = bounded_step(
        jacobian.T @ jacobian,
        jacobian.T @ residual,
        1e-3,
        values,
        np.zeros(12),
        np.ones(12),
        active,
    )
    assert not found.step[~active].any()
    after = values + found.step
    assert (after >= 0).all() and (after <= 1).all()


def test_an_unobserved_parameter_stays_and_two_equal_columns_do_no_harm():
    random = np.random.default_rng(1)
    jacobian = random.normal(size=(20, 4))
    jacobian[:, 1] = 0.0
    jacobian[:, 3] = jacobian[:, 2]
    found = bounded_step(
        jacobian.T @ jacobian,
        jacobian.T @ random.normal(size=20),
        1e-6,
        np.zeros(4),
        -INFINITE[:4],
        INFINITE[:4],
        np.ones(4, bool),
    )
    assert np.isfinite(found.step).all() and found.step[1] == 0.0 and found.predicted > 0
    assert found.step[2] == pytest.approx(found.step[3])
    assert found.condition > 1e3


def test_an_indefinite_matrix_still_gives_a_step():
    hessian = np.array([[1.0, 1 + 1e-9], [1 + 1e-9, 1.0]])
    found = bounded_step(
        hessian,
        np.array([1.0, -1.0]),
        0.0,
        np.zeros(2),
        -INFINITE[:2],
        INFINITE[:2],
        np.ones(2, bool),
    )
    assert np.isfinite(found.step).all() and np.isfinite(found.condition)


def test_damping_shortens_the_step_whatever_the_units():
    jacobian, residual, _, _ = problem(3, 6, 20)
    steps = []
    for units in (np.ones(6), 10.0 ** np.arange(-3, 3)):
        scaled = jacobian * units
        for damping in (1e-6, 1.0, 100.0):
            found = bounded_step(
                scaled.T @ scaled,
                scaled.T @ residual,
                damping,
                np.zeros(6),
                -INFINITE[:6],
                INFINITE[:6],
                np.ones(6, bool),
            )
            steps.append(found.step * units)
    np.testing.assert_allclose(steps[:3], steps[3:], rtol=1e-6)
    lengths = [np.linalg.norm(step) for step in steps[:3]]
    assert lengths[0] > lengths[1] > lengths[2]


@given(st.integers(0, 2**16))
def test_only_the_distance_to_the_bounds_counts(seed: int):
    """Values that are not 0 move as if they were, with the bounds moved along."""
    jacobian, residual, low, high = problem(seed, 12, 20)
    hessian, gradient = jacobian.T @ jacobian, jacobian.T @ residual
    values = np.random.default_rng(seed).normal(size=12)
    every = np.ones(12, bool)
    found = bounded_step(hessian, gradient, 1e-3, values, low + values, high + values, every)
    wanted = bounded_step(hessian, gradient, 1e-3, np.zeros(12), low, high, every)
    np.testing.assert_allclose(found.step, wanted.step, rtol=1e-6, atol=1e-9)
    assert found.predicted == pytest.approx(wanted.predicted, rel=1e-6, abs=1e-9)


def test_a_run_starts_almost_undamped():
    assert Damping() == Damping(1e-3, 8.0)
    assert (DAMPING_MIN, DAMPING_MAX) == (1e-9, 1e9)


def test_nothing_active_is_no_step():
    found = bounded_step(
        np.eye(3), np.ones(3), 1e-3, np.zeros(3), -np.ones(3), np.ones(3), np.zeros(3, bool)
    )
    assert not found.step.any() and found.predicted == 0 and found.condition == 1.0


def test_damping_follows_the_gain():
    damping = Damping()
    start = damping.value
    damping.accept(1.0)
    assert damping.value == pytest.approx(start / 3)
    damping.accept(0.5)
    assert damping.value == pytest.approx(start / 3)
    damping.accept(0.0)
    assert damping.value == pytest.approx(2 * start / 3)
    before = damping.value
    damping.reject()
    assert damping.value == GROWTH * before and damping.growth == 2 * GROWTH
    damping.reject()
    assert damping.value == 2 * GROWTH**2 * before
    damping.accept(1.0)
    assert damping.growth == GROWTH
    for _ in range(200):
        damping.accept(1.0)
    assert damping.value == DAMPING_MIN
    for _ in range(200):
        damping.reject()
    assert damping.value == DAMPING_MAX

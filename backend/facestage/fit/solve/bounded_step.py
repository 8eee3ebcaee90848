"""Damped Gauss-Newton (Levenberg-Marquardt) with bounds on the parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve

from facestage.fit.solve.cholesky import firm_cholesky

DAMPING_START, DAMPING_MIN, DAMPING_MAX = 1e-3, 1e-9, 1e9
# The scaled system has a unit diagonal, so a factor of two in a small damping changes nothing.
GROWTH = 8.0
ACTIVE_SET_ROUNDS = 12


@dataclass
class Damping:
    """Levenberg-Marquardt damping, steered by the gain ratio (Madsen, Nielsen & Tingleff 2004, alg.
    3.16).
    """

    value: float = DAMPING_START
    growth: float = GROWTH

    def accept(self, gain: float) -> None:
        """After a step whose actual over predicted decrease was ``gain``."""
        self.value = max(self.value * max(1 / 3, 1 - (2 * min(gain, 2.0) - 1) ** 3), DAMPING_MIN)
        self.growth = GROWTH

    def reject(self) -> None:
        """After a step that did not lower the energy."""
        self.value = min(self.value * self.growth, DAMPING_MAX)
        self.growth *= 2.0


@dataclass(frozen=True)
class Step:
    """A proposed step, the decrease the quadratic model predicts, and the system's condition
    number.
    """

    step: np.ndarray
    predicted: float
    condition: float


def bounded_step(
    hessian: np.ndarray,
    gradient: np.ndarray,
    damping: float,
    values: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    active: np.ndarray,
) -> Step:
    """Minimise the damped quadratic over ``active`` entries within bounds, by an active set.

    Entries whose step would cross a bound are put on it and taken out, the rest is solved again;
    so each round is one Cholesky factorisation of a symmetric positive definite matrix.
    """
    step = np.zeros_like(values)
    free = active.copy()
    at_bound = ((values <= low) & (gradient > 0)) | ((values >= high) & (gradient < 0))
    free &= ~at_bound
    diagonal = np.diag(hessian)
    # A parameter that nothing observes has a zero row; it stays where it is.
    free &= diagonal > 0
    condition = 1.0
    for _ in range(ACTIVE_SET_ROUNDS):
        index = np.flatnonzero(free)
        if not len(index):
            break
        scale = 1.0 / np.sqrt(diagonal[index])
        fixed = np.flatnonzero(active & ~free & (step != 0))
        right = -gradient[index] - (
            hessian[np.ix_(index, fixed)] @ step[fixed] if len(fixed) else 0.0
        )
        # Scaled to a unit diagonal, so damping and condition number do not depend on units.
        matrix = hessian[np.ix_(index, index)] * scale[:, None] * scale[None, :]
        matrix[np.diag_indices_from(matrix)] += damping
        solution, condition = _solve(matrix, right * scale)
        solution *= scale
        target = values[index] + solution
        outside = (target < low[index]) | (target > high[index])
        step[index] = solution
        if not outside.any():
            break
        crossed = index[outside]
        step[crossed] = (
            np.clip(values[crossed] + step[crossed], low[crossed], high[crossed]) - values[crossed]
        )
        free[crossed] = False
    step = np.clip(values + step, low, high) - values
    predicted = -float(gradient @ step + 0.5 * step @ hessian @ step)
    return Step(step, predicted, condition)


def _solve(matrix: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, float]:
    """Solution and a condition estimate."""
    factor = firm_cholesky(matrix)
    diagonal = np.abs(np.diag(factor[0]))
    condition = float((diagonal.max() / diagonal.min()) ** 2)
    return cho_solve(factor, right, check_finite=False), condition

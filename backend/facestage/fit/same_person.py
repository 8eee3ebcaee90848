"""Whether the landmarks of several photos can be of one person.

Each photo's landmark stage, alone, ends at an identity m_k with the information J_k that its landmarks hold of it, pose
and expression unknown. If all photos show one person, the others' landmarks predict what photo k's own say: the
difference, measured in its standard deviations over the modes that its landmarks tell something of, is chi-squared.
A model fits no real face exactly, and who marks landmarks errs alike on points of a kind; hence the margin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from facestage.fit.parameters import Layout
from facestage.fit.schedule import Iteration
from facestage.fit.uncertainty import marginal_hessian

# Chance of so large a difference between photos of one person.
CHANCE = 1e-3
# How much larger than chance alone explains a difference must be to speak of another person.
MARGIN = 1.5
# Information, relative to the prior's, below which a mode is not compared: its landmarks say nothing of it.
INFORMED = 1.0


@dataclass(frozen=True)
class Evidence:
    """What one photo's landmarks say of the identity, and the prior, as quadratic terms."""

    identity: np.ndarray  # (k,) where the landmark stage ended
    information: np.ndarray  # (k, k) of the landmarks alone
    prior: np.ndarray  # (k, k)

    @classmethod
    def of(cls, last: Iteration, free: np.ndarray) -> Evidence:
        """From the last step of a photo's own landmark stage; ``free`` (size,) bool marks what was fitted."""
        where = Layout(last.state).slices["identity"]
        kept = np.arange(where.start, where.stop)
        prior = last.prior_hessian[where, where]
        return cls(last.state.identity, marginal_hessian(last.hessian, kept, free) - prior, prior)

    @property
    def pull(self) -> np.ndarray:
        """(k,) the linear term: information times what the landmarks alone would have."""
        return np.asarray((self.information + self.prior) @ self.identity)


@dataclass(frozen=True)
class Difference:
    """How far a photo's landmarks are from what the other photos predict."""

    statistic: float
    limit: float

    @property
    def doubtful(self) -> bool:
        """True when chance does not explain the difference."""
        return self.statistic > self.limit


def combined(evidence: Sequence[Evidence]) -> tuple[np.ndarray, np.ndarray]:
    """Identity (k,) and its covariance (k, k) given the landmarks of all of ``evidence``; the prior counts once."""
    covariance = np.linalg.inv(evidence[0].prior + sum(one.information for one in evidence))
    return covariance @ sum(one.pull for one in evidence), covariance


def difference(one: Evidence, others: Sequence[Evidence]) -> Difference:
    """Of a photo to at least one other."""
    expected, covariance = combined(others)
    # In units of the prior, whose weight the job may choose.
    level = float(np.diag(one.prior).mean())
    values, modes = np.linalg.eigh(one.information)
    modes = modes[:, values > INFORMED * level]
    if not modes.shape[1]:
        return Difference(0.0, np.inf)
    surprise = modes.T @ (one.pull - one.information @ expected)
    spread = modes.T @ (one.information @ covariance @ one.information + one.information) @ modes
    statistic = float(surprise @ np.linalg.solve(spread, surprise))
    return Difference(statistic, MARGIN * float(chi2.ppf(1.0 - CHANCE, modes.shape[1])))


def odd_ones(evidence: Sequence[Evidence]) -> dict[int, Difference]:
    """The photos that do not go with the rest, the oddest first; of two that do not go together, both."""
    found: dict[int, Difference] = {}
    left = list(range(len(evidence)))
    while len(left) > 1:
        differences = {
            index: difference(evidence[index], [evidence[other] for other in left if other != index]) for index in left
        }
        worst = max(left, key=lambda index: differences[index].statistic / differences[index].limit)
        if not differences[worst].doubtful:
            break
        if len(left) == 2:
            found |= differences
            break
        found[worst] = differences[worst]
        left.remove(worst)
    return found

"""Whether the landmarks of several photos can be of one person.

Each photo's landmark phases, alone, end at an identity m_k with the information J_k that its
landmarks hold of it, pose and expression unknown. If all photos show one person, the others'
landmarks predict what photo k's own say. How far off that is, squared and in standard deviations
over the modes that its landmarks tell something of, in units of how badly each photo's own face
fits its landmarks, is an F statistic: careless landmarks are not taken for another face.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtri

from facestage.fit.energy.landmark_term import LandmarkTerm
from facestage.fit.face.layout import Layout
from facestage.fit.solve.covariance import marginal_hessian
from facestage.fit.stages.photo_descent import Iteration, PhotoDescent
from facestage.fit.trust.guard import landmark_energy

# Chance of so large a difference between photos of one person.
CHANCE = 1e-3
# Information, relative to the prior's, below which a mode is not compared: its landmarks say
# nothing of it.
INFORMED = 1.0
POSE_PARAMETERS = 6


@dataclass(frozen=True)
class Evidence:
    """What one photo's landmarks say of the identity, and the prior, as quadratic terms."""

    identity: np.ndarray  # (k,) where the landmark phases ended
    information: np.ndarray  # (k, k) of the landmarks alone
    prior: np.ndarray  # (k, k)
    misfit: float = 0.0  # twice the energy that landmarks and priors are left with
    freedom: int = 1  # residuals less parameters; priors count as residuals

    @classmethod
    def of(cls, last: Iteration, descent: PhotoDescent) -> Evidence:
        """From the last step of a photo's own landmark phases."""
        where = Layout(last.state).slices["identity"]
        kept = np.arange(where.start, where.stop)
        prior = last.prior_hessian[where, where]
        information = marginal_hessian(last.hessian, kept, descent.active) - prior
        seen = int(np.isfinite(descent.energy.term(LandmarkTerm).sigma).sum())
        misfit = 2.0 * landmark_energy(descent.energy, last.state)
        return cls(
            last.state.identity, information, prior, misfit, max(2 * seen - POSE_PARAMETERS, 1)
        )

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
    """Identity (k,) and its covariance (k, k) given the landmarks of all of ``evidence``; the prior
    counts once.
    """
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
    count, everyone = modes.shape[1], [one, *others]
    freedom = sum(each.freedom for each in everyone)
    scale = max(sum(each.misfit for each in everyone) / freedom, 1e-12)
    statistic = float(surprise @ np.linalg.solve(spread, surprise)) / scale
    return Difference(statistic, count * float(fdtri(count, freedom, 1.0 - CHANCE)))


def odd_ones(evidence: Sequence[Evidence]) -> dict[int, Difference]:
    """The photos that do not go with the rest, the oddest first; of two that do not go together,
    both.
    """
    found: dict[int, Difference] = {}
    left = list(range(len(evidence)))
    while len(left) > 1:
        differences = {
            index: difference(
                evidence[index], [evidence[other] for other in left if other != index]
            )
            for index in left
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

"""Whether several photos can be of one person.

Each photo's landmark phases, alone, end at an identity m_k with the information J_k that its
landmarks hold of it, pose and expression unknown. If all photos show one person, the others'
landmarks predict what photo k's own say. How far off that is, squared and in standard deviations
over the modes that its landmarks tell something of, in units of how badly each photo's own face
fits its landmarks, is an F statistic: careless landmarks are not taken for another face.

A finder of landmarks errs the same way on one face and another way on the same face turned, which
the statistic takes for another face. Skin knows better: moles, pores and brows that lie on each
other in two photos are one person's, whatever the landmarks say.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import fdtri

from facestage.contract.landmarks import MEDIAPIPE
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
# Share of the places with texture from which on two photos show one skin, share below which they
# show two, and how many places that takes. Measured at each photo's own landmarks: one scanned head
# in three lights 0.43 to 0.85, four photos of a rendered person 0.35 to 0.81, another one 0.75;
# different people 0.05 to 0.17, rendered ones that share their brows and lips 0.26 to 0.39. Noise
# hides skin: two grey levels of 255 make 0.20 of 0.43, and then nobody knows.
ALIKE_MIN, OTHER_MAX, PLACES_MIN = 0.42, 0.2, 100
# By how much the statistic of landmarks that a network found exceeds its limit between photos of
# one person, at most (1.1 to 3.5 times, as above); of landmarks with independent errors, not.
FOUND_EXCESS = 4.0


@dataclass(frozen=True)
class Evidence:
    """What one photo's landmarks say of the identity, and the prior, as quadratic terms."""

    identity: np.ndarray  # (k,) where the landmark phases ended
    information: np.ndarray  # (k, k) of the landmarks alone
    prior: np.ndarray  # (k, k)
    misfit: float = 0.0  # twice the energy that landmarks and priors are left with
    freedom: int = 1  # residuals less parameters; priors count as residuals
    excess: float = 1.0  # by how much its errors may exceed those of independent landmarks

    @classmethod
    def of(cls, last: Iteration, descent: PhotoDescent) -> Evidence:
        """From the last step of a photo's own landmark phases."""
        where = Layout(last.state).slices["identity"]
        kept = np.arange(where.start, where.stop)
        prior = last.prior_hessian[where, where]
        information = marginal_hessian(last.hessian, kept, descent.active) - prior
        seen = int(np.isfinite(descent.energy.term(LandmarkTerm).sigma).sum())
        misfit = 2.0 * landmark_energy(descent.energy, last.state)
        found = descent.energy.term(LandmarkTerm).landmarks.scheme == MEDIAPIPE
        return cls(
            last.state.identity,
            information,
            prior,
            misfit,
            max(2 * seen - POSE_PARAMETERS, 1),
            # Nobody sets so many points by hand.
            FOUND_EXCESS if found else 1.0,
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


@dataclass(frozen=True)
class Likeness:
    """How far the skins of two photos agree."""

    places: int  # where both show texture
    share: float  # of these that could be matched

    @property
    def alike(self) -> bool:
        """Whether it is one person's skin."""
        return self.places >= PLACES_MIN and self.share >= ALIKE_MIN

    @property
    def other(self) -> bool:
        """Whether they are different skins, or at least look so."""
        return self.places >= PLACES_MIN and self.share < OTHER_MAX


# By the indices of two photos, the lower first.
Likenesses = Mapping[tuple[int, int], Likeness]


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


def odd_ones(
    evidence: Sequence[Evidence], skins: Likenesses | None = None
) -> dict[int, Difference]:
    """The photos that do not go with the rest, the oddest first; of two that do not go together,
    both. ``skins``: None where nobody looked at them, and landmarks are believed alone.
    """
    found: dict[int, Difference] = {}
    left = list(range(len(evidence)))
    while len(left) > 1:
        differences = {}
        for index in left:
            others = [other for other in left if other != index]
            alone = difference(evidence[index], [evidence[other] for other in others])
            if skins is not None:
                pairs = {tuple(sorted((index, other))) for other in others}
                seen = [skin for pair, skin in skins.items() if pair in pairs]
                alone = _beside(alone, evidence[index].excess, seen)
            differences[index] = alone
        worst = max(left, key=lambda index: differences[index].statistic / differences[index].limit)
        if not differences[worst].doubtful:
            break
        if len(left) == 2:
            found |= differences
            break
        found[worst] = differences[worst]
        left.remove(worst)
    return found


def _beside(landmarks: Difference, excess: float, skins: Sequence[Likeness]) -> Difference:
    """What the landmarks say of a photo, knowing how alike its skin is to the others'."""
    if any(skin.alike for skin in skins):
        return replace(landmarks, limit=np.inf)
    if any(skin.other for skin in skins):
        return landmarks
    return replace(landmarks, limit=excess * landmarks.limit)

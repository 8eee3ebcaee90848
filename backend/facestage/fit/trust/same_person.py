"""Whether several photos can be of one person.

Each photo's landmark phases, alone, end at an identity m_k with the information J_k that its
landmarks hold of it, pose and expression unknown. How likely the landmarks of some photos are of
one identity, whichever the prior allows, is the integral of a Gaussian over it: the evidence
(MacKay 1992, "Bayesian interpolation"). That of all photos, against that of one photo and of the
others apart, is the Bayes factor between one person and two. What the prior already says of all
faces, and modes that the landmarks do not tell, speak neither way, so no limit depends on their
number.

A network's errors are alike at points that lie near each other, so that a face may fit its
landmarks far better than they are worth: landmarks count as much as they are taken to be worth,
and less where their own face fits them worse than that.

Skin knows better: moles, pores and brows that lie on each other in two photos are one person's,
whatever the landmarks say. That they do not says little: another expression, another year and
another lens hide the same skin.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from facestage.fit.energy.landmark_term import LandmarkTerm
from facestage.fit.face.layout import Layout
from facestage.fit.solve.covariance import marginal_hessian
from facestage.fit.stages.photo_descent import Iteration, PhotoDescent
from facestage.fit.trust.guard import landmark_energy

POSE_PARAMETERS = 6
# Nats by which two people must be likelier than one, and by which landmarks must say less of one
# person than they do on average: those that tell little doubt nobody. One photo in a hundred of one
# person is doubted where errors are as assumed. Measured of pairs of photos of one person: 3.1 to
# 10.3 where 3 to 6 are the mean (landmarks given or found; rendered people, a scan, portraits of a
# president years and smiles apart); of two people -20 to 10, because many faces are alike as far as
# landmarks tell.
AGAINST, SURPRISE = 1.0, 4.0
# Share of the places with texture from which on two photos show one skin, and how many places that
# takes. Measured at each photo's own landmarks: one scanned head in three lights 0.43 to 0.85, four
# photos of a rendered person 0.35 to 0.81, another one 0.75, portraits years apart 0.08 to 0.10;
# different people 0 to 0.17, rendered ones that share their brows and lips 0.26 to 0.39.
ALIKE_MIN, PLACES_MIN = 0.42, 100


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
    """How likely a photo's landmarks are of the face that the other photos show."""

    nats: float  # logarithm of the Bayes factor of one person to two
    told: float  # its mean over photos of one person

    @property
    def doubtful(self) -> bool:
        """True when two people are likelier than one, and chance does not explain it."""
        return self.nats < min(-AGAINST, self.told - SURPRISE)


@dataclass(frozen=True)
class Likeness:
    """How far the skins of two photos agree."""

    places: int  # where both show texture
    share: float  # of these that could be matched

    @property
    def alike(self) -> bool:
        """Whether it is one person's skin."""
        return self.places >= PLACES_MIN and self.share >= ALIKE_MIN


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
    together, alone, apart = _evidence([one, *others]), _evidence([one]), _evidence(others)
    told = alone.spread + apart.spread - together.spread
    fit = together.explained - alone.explained - apart.explained
    return Difference(fit + told, told)


class _LogEvidence(NamedTuple):
    """Of photos that show one identity, less what does not depend on which are taken together."""

    explained: float  # by the identity that fits them best
    spread: float  # of what the prior allows, lost to the landmarks


def _evidence(photos: Sequence[Evidence]) -> _LogEvidence:
    prior = photos[0].prior
    worth = [1.0 / max(one.misfit / one.freedom, 1.0) for one in photos]
    information = sum(share * one.information for share, one in zip(worth, photos, strict=True))
    seen = sum(share * one.pull for share, one in zip(worth, photos, strict=True))
    posterior = np.asarray(prior + information)
    spread = np.linalg.slogdet(posterior)[1] - np.linalg.slogdet(prior)[1]
    explained = float(seen @ np.linalg.solve(posterior, seen))
    return _LogEvidence(explained / 2.0, spread / 2.0)


def odd_ones(
    evidence: Sequence[Evidence], skins: Likenesses | None = None
) -> dict[int, Difference]:
    """The photos that do not go with the rest, the oddest first; of two that do not go together,
    both. ``skins``: None where nobody looked at them, and landmarks are believed alone.
    """
    found: dict[int, Difference] = {}
    left = list(range(len(evidence)))
    while len(left) > 1:
        differences = {
            index: difference(
                evidence[index], [evidence[other] for other in left if other != index]
            )
            for index in left
            if not _recognised(index, left, skins or {})
        }
        if not differences:
            break
        worst = min(differences, key=lambda index: differences[index].nats)
        if not differences[worst].doubtful:
            break
        if len(left) == 2:
            found |= differences
            break
        found[worst] = differences[worst]
        left.remove(worst)
    return found


def _recognised(index: int, left: Sequence[int], skins: Likenesses) -> bool:
    """Whether a photo shows the skin of any other of ``left``."""
    return any(
        skin.alike for pair, skin in skins.items() if index in pair and set(pair) <= set(left)
    )

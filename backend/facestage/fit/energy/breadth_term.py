"""The breadth term: how wide the face is at cheekbones, cheeks and jaw.

In a photo from the front the outline is on skin that turns away from the camera. Each of its points
is vague by itself, and where the network's guess counts little it leaves the face to the prior,
which makes wide faces narrow. Their distance from side to side is known.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from facestage.contract.landmarks import Landmarks
from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.energy.pair_distances import PairDistances, pairs_on
from facestage.fit.energy.term import Setup, Term
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.state import State
from facestage.fit.given.face_areas import face_size_px
from facestage.models.anatomy.landmark_schemes import scheme_of

# How far the distance of two points is off, as a share of the face's size, and how many of the
# pairs err independently.
SIGMA_SHARE, INDEPENDENT = 0.025, 3.0
# Sines of the angle by which the head is turned aside, up to which both sides of the outline show,
# and from which on one is a guess.
BOTH_SHOW, ONE_SHOWS = 0.25, 0.45


@dataclass(frozen=True, eq=False)
class Breadths(PairDistances):
    """The breadths of a face that looks at the camera."""

    name: ClassVar = "breadth"


@dataclass(frozen=True, eq=False)
class BreadthTerm(Term):
    """The breadths, as far as the face looks at the camera."""

    words: ClassVar = {"breadth": "Breadth of the face"}

    breadths: Breadths

    @classmethod
    def of(cls, setup: Setup) -> Self | None:
        """Of phases that move identity, where landmarks know the outline: a lens alone shall not
        explain how wide a face is.
        """
        if not setup.moves(("identity",)):
            return None
        landmarks = setup.problem.landmarks_at(setup.factor)
        return cls.seen(setup.problem.geometry, landmarks, setup.problem.job.weights.landmarks)

    @classmethod
    def seen(cls, geometry: FaceGeometry, landmarks: Landmarks, weight: float = 1.0) -> Self | None:
        """The breadths that ``landmarks`` show; None where they show none."""
        pairs = scheme_of(landmarks.scheme).breadths
        # Whether a point of the outline shows is a matter of a hair's breadth: here all count.
        counted = np.isfinite(landmarks.points).all(axis=1)
        if landmarks.weights is not None:
            counted &= landmarks.weights > 0
        pairs = pairs[counted[pairs].all(axis=1)]
        if not len(pairs):
            return None
        first, second = np.moveaxis(landmarks.points[pairs], 1, 0)
        apart = np.linalg.norm(first - second, axis=1)
        sigma = SIGMA_SHARE * face_size_px(landmarks)
        along = (first - second) / np.maximum(apart, 1e-6)[:, None] / sigma
        on_face = pairs_on(geometry, landmarks.scheme, pairs)
        share = INDEPENDENT / len(pairs)
        return cls(Breadths(on_face, along, apart / sigma, share, weight))

    def at(self, state: State, evaluation: Evaluation | None = None) -> Breadths | None:
        """None for a head that is turned aside."""
        to_camera = -state.translation / max(float(np.linalg.norm(state.translation)), 1e-9)
        aside = abs(float(state.rotation[:, 0] @ to_camera))
        shown = float(np.clip((ONE_SHOWS - aside) / (ONE_SHOWS - BOTH_SHOW), 0.0, 1.0))
        return replace(self.breadths, weight=shown * self.breadths.weight) if shown else None

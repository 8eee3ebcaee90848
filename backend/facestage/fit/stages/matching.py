"""Between the photos of a phase: which of them are compared, at which size, and the stereo term
that follows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.spatial.transform import Rotation

from facestage.contract.arrays import Bool
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import SURFACE
from facestage.fit.given.problem import FINE_FACE_PX
from facestage.fit.stages.passage import Passage
from facestage.fit.stages.view import View
from facestage.fit.stereo.matches import Comparison, Matches, compare
from facestage.fit.stereo.overlap import Sight
from facestage.fit.stereo.stereo_term import Pair, StereoTerm
from facestage.images.image_io import resize

# Degrees between two photos that tell depth best: further apart they show less of the same skin,
# nearer they differ by less. Each photo is compared with so many others, and none so far away.
BEST_ANGLE, ANGLE_MAX, PARTNERS_MAX = 30.0, 75.0, 3

REACH_MIN = 2  # pixels, whatever the size of the face


@dataclass(frozen=True)
class Look:
    """How closely photos are compared."""

    face_px: float  # size of the face, at most
    reach: int  # pixels of such a face that they may be off
    # standard deviation, as a share of the face's size, of what matches are not good for
    floor: float


# From the landmarks' shapes, which are off by some per cent of the face, to what matching is good
# for: 0.15 pixels on a face of 160, of what a face model leaves of a scan at 40 degrees' parallax.
# Relief follows matches by a part at a time: three looks are that close.
LOOKS = (
    Look(FINE_FACE_PX, 8, 0.006),
    Look(FINE_FACE_PX, 5, 0.0025),
    Look(2 * FINE_FACE_PX, 4, 0.00125),
    Look(2 * FINE_FACE_PX, 3, 0.001),
    Look(2 * FINE_FACE_PX, 3, 0.001),
    Look(2 * FINE_FACE_PX, 3, 0.001),
)
CLOSEST = LOOKS[-1]


def stereo_between(photos: Sequence[Passage], look: Look) -> StereoTerm | None:
    """What photos where they begin a phase say of each other; None where that is nothing, or the
    phase does not move the shape.
    """
    views, states = [photo.view for photo in photos], [photo.state for photo in photos]
    weight = views[0].problem.job.weights.photo
    if set(SURFACE).isdisjoint(photos[0].phase.blocks) or not weight:
        return None
    factors = [photo.view.factor(photo.phase) for photo in photos]
    scales = _scales(views, look)
    pairs = []
    for (a, b), compared in compared_photos(views, states, look).items():
        if compared.matches is not None:
            matches = compared.matches.scaled(factors[a] / scales[a], factors[b] / scales[b])
            pairs.append(Pair(a, b, views[a].forward, _shared(matches, len(views))))
    if not pairs:
        return None
    floors = [
        look.floor * view.problem.face_size_px * factor
        for view, factor in zip(views, factors, strict=True)
    ]
    return StereoTerm(tuple(pairs), tuple(floors), weight)


def compared_photos(
    views: Sequence[View], states: Sequence[State], look: Look
) -> dict[tuple[int, int], Comparison]:
    """By the places of two photos, what they have in common with the faces at ``states``, at the
    size of the smaller face.
    """
    scales = _scales(views, look)
    sights = [_sight(*one) for one in zip(views, states, scales, strict=True)]
    size = scales[0] * views[0].problem.face_size_px
    reach = max(round(look.reach * size / look.face_px), REACH_MIN)
    return {
        (a, b): compare(sights[a], sights[b], reach)
        for a, b in partners([state.rotation for state in states])
    }


def _scales(views: Sequence[View], look: Look) -> list[float]:
    """What brings each photo's face to the size that they are compared at."""
    size = min(look.face_px, *(view.problem.face_size_px for view in views))
    return [view.problem.scale(size) for view in views]


def partners(rotations: Sequence[np.ndarray]) -> list[tuple[int, int]]:
    """Which photos are compared, by the heads' rotations: each with those that tell most."""
    angles = {
        (a, b): float(np.degrees(Rotation.from_matrix(rotations[b] @ rotations[a].T).magnitude()))
        for a, b in combinations(range(len(rotations)), 2)
    }
    best = sorted(
        (pair for pair, angle in angles.items() if angle <= ANGLE_MAX),
        key=lambda pair: abs(angles[pair] - BEST_ANGLE),
    )
    chosen = set()
    for index in range(len(rotations)):
        chosen.update([pair for pair in best if index in pair][:PARTNERS_MAX])
    return sorted(chosen)


def _shared(matches: Matches, photos: int) -> Matches:
    """Of n photos of a place n - 1 displacements are independent, whatever the number of pairs."""
    partners_of_each = min(photos - 1, PARTNERS_MAX)
    return replace(matches, share=matches.share * 2.0 / (partners_of_each + 1))


def _sight(view: View, state: State, scale: float) -> Sight:
    photo = view.visible.at(scale)
    return Sight(
        view.forward,
        replace(state, camera=state.camera.scaled(scale)),
        photo.color,
        photo.usable & _skin(view, photo.skin),
    )


def _skin(view: View, skin: np.ndarray) -> Bool[np.ndarray, "height width"]:
    """Skin, and brows, whose hairs do not move; not what hides the face."""
    height, width = skin.shape
    painted = resize(view.problem.paintable, width, height)
    painted = np.where(view.visible.hidden_at(height, width), 0.0, painted)
    return np.maximum(skin, painted) > 0.5

"""How far the lids are apart in a photo, and whether an eye is shut, as landmarks tell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from facestage.contract.arrays import Float, Int
from facestage.contract.face_model import FaceModel
from facestage.contract.landmarks import Landmarks
from facestage.models.anatomy.landmark_schemes import Eye, scheme_of

# Mean distance of the lids, in shares of the eye's width, at which the network sees an eye that is
# shut, and from which on it does not.
SHUT, OPEN = 0.035, 0.06
# A weight of 1 that leaves no more than this share of the mean face's opening shuts the eye.
LEFT_OPEN = 0.25


@dataclass(frozen=True)
class Lids:
    """One eye in a photo: pairs of a landmark of the upper and one of the lower lid."""

    pairs: Int[np.ndarray, "pairs 2"]
    across: Float[np.ndarray, " 2"]  # unit, from the lower lid to the upper one
    width: float  # pixels from corner to corner
    apart: Float[np.ndarray, " pairs"]  # along ``across``, in shares of the width

    @property
    def shut(self) -> float:
        """0 for an eye that is open, to 1."""
        return float(np.clip((OPEN - self.apart.mean()) / (OPEN - SHUT), 0.0, 1.0))


def seen_lids(landmarks: Landmarks) -> list[Lids | None]:
    """Of each eye of the landmarks' scheme; None where not all of it shows."""
    points, counted = landmarks.points, landmarks.counted
    found: list[Lids | None] = []
    for eye in scheme_of(landmarks.scheme).eyes:
        pairs = np.array(eye.lids)
        if not counted[[*eye.corners, *pairs.ravel()]].all():
            found.append(None)
            continue
        ends = points[eye.corners[1]] - points[eye.corners[0]]
        width = max(float(np.linalg.norm(ends)), 1e-6)
        across = np.array([ends[1], -ends[0]]) / width
        apart = (points[pairs[:, 0]] - points[pairs[:, 1]]) @ across / width
        found.append(Lids(pairs, across, width, apart))
    return found


def open_eyes(landmarks: Landmarks) -> list[tuple[Eye, Lids]]:
    """The eyes of the landmarks' scheme of which lids and iris show."""
    shut = scheme_of(landmarks.scheme).behind_closed_lids(landmarks.points)
    shows = landmarks.counted & ~shut
    eyes = zip(scheme_of(landmarks.scheme).eyes, seen_lids(landmarks), strict=True)
    return [(eye, lids) for eye, lids in eyes if lids is not None and shows[list(eye.iris)].all()]


@dataclass(frozen=True)
class Shutter:
    """The expression of a face model that shuts an eye."""

    expression: int
    left: Float[np.ndarray, " pairs"]  # how far it leaves the lids apart, in shares of the width


def shutters(model: FaceModel, scheme: str) -> list[Shutter | None]:
    """Of each eye of ``scheme`` what shuts it on the mean face and moves the least beside it; None
    where nothing does.
    """
    vertices, weights = model.landmark_vertices(scheme)
    motion = (model.expression_basis.astype(np.float64) ** 2).sum(axis=(1, 2))
    found: list[Shutter | None] = []
    for eye in scheme_of(scheme).eyes:
        at = np.array([*eye.corners, *np.ravel(eye.lids)])
        shapes = np.concatenate([model.vertices[None], model.expression_basis])
        shapes = np.einsum("mi,emix->emx", weights[at], shapes[:, vertices[at]])
        width = np.linalg.norm(shapes[0, 1] - shapes[0, 0])
        apart = (shapes[:, 2::2, 1] - shapes[:, 3::2, 1]) / width
        left = apart[0] + apart[1:]
        shuts = model.expression_box & (left.mean(axis=1) < LEFT_OPEN * apart[0].mean())
        chosen = int(np.where(shuts, motion, np.inf).argmin()) if shuts.any() else None
        found.append(None if chosen is None else Shutter(chosen, left[chosen]))
    return found


def shut_weights(model: FaceModel, landmarks: Landmarks) -> Float[np.ndarray, " expressions"]:
    """0 to 1 for each expression of ``model`` that shuts an eye: how surely all eyes that it shuts
    are shut in a photo with ``landmarks``; 0 for all others.
    """
    result = np.zeros(len(model.expression_names))
    eyes = seen_lids(landmarks)
    if not any(eye is not None and eye.shut > 0 for eye in eyes):
        return result
    shut: dict[int, float] = {}
    for eye, shutter in zip(eyes, shutters(model, landmarks.scheme), strict=True):
        if shutter is not None:
            own = 0.0 if eye is None else eye.shut
            shut[shutter.expression] = min(own, shut.get(shutter.expression, 1.0))
    result[list(shut)] = list(shut.values())
    return result

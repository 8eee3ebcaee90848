"""What one frame says of pose and expression: its landmarks, and the picture at a small size."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.landmarks import Landmarks
from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.energy.landmark_term import LANDMARK_SIGMA_SHARE, LandmarkTerm
from facestage.fit.energy.photo_term import PhotoTerm
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.given.black_and_white import as_seen_in_color
from facestage.fit.given.face_areas import face_size_px
from facestage.fit.given.photo import Photo
from facestage.fit.given.skin_mask import skin_weight
from facestage.fit.given.window import Window
from facestage.fit.sequence.actor import Actor
from facestage.fit.sequence.frame_light import LightEquations
from facestage.images.image_io import Photograph

BLOCKS, LIGHTS = ("pose", "expression"), "lights"
# Standard deviations of what all landmarks of a frame are off by together: in sizes of the face,
# and of their sizes and angles (on a rendered sequence, depth by landmarks wanders by 1 %).
TOGETHER_PLACE, TOGETHER = 0.005, 0.01
# Pixels along the face at which pictures are looked at: shape shows no more at larger ones.
FACE_PX = 112.0
# Those at which skin is told from what is none.
SKIN_FACE_PX = 64.0
SAMPLES = 1  # of each light, a pixel
# What of a frame is kept around the landmarks, in sizes of the face.
MARGIN = 1.0


@dataclass(frozen=True, eq=False)
class Said:
    """The normal equations of a frame by pose and expression, and how well it is explained."""

    hessian: Float[np.ndarray, "unknowns unknowns"]
    gradient: Float[np.ndarray, " unknowns"]
    # of landmarks in standard deviations, of pictures in linear radiance; NaN: nothing to compare
    rms: float


def landmark_evidence(
    actor: Actor,
    landmarks: Landmarks,
    state: State,
    sigma_scale: float = 1.0,
    trust: Float[np.ndarray, " landmarks"] | None = None,
) -> Said:
    """What ``landmarks`` say around ``state``: less of where the head is than of how its points lie
    to each other, for they err together. ``sigma_scale``: how far they are off, over how far on a
    single photo. ``trust``: how many times each landmark counts, once where None.
    """
    size = face_size_px(landmarks)
    sigma = sigma_scale * LANDMARK_SIGMA_SHARE * size
    placed = LandmarkTerm(actor.geometry, landmarks, sigma).at(state)
    slim = replace(
        state, lights=np.zeros(0), light_position=np.zeros((0, 2)), specular=np.zeros((1, 1))
    )
    layout = Layout(slim)
    weighed = placed.weighed(slim)
    jacobian = placed.jacobian(slim, layout)[:, layout.mask(BLOCKS)]
    together = (placed.whitening @ _together(placed.points, size)).reshape(len(jacobian), -1)
    weights = weighed.weights if trust is None else weighed.weights * np.repeat(trust, 2)
    weighted = weights[:, None] * together
    both = np.column_stack([jacobian, weighed.residuals])
    # What they share is an unknown of its own, of standard deviation 1, and eliminated.
    system = together.T @ weighted + np.eye(together.shape[1])
    left = both * weights[:, None]
    left -= weighted @ np.linalg.solve(system, weighted.T @ both)
    product = jacobian.T @ left
    rms = float(np.sqrt((weighed.residuals**2).mean()))
    return Said(product[:, :-1], product[:, -1], rms)


def _together(
    points: Float[np.ndarray, "landmarks 2"], size: float
) -> Float[np.ndarray, "landmarks 2 6"]:
    """Pixels by one standard deviation of what all landmarks share: place, size, turn and shear."""
    centred = (points - np.median(points, axis=0)) * TOGETHER
    result = np.zeros((len(points), 2, 6))
    for axis in range(2):
        result[:, axis, axis] = TOGETHER_PLACE * size
        result[:, axis, 2 + 2 * axis : 4 + 2 * axis] = centred
    return result


@dataclass(frozen=True, eq=False)
class Seen:
    """What a picture says of pose, expression and light."""

    said: Said  # under the lights that it was looked at with
    light: LightEquations  # of one frame; of no light where that is held


@dataclass(frozen=True, eq=False)
class Cut:
    """A frame cut to its face and made small."""

    window: Window
    photograph: Photograph
    landmarks: Landmarks  # pixels of the small picture

    @classmethod
    def of(cls, photograph: Photograph, landmarks: Landmarks, face_px: float = FACE_PX) -> Cut:
        """Around the ``landmarks`` of a whole frame, with so many pixels along the face."""
        window = _window(photograph.size, landmarks, face_px)
        points = window.landmarks(landmarks)
        return cls(window, as_seen_in_color(window.photograph(photograph), points), points)


@dataclass(frozen=True, eq=False)
class FrameView:
    """One frame as the photo term compares it."""

    window: Window
    term: PhotoTerm

    @classmethod
    def of(
        cls,
        actor: Actor,
        cut: Cut,
        skin: np.ndarray | None = None,
        light_held: bool = False,
        quarter: int | None = None,
    ) -> FrameView:
        """``skin``: :attr:`skin` of the same frame, where it was found before. ``quarter``:
        of the pixels, that is looked at alone (:attr:`PhotoTerm.quarter`).
        """
        small = cut.photograph
        if skin is None:
            found = skin_weight(small.color, cut.landmarks, face_px=SKIN_FACE_PX)
            skin = np.round(255 * found).astype(np.uint8)
        photo = Photo(
            small.color.astype(np.float64), small.mask, skin / np.float32(255), small.clipped
        )
        blocks = frozenset(BLOCKS if light_held else (*BLOCKS, LIGHTS))
        stage = actor.stage_in_camera
        term = PhotoTerm(actor.forward, photo, stage, SAMPLES, blocks, quarter=quarter)
        return cls(cut.window, term)

    @property
    def skin(self) -> np.ndarray:
        """(h, w) uint8, 255 where the pixels show skin."""
        return np.round(255 * self.term.photo.skin).astype(np.uint8)

    def evaluated(self, state: State) -> Evaluation:
        """The face at ``state``, of the whole picture, beside the frame."""
        camera = self.window.camera(state.camera)
        return self.term.evaluate(replace(state, camera=camera), 0)

    def seen(self, state: State) -> Seen:
        """What the picture says around ``state``."""
        evaluation = self.evaluated(state)
        used = evaluation.counted
        layout = Layout(evaluation.state)
        active = layout.mask(BLOCKS)
        lights = layout.mask([LIGHTS]) & (LIGHTS in self.term.blocks)
        weights = self.term.weights(evaluation, self.term.noise(evaluation))
        hessian, gradient = self.term.normal_equations(evaluation, weights, layout, active | lights)
        squared = evaluation.residual**2
        rms = float(np.sqrt(squared[used].mean())) if used.any() else np.nan
        light = LightEquations(
            hessian[np.ix_(lights, lights)][None],
            gradient[lights][None],
            hessian[np.ix_(lights, active)][None],
            np.array([0.5 * (weights[..., None] * squared).sum()]),
        )
        return Seen(Said(hessian[np.ix_(active, active)], gradient[active], rms), light)


def _window(size: tuple[int, int], landmarks: Landmarks, face_px: float) -> Window:
    points = landmarks.points[np.isfinite(landmarks.points).all(axis=1)]
    side = face_size_px(landmarks)
    low, high = points.min(axis=0) - MARGIN * side, points.max(axis=0) + MARGIN * side
    left, top = np.clip(np.floor(low), 0, np.array(size) - 1).astype(int).tolist()
    right, bottom = np.clip(np.ceil(high), [left + 1, top + 1], size).astype(int).tolist()
    return Window(size, (left, top, right, bottom), min(1.0, face_px / side))

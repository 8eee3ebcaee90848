"""The photo at the sizes that the phases work at, without what something flat hides and what is
darker than light explains.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import center_of_mass, label, mean

from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.energy.photo_term import PhotoTerm
from facestage.fit.face.state import State
from facestage.fit.given.occlusion import flat_occluders, without
from facestage.fit.given.photo import Photo
from facestage.fit.given.problem import Problem
from facestage.images.image_io import resize

# Share of the face that must be left to see; with less, the photo says nothing of the shape.
VISIBLE_SHARE_MIN = 0.1
# Share of a dark region that must be skin for nothing to hang over it: 0.75 and more of nine eye
# sockets, temples and foreheads in shade on 33 real photographs, 0.28 to 0.68 of six below hair.
BARE_SHARE = 0.75


class VisiblePhoto:
    """The photo of a problem, and what of it is hidden once somebody looked."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        # (h, w) bool at the size of the first photo phase, what something flat hides; None before
        # it was looked for.
        self.hidden: np.ndarray | None = None
        # Likewise, the regions that are darker than the light on the rest explains.
        self.dark: np.ndarray | None = None

    def at(self, factor: float) -> Photo:
        """The photo resized by ``factor``, without what is hidden or dark."""
        camera = self.problem.camera.scaled(factor)
        return self.of(camera.width, camera.height)

    def of(self, width: int, height: int) -> Photo:
        """The photo in this size, likewise, and without a beard that covers the skin."""
        photo = self.problem.photo_of(width, height)
        away = self.hidden_at(height, width) | self.dark_at(height, width)
        away |= resized_mask(self.problem.beard.covers, height, width)
        return without(photo, away) if away.any() else photo

    def hidden_at(self, height: int, width: int) -> np.ndarray:
        """(height, width) bool, the pixels that something flat hides."""
        return resized_mask(self.hidden, height, width)

    def dark_at(self, height: int, width: int) -> np.ndarray:
        """(height, width) bool, the pixels that are darker than light explains."""
        return resized_mask(self.dark, height, width)

    def look_for_occluders(
        self, photo: PhotoTerm, evaluation: Evaluation, radiance: np.ndarray
    ) -> np.ndarray:
        """Look for what hides the face under the first estimate of the light: ``hidden``.

        ``radiance`` (N, 3) is that of the lit lights; ``evaluation`` is of ``photo``.
        """
        problem, image, forward = self.problem, evaluation.image, photo.forward
        shaded = forward.shade(evaluation.state, image.surface, image.terms, radiance=radiance)
        model = np.zeros_like(photo.photo.color)
        model[photo.index(image.surface)] = shaded.color
        used = (evaluation.base_weight > 0) & ~photo.photo.clipped.any(axis=2)
        factor = photo.photo.usable.shape[1] / problem.camera.width
        self.hidden = flat_occluders(photo.photo.color, model, used, factor * problem.face_size_px)
        if (self.hidden & used).sum() > (1 - VISIBLE_SHARE_MIN) * used.sum():
            # Nothing hides all of a face that has landmarks: photo and light do not belong
            # together, and the few pixels that are left would bend the shape until they did.
            self.hidden = np.ones_like(self.hidden)
        return self.hidden

    def unpainted_at(self, height: int, width: int, state: State) -> np.ndarray:
        """(height, width) bool, the pixels that show no skin of the face of ``state``: what is
        hidden, and what is dark above the middle of its landmarks and mostly no skin, as below
        hair.
        """
        hidden = self.hidden_at(height, width)
        return np.asarray(hidden | self._dark_above(height, width, state, bare=False))

    def shadowed_at(self, height: int, width: int, state: State) -> np.ndarray:
        """Likewise, bare skin there that lies in a shadow which the fitted light does not throw."""
        return self._dark_above(height, width, state, bare=True)

    def _dark_above(self, height: int, width: int, state: State, bare: bool) -> np.ndarray:
        """(height, width) bool, the dark regions above the middle of the landmarks of which bare
        skin is BARE_SHARE and more, or is not; dark skin below is a beard, also where it meets the
        shadow of the nose or of glasses.
        """
        dark = self.dark_at(height, width)
        labels, count = label(dark)
        if not count:
            return dark
        up = state.rotation[:, 1] * [1.0, -1.0, 0.0]  # of the head, in the picture
        middle = (
            np.nanmean(self.problem.landmarks.points, axis=0) * width / self.problem.camera.width
        )
        numbers = np.arange(1, count + 1)
        centres = np.array(center_of_mass(dark, labels, numbers))[:, ::-1] + 0.5
        above = (centres - middle) @ up[:2] > 0
        skin = resize(self.problem.skin.astype(np.float32), width, height) > 0.5
        above &= (np.asarray(mean(skin, labels, numbers)) >= BARE_SHARE) == bare
        y, x = np.mgrid[:height, :width] + 0.5
        upper = (x - middle[0]) * up[0] + (y - middle[1]) * up[1] > 0
        return np.asarray(np.isin(labels, numbers[above]) & upper)


def resized_mask(mask: np.ndarray | None, height: int, width: int) -> np.ndarray:
    """(height, width) bool, the pixels that one of ``mask`` touches; None: nothing."""
    if mask is None or not mask.any():
        return np.zeros((height, width), bool)
    return np.asarray(resize(mask.astype(np.float32), width, height) > 0)

"""One face through the frames of a film: looked for where it was, found anew when it is lost."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from facestage.images.image_io import Photograph
from facestage.landmarks.finder import Face, FaceFinder, choose_face

# How far a face may move, and grow, from one frame to the next and still be the same shot, in
# widths of its square: a head thrown round moves by a fifth of itself in a 24th of a second.
JUMP_MAX, GROWTH_MAX = 0.35, 1.25


class Sight(StrEnum):
    """How a frame's face was found."""

    TRACKED = "tracked"  # where the frame before had it
    FOUND = "found"  # by a search of the whole frame
    CUT = "cut"  # likewise, and it is another shot than the frame before
    LOST = "lost"  # there is none


@dataclass(frozen=True, eq=False)
class Sighting:
    """The face of a frame; None where it is ``lost``."""

    sight: Sight
    face: Face | None


class FaceTracker:
    """Follows one face; :meth:`look` is called frame by frame."""

    def __init__(self, finder: FaceFinder, number: int | None = None) -> None:
        """``number``: which face of the first frame, the largest first, counted from 1."""
        self._finder, self._number = finder, number
        self._last: np.ndarray | None = None  # (478, 2) pixels, where the face was last
        self._gap = 0  # frames since then

    def resume(self, points: np.ndarray | None, gap: int) -> None:
        """Go on where the face was seen ``gap`` frames ago, its ``points`` (478, 2) there."""
        self._last, self._gap = points, gap

    def look(self, photograph: Photograph) -> Sighting:
        """The face in the next frame."""
        face = (
            None if self._last is None or self._gap else self._finder.follow(photograph, self._last)
        )
        sight = Sight.TRACKED
        if face is not None and self._jumped(face):
            face = None
        if face is None:
            face, sight = self._searched(photograph)
        if face is None:
            self._gap += 1
            return Sighting(Sight.LOST, None)
        self._last, self._gap = face.mesh.points[:, :2], 0
        return Sighting(sight, face)

    def _searched(self, photograph: Photograph) -> tuple[Face | None, Sight]:
        faces = self._finder.find(photograph).faces
        if not faces:
            return None, Sight.LOST
        if self._last is None:
            return choose_face(faces, self._number), Sight.FOUND
        nearest = min(faces, key=self._distance)
        return nearest, Sight.CUT if not self._gap and self._jumped(nearest) else Sight.FOUND

    def _distance(self, face: Face) -> float:
        """From where the face was last, in widths of its square."""
        assert self._last is not None
        side = face.mesh.crop.side
        return float(np.linalg.norm((face.mesh.points[:, :2] - self._last).mean(axis=0)) / side)

    def _jumped(self, face: Face) -> bool:
        assert self._last is not None
        growth = float(
            np.ptp(face.mesh.points[:, :2], axis=0).max() / np.ptp(self._last, axis=0).max()
        )
        return self._distance(face) > JUMP_MAX or not 1 / GROWTH_MAX < growth < GROWTH_MAX

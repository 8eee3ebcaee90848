"""From a photograph to its faces: search, verify, refine."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.landmarks import Landmarks
from facestage.images.image_io import Photograph
from facestage.landmarks.canonical import CanonicalFace, read_canonical
from facestage.landmarks.crop import Crop
from facestage.landmarks.face_detector import Detections, FaceDetector, overlap
from facestage.landmarks.face_mesh import MARGIN, FaceMesh, Mesh
from facestage.landmarks.model_file import Bundle, open_model
from facestage.landmarks.search import coarse_windows, find_candidates, fine_windows, look_closely
from facestage.landmarks.views import PhotoViews
from facestage.landmarks.visibility import visible_points

SCHEME = "mediapipe478"
PRESENCE_MIN = 0.5
# Passes of the mesh network, each on the square that the one before asks for.
PASSES = 3
# How far a face's points may still move in the last pass, and differ in a mirror, in widths of its
# square: on what is no face the network goes on moving, and sees another one in the mirror.
SETTLED, MIRROR_MAX = 0.008, 0.025
CANDIDATES_MAX = 24
# The detector is as sure as this of a face in profile, which the mesh network does not know.
UNCLEAR_SCORE = 0.75
TURN_MAX = 65
DUPLICATE = 0.3


@dataclass(frozen=True, eq=False)
class Face:
    """A face in a photo: its mesh, which of its points the camera sees, and how sure the networks
    are (0..1).
    """

    mesh: Mesh
    visible: np.ndarray  # (478,) bool
    confidence: float

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Left, top, right and bottom of the points in pixels."""
        low, high = self.mesh.points[:, :2].min(axis=0), self.mesh.points[:, :2].max(axis=0)
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])

    @property
    def size(self) -> float:
        """The side of its upright box in pixels, whatever its roll."""
        return self.mesh.crop.side / MARGIN

    @property
    def landmarks(self) -> Landmarks:
        """The points of scheme mediapipe478."""
        return Landmarks(SCHEME, self.mesh.points[:, :2], self.visible)


@dataclass(frozen=True)
class Search:
    """The faces of a photo, the largest first, and boxes (m, 3) (centre x, y, side; pixels) of what
    is hardly one.
    """

    faces: list[Face]
    unclear: np.ndarray


class FaceFinder:
    """Finds faces with the networks of one bundle."""

    def __init__(self, bundle: Bundle) -> None:
        self.canonical: CanonicalFace = read_canonical(bundle.geometry)
        self._detector, self._mesh = FaceDetector(bundle.detector), FaceMesh(bundle.mesh)
        # One for the mirror image: a network is asked by one thread at a time.
        self._mirror_mesh, self._beside = FaceMesh(bundle.mesh), ThreadPoolExecutor(1)

    def find(self, photograph: Photograph) -> Search:
        """The faces of a photo; as it is first, then more closely, then exposed anew, until there
        is one.
        """
        views = PhotoViews(photograph)
        unclear: list[np.ndarray] = []
        for gain in views.gains():
            views.gain = gain
            for windows in (coarse_windows, fine_windows):
                candidates = find_candidates(self._detector, views, windows(*photograph.size))
                faces = self._verified(views, candidates, unclear)
                if faces:
                    return Search(sorted(faces, key=lambda face: -face.size), np.zeros((0, 3)))
        return Search([], np.array(unclear).reshape(-1, 3))

    def follow(self, photograph: Photograph, points: np.ndarray) -> Face | None:
        """The face that had its ``points`` (478, 2) pixels in the frame before; None where the mesh
        network sees none there.
        """
        views = PhotoViews(photograph)
        last = Mesh(np.column_stack([points, np.zeros(len(points))]), 1.0)
        crop = last.crop
        mesh, disagreement = self._both_ways(views, crop)
        if mesh.presence < PRESENCE_MIN or disagreement > MIRROR_MAX * crop.side:
            return None
        # Once more on its own square, as a search ends: points depend on where the square is.
        mesh, disagreement = self._both_ways(views, mesh.crop)
        if mesh.presence < PRESENCE_MIN or disagreement > MIRROR_MAX * crop.side:
            return None
        visible = visible_points(mesh.points, self.canonical) & _inside(mesh.points, views)
        return Face(mesh, visible, mesh.presence)

    def _verified(
        self, views: PhotoViews, candidates: Detections, unclear: list[np.ndarray]
    ) -> list[Face]:
        """The candidates that are faces, each once; the detector's surest of the others go to
        ``unclear``.
        """
        faces: list[Face] = []
        for number in range(min(len(candidates), CANDIDATES_MAX)):
            closer = look_closely(self._detector, views, candidates.select(np.array([number])))
            face = self._face(views, closer) if len(closer) else None
            if face is not None:
                faces.append(face)
            elif len(closer) and closer.scores[0] > UNCLEAR_SCORE:
                unclear.append(closer.boxes[0])
        faces.sort(key=lambda face: -face.confidence)
        kept: list[Face] = []
        for face in faces:
            if (
                not kept
                or overlap(_square(face), np.array([_square(other) for other in kept])).max()
                < DUPLICATE
            ):
                kept.append(face)
        return kept

    def _face(self, views: PhotoViews, detection: Detections) -> Face | None:
        """The mesh of a detection, or None when the mesh network sees no face there."""
        center, side = detection.boxes[0, :2], detection.boxes[0, 2]
        mesh = self._mesh.predict(views, Crop(center, MARGIN * side, float(detection.roll[0])))
        for _ in range(PASSES - 1):
            last, crop = mesh, mesh.crop
            mesh, disagreement = self._both_ways(views, crop)
            if mesh.presence < PRESENCE_MIN or disagreement > MIRROR_MAX * crop.side:
                return None
        if _distance(mesh, last) > SETTLED * crop.side:
            return None
        visible = visible_points(mesh.points, self.canonical) & _inside(mesh.points, views)
        return Face(mesh, visible, mesh.presence * float(detection.scores[0]))

    def _both_ways(self, views: PhotoViews, crop: Crop) -> tuple[Mesh, float]:
        """The mean mesh of a square and of its mirror image, and how far these differ, in
        pixels.
        """
        asked = self._beside.submit(self._mirror_mesh.predict, views, crop.mirror())
        straight, reflected = self._mesh.predict(views, crop), asked.result()
        mirrored = replace(reflected, points=reflected.points[self.canonical.mirror])
        mean = Mesh(
            (straight.points + mirrored.points) / 2, min(straight.presence, mirrored.presence)
        )
        return mean, _distance(straight, mirrored)


def _distance(first: Mesh, second: Mesh) -> float:
    """Mean distance of the points in the picture, pixels."""
    return float(np.linalg.norm((first.points - second.points)[:, :2], axis=1).mean())


def _inside(points: np.ndarray, views: PhotoViews) -> np.ndarray:
    """(m,) bool, the points that the photo's frame does not cut off."""
    return np.asarray(
        ((points[:, :2] > 0) & (points[:, :2] < [views.width, views.height])).all(axis=1)
    )


def _square(face: Face) -> np.ndarray:
    """(3,) centre x, y and side."""
    return np.array([*face.mesh.crop.center, face.size])


def detect_faces(photograph: Photograph, model: Path | None = None) -> list[Face]:
    """The faces of a photo, the largest first.

    Raises InputError when there is none, or no model to find them.
    """
    return require_faces(FaceFinder(open_model(model)).find(photograph))


def require_faces(search: Search) -> list[Face]:
    """The faces of a search. Raises InputError, with what to do, when there is none."""
    if search.faces:
        return search.faces
    if len(search.unclear):
        x, y, side = search.unclear[np.argmax(search.unclear[:, 2])]
        raise InputError(
            f"No face was found in the photo for sure: what is at ({x:.0f}, {y:.0f}), {side:.0f} "
            f"pixels wide, may be one that is turned away by more than about {TURN_MAX} degrees, "
            "covered or blurred; give its landmarks by --landmarks FILE.json, or another photo."
        )
    raise InputError(
        "No face was found in the photo; crop it to the face, turn it upright, or give the "
        "landmarks by --landmarks FILE.json."
    )


def choose_face(faces: list[Face], number: int | None) -> Face:
    """The ``number``-th largest face, counted from 1; the largest without one.

    Raises InputError.
    """
    if number is None:
        return faces[0]
    if not 1 <= number <= len(faces):
        found = "one face was" if len(faces) == 1 else f"{len(faces)} faces were"
        raise InputError(
            f"Face {number} was asked for but {found} found; give --face 1 to {len(faces)}, by "
            "size."
        )
    return faces[number - 1]

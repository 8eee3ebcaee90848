"""Landmarks for a job that has none, and in the scheme that its face model knows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from facestage.contract.events import PROGRESS, Event
from facestage.contract.face_model import FaceModel
from facestage.contract.job import Job
from facestage.contract.landmarks import Landmarks
from facestage.images.image_io import Photograph
from facestage.landmarks.finder import choose_face, detect_faces
from facestage.landmarks.ibug68 import SOURCE, TARGET, to_ibug68


def with_landmarks(
    job: Job, photograph: Photograph, model: Path | None, emit: Callable[[Event], None]
) -> Job:
    """The job with landmarks: its own, or those of the face it names in the photo.

    Raises InputError.
    """
    if job.landmarks is not None:
        return job
    faces = detect_faces(photograph, model)
    face = choose_face(faces, job.face)
    found = "The face found" if len(faces) == 1 else f"Face {faces.index(face) + 1} of {len(faces)}"
    emit(
        Event(
            PROGRESS,
            "detection",
            message=f"{found} is {face.size:.0f} pixels wide (confidence {face.confidence:.2f})",
        )
    )
    return replace(job, landmarks=face.landmarks)


def known_to(model: FaceModel, landmarks: Landmarks) -> Landmarks:
    """The landmarks in a scheme that the face model has: mesh points become ibug68 where it knows
    only those.
    """
    if landmarks.scheme == SOURCE and SOURCE not in model.landmarks and TARGET in model.landmarks:
        return to_ibug68(landmarks)
    return landmarks

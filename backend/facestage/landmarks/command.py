"""``facestage detect``: a photo in, its landmark file and a summary out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from facestage.contract.errors import InputError
from facestage.contract.files.storage import finite, write_json
from facestage.images.image_io import read_photograph
from facestage.landmarks.finder import Face, FaceFinder, choose_face, require_faces
from facestage.landmarks.model_file import open_model
from facestage.landmarks.picture import draw_faces

DECIMALS = 3  # a thousandth of a pixel


def run_detect(
    image: Path,
    out: Path,
    face: int | None = None,
    model: Path | None = None,
    picture: Path | None = None,
    every: bool = False,
) -> dict[str, Any]:
    """Detect, write ``out`` (and ``picture``), and return the summary. Raises InputError before
    anything is written.

    ``out`` holds the chosen face's landmarks (scheme, points, visible), its confidence, and of all
    faces the number, box and confidence; with ``every`` their points too.
    """
    if picture is not None and picture.suffix.lower() != ".png":
        raise InputError(f"The picture '{picture}' does not end in .png; it is written as PNG.")
    photograph = read_photograph(image)
    finder = FaceFinder(open_model(model))
    faces = require_faces(finder.find(photograph))
    chosen = choose_face(faces, face)
    number = faces.index(chosen)
    if picture is not None:
        draw_faces(picture, photograph, faces, number, finder.canonical)
    data = _points(chosen) | _about(chosen, number)
    data["faces"] = [
        _about(other, k) | (_points(other) if every else {}) for k, other in enumerate(faces)
    ]
    write_json(out, data)
    summary = {
        "out": out,
        **_about(chosen, number),
        "visible": int(chosen.visible.sum()),
        "faces": len(faces),
    }
    return dict(finite(summary))


def _points(face: Face) -> dict[str, Any]:
    landmarks = face.landmarks
    return landmarks.to_json() | {"points": landmarks.points.round(DECIMALS)}


def _about(face: Face, number: int) -> dict[str, Any]:
    return {
        "face": number + 1,
        "confidence": round(face.confidence, 3),
        "box": [round(x, 1) for x in face.box],
        "size_px": round(face.size, 1),
    }

"""A scan of a head, laid where the photo's camera saw it: what a fit of the photo is judged by."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from facestage.contract.arrays import Float, Integer
from facestage.contract.case_files import FACE_REGION
from facestage.contract.errors import InputError
from facestage.contract.files.paths import is_file
from facestage.contract.files.reading import GIB, MIB
from facestage.contract.files.storage import read_array, read_arrays, write_arrays
from facestage.contract.light_stage import FAR
from facestage.contract.schemas.array_field import WHOLE, Array
from facestage.contract.schemas.schema import FileSchema, checked

MILLIMETRES = 1e3  # in a metre
SCAN_MAX, REGION_MAX = 1 * GIB, 64 * MIB
# Across the face, in mm: a child's is 130 from brow to chin, and whoever counts the neck has 300.
# A scan in centimetres or metres would be scored as if it were a doll's.
FACE_MIN, FACE_MAX = 50.0, 600.0
FACE_POINTS_MIN = 100


class ScanSchema(FileSchema):
    """A scan.npz; its face is checked apart, because it may stand in another file."""

    dimensions: ClassVar = {"vertices": (3, 2**31), "triangles": (1, 2**31)}

    vertices = Array(("vertices", 3), minimum=-FAR * MILLIMETRES, maximum=FAR * MILLIMETRES)
    triangles = Array(("triangles", 3), WHOLE, minimum=0)
    face = Array(("face",), WHOLE, minimum=0, required=False)


# What makes a scan of an .npz that holds vertices: the truth of a face model has none.
MARK = "triangles"


@dataclass(frozen=True)
class Scan:
    """A head's surface in the camera's frame (x right, y up, looking along -z), in millimetres."""

    vertices: Float[np.ndarray, "vertices 3"]
    triangles: Integer[np.ndarray, "triangles 3"]
    face: Integer[np.ndarray, " face"]  # numbers of the vertices that are the face

    def save(self, path: Path) -> None:
        """Write a scan.npz."""
        write_arrays(
            path,
            {
                "vertices": self.vertices.astype(np.float32),
                "triangles": self.triangles.astype(np.int32),
                "face": self.face.astype(np.int32),
            },
        )

    @classmethod
    def load(cls, path: Path, region: Path | None = None) -> Scan:
        """Read a scan.npz; its face is what the file ``region`` (.npy) says, else its own array
        ``face``, else a file face_region.npy beside it.

        Raises InputError.
        """
        subject = f"The scan '{path}'"
        arrays = read_arrays(path, "scan", SCAN_MAX, tuple(ScanSchema().fields))
        found = checked(ScanSchema(), arrays, subject, "write vertices and triangles again")
        vertices, triangles = found["vertices"].astype(np.float64), found["triangles"]
        if triangles.max() >= len(vertices):
            raise InputError(
                f"{subject} has a triangle at vertex {int(triangles.max())}, but "
                f"{len(vertices)} vertices; write vertices and triangles of one mesh."
            )
        beside = path.parent / FACE_REGION
        if region is None and "face" not in found:
            region = beside if is_file(beside) else None
        if region is not None:
            face = read_region(region, len(vertices))
        elif "face" in found:
            face = face_numbers(found["face"], len(vertices), f"{subject}: face")
        else:
            raise InputError(
                f"{subject} does not say which of its vertices are the face; give them with "
                f"--face-region FILE.npy, as its array 'face', or as {FACE_REGION} beside it."
            )
        _check_place(vertices[face], subject)
        return cls(vertices, triangles, face)


def read_region(path: Path, count: int) -> np.ndarray:
    """(f,) numbers of the vertices that a .npy names of a mesh of ``count``.

    Raises InputError.
    """
    found = read_array(path, "face region", REGION_MAX)
    return face_numbers(found, count, f"The face region '{path}'")


def face_numbers(given: np.ndarray, count: int, subject: str) -> np.ndarray:
    """(f,) ascending numbers of vertices, of (count,) true or false or of whole numbers.

    Raises InputError, which begins with ``subject``.
    """
    if given.dtype.kind == "b" and given.shape == (count,):
        numbers = np.flatnonzero(given)
    elif given.dtype.kind in "iu" and given.ndim == 1:
        numbers = np.unique(given)
    else:
        raise InputError(
            f"{subject} has shape {given.shape} of {given.dtype} values, expected the numbers of "
            f"vertices in one row, or true and false for each of {count}."
        )
    if len(numbers) < FACE_POINTS_MIN:
        raise InputError(
            f"{subject} names {len(numbers)} vertices, expected at least {FACE_POINTS_MIN}; "
            "are they the face's?"
        )
    if numbers[0] < 0 or numbers[-1] >= count:
        wrong = numbers[0] if numbers[0] < 0 else numbers[-1]
        raise InputError(
            f"{subject} names vertex {int(wrong)} of a scan of {count}, which are 0 to {count - 1}."
        )
    return numbers.astype(np.int64)


def _check_place(face: Float[np.ndarray, "face 3"], subject: str) -> None:
    """Raise InputError for a face that is not of a face's size in mm, or not before the camera."""
    size = float(np.ptp(face, axis=0).max())
    if not FACE_MIN <= size <= FACE_MAX:
        raise InputError(
            f"{subject} has a face of {size:.3g} millimetres, expected {FACE_MIN:g} to "
            f"{FACE_MAX:g}; give its vertices in millimetres."
        )
    if float(np.median(face[:, 2])) >= 0:
        raise InputError(
            f"{subject} has its face behind the camera; give its vertices in the camera's frame: "
            "x to the right, y up, looking along -z."
        )

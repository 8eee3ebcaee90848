"""The canonical face of the mesh network: its vertices, triangles and mirror pairs, from the
model's bundle.

The bundle's member is a protocol buffer (mediapipe/tasks/cc/vision/face_geometry/proto): its first
field is the mesh, whose field 3 repeats the vertices' x, y, z, u, v and whose field 4 repeats the
triangles' corners.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from facestage.contract.errors import InputError

SURFACE_COUNT = 468  # the mesh's points; the two irises follow them
# Centre, then outward, top, inward, bottom: each iris has its points in the same order in the
# picture.
RIGHT_IRIS, LEFT_IRIS = (468, 469, 470, 471, 472), (473, 476, 475, 474, 477)
MESH, VERTICES, TRIANGLES = 1, 3, 4
VARINT, FIXED64, BYTES, FIXED32 = 0, 1, 2, 5


@dataclass(frozen=True)
class CanonicalFace:
    """``vertices`` (468, 3) centimetres, x to the picture's right, y up, z to the camera;
    ``triangles`` (t, 3).

    Corners run counter-clockwise seen from outside.
    """

    vertices: np.ndarray
    triangles: np.ndarray

    @cached_property
    def mirror(self) -> np.ndarray:
        """(478,) which point is each point's counterpart in the other half of the face."""
        distance, partner = cKDTree(self.vertices).query(self.vertices * [-1.0, 1.0, 1.0])
        pairs = np.arange(SURFACE_COUNT + len(RIGHT_IRIS) + len(LEFT_IRIS))
        pairs[:SURFACE_COUNT] = partner
        pairs[list(RIGHT_IRIS)], pairs[list(LEFT_IRIS)] = LEFT_IRIS, RIGHT_IRIS
        if (pairs[pairs] != np.arange(len(pairs))).any() or distance.max() > 0.5:
            raise InputError("The landmark model's face is not symmetric; fetch the model again.")
        return pairs

    @cached_property
    def edges(self) -> np.ndarray:
        """(e, 2) each edge of the triangles once."""
        every = np.sort(self.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        return np.unique(every, axis=0)


def read_canonical(data: bytes) -> CanonicalFace:
    """The canonical face in the bundle's geometry member. Raises InputError for anything else."""
    try:
        mesh = next(content for field, _, content in _fields(data) if field == MESH)
        numbers = b"".join(content for field, _, content in _fields(mesh) if field == VERTICES)
        corners = [number for field, number, _ in _fields(mesh) if field == TRIANGLES]
        with np.errstate(invalid="ignore"):  # what is no number is refused below
            vertices = np.frombuffer(numbers, "<f4").reshape(-1, 5)[:, :3].astype(np.float64)
        triangles = np.array(corners, np.int64).reshape(-1, 3)
    except (LookupError, StopIteration, ValueError, OverflowError) as error:
        raise InputError(
            f"The landmark model's face geometry cannot be read ({error}); fetch the model again."
        ) from error
    if len(vertices) != SURFACE_COUNT or not len(triangles) or triangles.max() >= SURFACE_COUNT:
        raise InputError(
            f"The landmark model's face has {len(vertices)} points, expected {SURFACE_COUNT}."
        )
    if not np.isfinite(vertices).all():
        raise InputError(
            "The landmark model's face has points that are no numbers; fetch the model again."
        )
    return CanonicalFace(vertices, triangles)


def _fields(data: bytes) -> Iterator[tuple[int, int, bytes]]:
    """The number of each field of a protocol buffer, and its value: a whole number, or bytes."""
    position = 0
    while position < len(data):
        key, position = _varint(data, position)
        kind, number, length = key & 7, 0, 0
        if kind == VARINT:
            number, position = _varint(data, position)
        elif kind == BYTES:
            length, position = _varint(data, position)
        else:
            length = {FIXED64: 8, FIXED32: 4}[kind]
        yield key >> 3, number, data[position : position + length]
        position += length


def _varint(data: bytes, position: int) -> tuple[int, int]:
    """The base-128 number at ``position`` and where it ends."""
    value = shift = 0
    while True:
        byte = data[position]
        position += 1
        value |= (byte & 127) << shift
        shift += 7
        if byte < 128:
            return value, position

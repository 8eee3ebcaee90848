"""A user's own mesh with its shape keys, as the add-on writes it and the backend reads it: plain
arrays, one .npz.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np

from facestage.contract.arrays import Float, Float64, Int32, Integer, UInt8
from facestage.contract.errors import InputError
from facestage.contract.face_model import PARTS, UV_HIGH, UV_LOW
from facestage.contract.files.reading import GIB
from facestage.contract.files.storage import read_arrays, write_arrays
from facestage.contract.result import VERTICES_MAX
from facestage.contract.schemas.array_field import WHOLE, Array, Words
from facestage.contract.schemas.fields import Flag, Items, Name, Number, Table, Text, Whole
from facestage.contract.schemas.schema import (
    FileSchema,
    check_version,
    checked,
    decoded_meta,
    sections,
)

SCHEMA_VERSION = 1
# the backend guesses: skin, unless a loose piece lies where the eyes or the teeth are
UNKNOWN_PART = 255

# What a user may mark: name -> (words, index in the ibug68 scheme). Left and right are the
# subject's.
MARKS: Mapping[str, tuple[str, int]] = {
    "eye_right_outer": ("Outer Corner of the Right Eye", 36),
    "eye_right_inner": ("Inner Corner of the Right Eye", 39),
    "eye_left_inner": ("Inner Corner of the Left Eye", 42),
    "eye_left_outer": ("Outer Corner of the Left Eye", 45),
    "nose_bridge": ("Bridge of the Nose, Between the Eyes", 27),
    "nose_tip": ("Tip of the Nose", 30),
    "nose_base": ("Base of the Nose, Above the Lip", 33),
    "mouth_right": ("Right Corner of the Mouth", 48),
    "mouth_left": ("Left Corner of the Mouth", 54),
    "lip_upper": ("Middle of the Upper Lip's Upper Edge", 51),
    "lip_lower": ("Middle of the Lower Lip's Lower Edge", 57),
    "chin": ("Lowest Point of the Chin", 8),
}


@dataclass(frozen=True)
class RigFile:
    """A mesh with identity and expression shapes, in its own axes and unit.

    An expression moves by its offsets at weight 1 (the end of its slider), an identity shape at one
    standard deviation.
    """

    name: str
    license: str
    vertices: Float64[np.ndarray, "vertices 3"]  # without any shape key
    polygons: Int32[np.ndarray, "polygons 4"]  # quads; the fourth is -1 for a triangle
    polygon_uvs: Int32[np.ndarray, "polygons 4"]  # into `uvs`; the fourth is -1 for a triangle
    polygon_part: UInt8[np.ndarray, " polygons"]  # index into PARTS or UNKNOWN_PART
    uvs: Float[np.ndarray, "uvs 2"]  # in 0..1
    expression_names: tuple[str, ...]
    expression_offsets: Float[np.ndarray, "expressions vertices 3"]
    identity_names: tuple[str, ...]
    identity_offsets: Float[np.ndarray, "identities vertices 3"]
    # metres per unit along each axis, as far as the scene says
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)
    borrow_identity: bool = True  # without identity shapes of its own, take the default model's
    # name in MARKS -> vertex indices, at their middle
    marks: Mapping[str, Integer[np.ndarray, " _"]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        n = len(self.vertices)
        shapes = {
            "vertices": (n, 3),
            "polygons": (len(self.polygons), 4),
            "polygon_uvs": (len(self.polygons), 4),
            "polygon_part": (len(self.polygons),),
            "uvs": (len(self.uvs), 2),
            "expression_offsets": (len(self.expression_names), n, 3),
            "identity_offsets": (len(self.identity_names), n, 3),
        }
        for name, shape in shapes.items():
            array = getattr(self, name)
            if array.shape != shape or not np.issubdtype(array.dtype, np.number):
                raise self._wrong(
                    f"{name} has shape {array.shape} of {array.dtype}, expected {shape} of numbers"
                )
            if not np.isfinite(array).all():
                raise self._wrong(f"{name} holds NaN or infinity")
        if n < 100 or len(self.polygons) < 100:
            raise InputError(
                f"The mesh '{self.name}' has {n} vertices and {len(self.polygons)} polygons; a "
                "face needs at least 100 of each: choose the mesh of a face."
            )
        for name, limit in (("polygons", n), ("polygon_uvs", len(self.uvs))):
            array = getattr(self, name)
            if array.max() >= limit or array[:, :3].min() < 0 or array.min() < -1:
                raise self._wrong(f"{name} refers to a point outside 0..{limit - 1}")
        part = self.polygon_part
        if not ((part >= 0) & (part < len(PARTS)) | (part == UNKNOWN_PART)).all():
            raise self._wrong(
                f"polygon_part holds values other than 0..{len(PARTS) - 1} and {UNKNOWN_PART}"
            )
        names = (*self.expression_names, *self.identity_names)
        if len(set(self.expression_names)) + len(set(self.identity_names)) < len(names) or not all(
            names
        ):
            raise self._wrong("two of its shapes have the same name, or one has none")
        if (
            not all(np.isfinite(value) and abs(value) > 1e-12 for value in self.scale)
            or len(self.scale) != 3
        ):
            raise InputError(
                f"The mesh '{self.name}' has the scale {self.scale}; expected three numbers "
                "that are not 0."
            )
        for mark, indices in self.marks.items():
            if mark not in MARKS:
                raise self._wrong(
                    f"the landmark '{mark}' is unknown; expected one of {', '.join(MARKS)}"
                )
            if not len(indices) or indices.min() < 0 or indices.max() >= n:
                raise self._wrong(f"the landmark '{mark}' refers to a vertex outside 0..{n - 1}")

    def _wrong(self, what: str) -> InputError:
        return InputError(
            f"The mesh file of '{self.name}': {what}; export the mesh again (Use My Mesh)."
        )

    def known_points(self) -> dict[int, Float64[np.ndarray, " 3"]]:
        """Index in the ibug68 scheme -> the place that the user has marked, in the mesh's own
        coordinates.
        """
        return {
            MARKS[name][1]: self.vertices[indices].mean(axis=0)
            for name, indices in self.marks.items()
        }

    def save(self, path: Path) -> None:
        """Write the file whole or not at all."""
        meta = {
            "schema": SCHEMA_VERSION,
            "name": self.name,
            "license": self.license,
            "scale": self.scale,
            "expression_names": self.expression_names,
            "identity_names": self.identity_names,
            "borrow_identity": self.borrow_identity,
        }
        arrays = {name: np.asarray(getattr(self, name), kind) for name, kind in _ARRAYS.items()}
        arrays |= {
            f"marks/{name}": np.asarray(indices, np.int32) for name, indices in self.marks.items()
        }
        write_arrays(path, arrays | {"meta": np.array(json.dumps(meta))})

    @classmethod
    def load(cls, path: Path) -> RigFile:
        """Read a file that :meth:`save` wrote. Raises InputError for anything else."""
        subject, again = (
            f"The mesh file '{path}'",
            "export the mesh again with Use My Mesh in Blender",
        )
        arrays = sections(read_arrays(path, "mesh file", RIG_ARRAYS_MAX), "marks")
        given = checked(RigArrays(), arrays, subject, again)
        meta = decoded_meta(given.pop("meta"), subject, again)
        check_version(meta, SCHEMA_VERSION, subject, again)
        about = checked(RigMeta(), meta, f"{subject} is damaged; its meta", again)
        del about["schema"]
        return cls(**about, **given)


RIG_ARRAYS_MAX = 2 * GIB
COORDINATE_MAX = 1e9  # of the mesh, in its own unit


class RigMeta(FileSchema):
    """What a mesh file says beside its arrays."""

    schema = Whole(SCHEMA_VERSION, SCHEMA_VERSION)
    name = Text()
    license = Text()
    scale = Items(Number(-COORDINATE_MAX, COORDINATE_MAX), 3, 3)
    expression_names = Items(Name())
    identity_names = Items(Name())
    borrow_identity = Flag()


class RigArrays(FileSchema):
    """The arrays of a mesh file; which of them belong together, RigFile checks."""

    dimensions: ClassVar = {"vertices": (1, VERTICES_MAX), "polygons": (1, VERTICES_MAX)}

    vertices = Array(("vertices", 3), minimum=-COORDINATE_MAX, maximum=COORDINATE_MAX)
    polygons = Array(("polygons", 4), WHOLE, minimum=-1)
    polygon_uvs = Array(("polygons", 4), WHOLE, minimum=-1)
    polygon_part = Array(("polygons",), WHOLE, minimum=0)
    uvs = Array(("uvs", 2), minimum=UV_LOW, maximum=UV_HIGH)
    expression_offsets = Array(
        ("expressions", "vertices", 3), minimum=-COORDINATE_MAX, maximum=COORDINATE_MAX
    )
    identity_offsets = Array(
        ("modes", "vertices", 3), minimum=-COORDINATE_MAX, maximum=COORDINATE_MAX
    )
    marks = Table(Array(("marked",), WHOLE, minimum=0), load_default=dict)
    meta = Words()


_ARRAYS = {
    "vertices": np.float64,
    "polygons": np.int32,
    "polygon_uvs": np.int32,
    "polygon_part": np.uint8,
    "uvs": np.float32,
    "expression_offsets": np.float32,
    "identity_offsets": np.float32,
}

"""A face model as plain arrays: the one form every loader produces and the add-on builds rigs
from.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from facestage.contract.arrays import Bool, Float, Float32, Int32, Int64, Integer, Num, UInt8
from facestage.contract.errors import InputError
from facestage.contract.files.reading import GIB
from facestage.contract.files.storage import read_arrays, write_arrays
from facestage.contract.schemas.array_field import WHOLE, Array, Words
from facestage.contract.schemas.fields import (
    Checked,
    Choice,
    Items,
    Name,
    Number,
    Table,
    Text,
    Whole,
)
from facestage.contract.schemas.schema import (
    FileSchema,
    check_version,
    checked,
    decoded_meta,
    sections,
)

SCHEMA_VERSION = 1
PARTS = ("skin", "eyes", "mouth", "teeth", "other")
SKIN, EYES, MOUTH, TEETH, OTHER = range(len(PARTS))
WEIGHT_MAX = 10  # of a corner of a landmark, which may lie a little outside its triangle
PRIORS = ("box", "gaussian")


@dataclass(frozen=True)
class FaceModel:
    """Vertices, blendshape bases, textures coordinates and landmarks of a face.

    Shapes: n vertices, p polygons, u UV points, k identity modes, e expressions, d albedo modes.
    Frame: the model frame (metres, +Y up, looking along +Z), origin at the centre of the narrow
    face.
    """

    name: str
    license: str
    source: str
    vertices: Float32[np.ndarray, "vertices 3"]  # the mean face
    polygons: Int32[np.ndarray, "polygons 4"]  # quads; the fourth is -1 for a triangle
    polygon_uvs: Int32[np.ndarray, "polygons 4"]  # into `uvs`; the fourth is -1 for a triangle
    polygon_part: UInt8[np.ndarray, " polygons"]  # index into PARTS
    uvs: Float32[np.ndarray, "uvs 2"]  # in 0..1
    identity_names: tuple[str, ...]
    # metres per standard deviation
    identity_basis: Float32[np.ndarray, "identities vertices 3"]
    expression_names: tuple[str, ...]
    expression_basis: Float32[np.ndarray, "expressions vertices 3"]  # metres at weight 1
    albedo_mean: Float32[np.ndarray, "vertices 3"]  # linear diffuse RGB in (0, 1)
    # change of log albedo per standard deviation
    albedo_basis: Float32[np.ndarray, "albedos vertices 3"]
    # scheme -> 3 vertex indices and 3 barycentric weights of each landmark
    landmarks: Mapping[str, Num[np.ndarray, "_ 6"]]
    # name -> vertex indices
    regions: Mapping[str, Integer[np.ndarray, " _"]] = field(default_factory=dict)
    # "box": weights in 0..1, "gaussian": unit variance; one word for all expressions, or one for
    # each.
    expression_prior: str | tuple[str, ...] = "box"
    # Where the published UV tile of the face lies in this atlas: corner u, v and scale.
    face_tile: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        n, u = len(self.vertices), len(self.uvs)
        expected = {
            "vertices": (n, 3),
            "polygons": (len(self.polygons), 4),
            "polygon_uvs": (len(self.polygons), 4),
            "polygon_part": (len(self.polygons),),
            "uvs": (u, 2),
            "identity_basis": (len(self.identity_names), n, 3),
            "expression_basis": (len(self.expression_names), n, 3),
            "albedo_mean": (n, 3),
            "albedo_basis": (len(self.albedo_basis), n, 3),
        }
        for attribute, shape in expected.items():
            array = getattr(self, attribute)
            if array.shape != shape:
                raise InputError(
                    f"Face model '{self.name}': {attribute} has shape {array.shape}, expected "
                    f"{shape}."
                )
            if not np.issubdtype(array.dtype, np.number):
                raise InputError(
                    f"Face model '{self.name}': {attribute} holds {array.dtype} values, "
                    "expected numbers."
                )
            if not np.isfinite(array).all():
                raise InputError(f"Face model '{self.name}': {attribute} holds NaN or infinity.")
        for attribute, limit in (("polygons", n), ("polygon_uvs", u)):
            array = getattr(self, attribute)
            if array.size and (array.max() >= limit or array[:, :3].min() < 0 or array.min() < -1):
                raise InputError(
                    f"Face model '{self.name}': {attribute} refers to a point outside "
                    f"0..{limit - 1}."
                )
        if ((self.polygons[:, 3] < 0) != (self.polygon_uvs[:, 3] < 0)).any():
            raise InputError(
                f"Face model '{self.name}': polygon_uvs has triangles where polygons has "
                "quads; expected the same."
            )
        # The fit works on the logarithm of the albedo.
        if n and not (self.albedo_mean.min() > 0 and self.albedo_mean.max() < 1):
            raise InputError(
                f"Face model '{self.name}': albedo_mean runs from {self.albedo_mean.min():.3g} to "
                f"{self.albedo_mean.max():.3g}, expected values between 0 and 1, both excluded."
            )
        for scheme, table in self.landmarks.items():
            if table.ndim != 2 or table.shape[1] != 6 or not _within(table[:, :3], n):
                raise InputError(
                    f"Face model '{self.name}': landmarks '{scheme}' refer to a point outside "
                    f"0..{n - 1}."
                )
            if (
                not np.allclose(table[:, 3:].sum(axis=1), 1, atol=1e-2)
                or (np.abs(table[:, 3:]) > WEIGHT_MAX).any()
            ):
                raise InputError(
                    f"Face model '{self.name}': landmarks '{scheme}' have weights that do not "
                    "add up to 1."
                )
        for region, indices in self.regions.items():
            if not _within(indices, n):
                raise InputError(
                    f"Face model '{self.name}': region '{region}' refers to a point outside "
                    f"0..{n - 1}."
                )
        if isinstance(self.expression_prior, tuple) and len(self.expression_prior) != len(
            self.expression_names
        ):
            raise InputError(
                f"Face model '{self.name}': expression_prior has {len(self.expression_prior)} "
                f"words for {len(self.expression_names)} expressions; expected one for each, or "
                "one for all."
            )
        words = (
            (self.expression_prior,)
            if isinstance(self.expression_prior, str)
            else self.expression_prior
        )
        for word in words:
            if word not in PRIORS:
                raise InputError(
                    f"Face model '{self.name}': expression_prior is '{word}', not box or gaussian."
                )

    @cached_property
    def expression_box(self) -> Bool[np.ndarray, " expressions"]:
        """The expressions whose weights lie in 0..1; the others are Gaussian with unit
        variance.
        """
        words = self.expression_prior
        if isinstance(words, str):
            words = (words,) * len(self.expression_names)
        return np.array([word == "box" for word in words], bool)

    @cached_property
    def triangles(self) -> Int32[np.ndarray, "triangles 3"]:
        """Vertex indices: each quad split along its first diagonal, in polygon
        order.
        """
        return split_quads(self.polygons)

    @cached_property
    def triangle_uvs(self) -> Int32[np.ndarray, "triangles 3"]:
        """UV indices, row for row with :attr:`triangles`."""
        return split_quads(self.polygon_uvs)

    @cached_property
    def triangle_part(self) -> UInt8[np.ndarray, " triangles"]:
        """The part of each triangle, row for row with :attr:`triangles`."""
        return np.repeat(self.polygon_part, 1 + (self.polygons[:, 3] >= 0))

    def landmark_vertices(
        self, scheme: str
    ) -> tuple[Int64[np.ndarray, "landmarks 3"], Float32[np.ndarray, "landmarks 3"]]:
        """Vertex indices and barycentric weights of a landmark scheme."""
        if scheme not in self.landmarks:
            known = ", ".join(sorted(self.landmarks)) or "none"
            raise InputError(
                f"Face model '{self.name}' has no landmarks of scheme '{scheme}'; it has: {known}."
            )
        table = self.landmarks[scheme]
        return table[:, :3].astype(np.int64), table[:, 3:].astype(np.float32)

    def shape(
        self,
        identity: Float[np.ndarray, " identities"] | None = None,
        expression: Float[np.ndarray, " expressions"] | None = None,
    ) -> Float32[np.ndarray, "vertices 3"]:
        """The vertices in the model frame for weights of identity and expression."""
        result = self.vertices
        if identity is not None and len(self.identity_names):
            result = result + np.tensordot(np.asarray(identity, np.float32), self.identity_basis, 1)
        if expression is not None and len(self.expression_names):
            result = result + np.tensordot(
                np.asarray(expression, np.float32), self.expression_basis, 1
            )
        return result

    def albedo(
        self, delta: Float[np.ndarray, " albedos"] | None = None
    ) -> Float32[np.ndarray, "vertices 3"]:
        """The diffuse albedo in (0, 1) for coefficients delta."""
        log_albedo = np.log(self.albedo_mean)
        if delta is not None and len(self.albedo_basis):
            log_albedo = log_albedo + np.tensordot(
                np.asarray(delta, np.float32), self.albedo_basis, 1
            )
        return np.minimum(np.exp(log_albedo), 0.999).astype(np.float32)

    def save(self, path: Path) -> None:
        """Write the model as one .npz."""
        meta = {
            "schema": SCHEMA_VERSION,
            "name": self.name,
            "license": self.license,
            "source": self.source,
            "identity_names": self.identity_names,
            "expression_names": self.expression_names,
            "expression_prior": self.expression_prior,
            "face_tile": self.face_tile,
        }
        arrays = {name: getattr(self, name) for name in _ARRAYS}
        arrays |= {f"landmarks/{name}": table for name, table in self.landmarks.items()}
        arrays |= {f"regions/{name}": indices for name, indices in self.regions.items()}
        write_arrays(path, arrays | {"meta": np.array(json.dumps(meta))}, compress=False)

    @classmethod
    def load(cls, path: Path) -> FaceModel:
        """Read a model that :meth:`save` wrote. Raises InputError for anything else."""
        subject, again = f"The face model '{path}'", "convert it again"
        arrays = sections(read_arrays(path, "face model", MODEL_ARRAYS_MAX), "landmarks", "regions")
        given = checked(FaceArrays(), arrays, subject, again)
        meta = decoded_meta(given.pop("meta"), subject, again)
        check_version(meta, SCHEMA_VERSION, subject, again)
        about = checked(FaceMeta(), meta, f"{subject} is damaged; its meta", again)
        del about["schema"]
        return cls(**about, **given)


_ARRAYS = (
    "vertices",
    "polygons",
    "polygon_uvs",
    "polygon_part",
    "uvs",
    "identity_basis",
    "expression_basis",
    "albedo_mean",
    "albedo_basis",
)
MODEL_ARRAYS_MAX = 2 * GIB
VERTICES_MAX = 5_000_000
COORDINATE_MAX = 1e9  # metres
LOG_ALBEDO_MAX = 1e3
UV_LOW, UV_HIGH = -1.0, 2.0  # a little beyond the square; textures are painted as far as they reach


class _Prior(Checked):
    """One word for all expressions, or one for each."""

    def __init__(self) -> None:
        super().__init__(f"{' or '.join(PRIORS)}, or a list of them")

    def _deserialize(
        self, value: Any, attr: str | None, data: Any, **kwargs: Any
    ) -> str | tuple[str, ...]:
        field = Items(Choice(PRIORS)) if isinstance(value, list) else Choice(PRIORS)
        found: str | tuple[str, ...] = field.deserialize(value)
        return found


class FaceMeta(FileSchema):
    """What a face model's file says beside its arrays."""

    schema = Whole(SCHEMA_VERSION, SCHEMA_VERSION)
    name = Text()
    license = Text()
    source = Text()
    identity_names = Items(Name())
    expression_names = Items(Name())
    expression_prior = _Prior()
    face_tile = Items(Number(-1e3, 1e3), 3, 3)


class FaceArrays(FileSchema):
    """The arrays of a face model's file; which of them belong together, FaceModel checks."""

    dimensions: ClassVar = {"vertices": (1, VERTICES_MAX), "polygons": (1, VERTICES_MAX)}

    vertices = Array(("vertices", 3), minimum=-COORDINATE_MAX, maximum=COORDINATE_MAX)
    polygons = Array(("polygons", 4), WHOLE, minimum=-1)
    polygon_uvs = Array(("polygons", 4), WHOLE, minimum=-1)
    polygon_part = Array(("polygons",), WHOLE, minimum=0, maximum=len(PARTS) - 1)
    uvs = Array(("uvs", 2), minimum=UV_LOW, maximum=UV_HIGH)
    identity_basis = Array(
        ("modes", "vertices", 3), minimum=-COORDINATE_MAX, maximum=COORDINATE_MAX
    )
    expression_basis = Array(
        ("expressions", "vertices", 3), minimum=-COORDINATE_MAX, maximum=COORDINATE_MAX
    )
    albedo_mean = Array(("vertices", 3), minimum=0, maximum=1)
    albedo_basis = Array(("colors", "vertices", 3), minimum=-LOG_ALBEDO_MAX, maximum=LOG_ALBEDO_MAX)
    landmarks = Table(Array(("points", 6)), load_default=dict)
    regions = Table(Array(("members",), WHOLE, minimum=0), load_default=dict)
    meta = Words()


def _within(indices: Num[np.ndarray, " ..."], count: int) -> bool:
    return not indices.size or bool(indices.min() >= 0 and indices.max() < count)


def split_quads(polygons: Integer[np.ndarray, "polygons 4"]) -> Integer[np.ndarray, "triangles 3"]:
    """The triangles of quads and triangles, whose fourth is -1, keeping polygon order."""
    triangles = np.stack([polygons[:, [0, 1, 2]], polygons[:, [0, 2, 3]]], axis=1)
    keep = np.stack([np.ones(len(polygons), bool), polygons[:, 3] >= 0], axis=1)
    return np.ascontiguousarray(triangles[keep])

"""The Basel Face Model: 2009 (Paysan et al.), 2017 (Gerig et al. 2018, "Morphable Face Models") and
2019.

Formats, as Basel's own software and the public readers of it have them (scalismo-faces, statismo,
eos):

- ``01_MorphableModel.mat`` (2009): shapeMU, shapePC (160470, 199) with unit columns, shapeEV (199,
  1) standard deviations, in micrometers, x y z of each of 53490 vertices in turn; texMU, texPC,
  texEV likewise in 0..255; tl (106466, 3), from 1.
- ``model2017-1_bfm_nomouth.h5``, ``model2017-1_face12_nomouth.h5``, ``model2019_bfm.h5``,
  ``model2019_face12.h5``, ``model2019_fullHead.h5``, ``model2009-publicmm1-bfm.h5`` (statismo's
  HDF5): shape, color and expression, each with model/mean (3n), model/pcaBasis (3n, k) with unit
  columns, model/pcaVariance (k); shape/representer/cells (3, t), from 0; metadata/landmarks/json,
  named points on the mean. Millimeters; colors in 0..1.

+X is the subject's left, +Y up, +Z forward. 2009 has no expressions. The mean of the 2017 and 2019
expressions is not the neutral face but the mean of the expressions it was learned from: here it is
one more shape, ``expressionMean``, of weight 0 to 1, and the others are its Gaussian modes.

Colors are sRGB (scalismo-faces issue 25: "values are actually sRGB in model files") and were
scanned under even light; what shading they hold goes into the albedo. A mode becomes a change of
log linear albedo by its symmetric difference at one standard deviation; docs/face-models.md says
how far that holds.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.face_model import SKIN, FaceModel
from facestage.contract.files.color import srgb_to_linear
from facestage.contract.files.reading import GIB
from facestage.models.anatomy.regions import face_regions, outward, quads_of
from facestage.models.correspondence.embedding import SCHEME, landmark_schemes, table_of_vertices
from facestage.models.files.hdf5_file import TOTAL_LIMIT, read_hdf5
from facestage.models.files.mat_file import read_mat
from facestage.models.files.published_file import check_head, check_numbers, find_published
from facestage.models.mesh.unwrap import SKIN_TILE, unwrap
from facestage.system.in_child import ChildLimits, Reader, ReaderFailedError, read_in_child

SOURCE = "https://faces.dmi.unibas.ch/bfm"
LICENSE = (
    "Basel Face Model licence (University of Basel): internal, non-commercial research, "
    "evaluation and testing only"
)
NAMES = (
    "model2019_fullHead.h5",
    "model2019_bfm.h5",
    "model2019_face12.h5",
    "model2017-1_bfm_nomouth.h5",
    "model2017-1_face12_nomouth.h5",
    "01_MorphableModel.mat",
    "model2009-publicmm1-bfm.h5",
)
_FETCH = (
    "expected 01_MorphableModel.mat, model2017-1_bfm_nomouth.h5 or another file of the "
    f"model from {SOURCE}"
)
VERTEX_COUNT_2009 = 53490
# Many more than any published file has; a damaged file must not ask for all memory, nor for ever.
_VERTEX_MAX, _MODES_MAX = 250_000, 2000
_LIMITS = ChildLimits(memory=3 * GIB, seconds=4, array_bytes=TOTAL_LIMIT)
_NAMES_2009 = ("shapeMU", "shapePC", "shapeEV", "texMU", "texPC", "texEV")
_PCA = ("mean", "pcaBasis", "pcaVariance")
_CELLS, _POINTS = ("shape/representer/cells", "representer/cells"), "metadata/landmarks/json"
_NAMES_STATISMO = (
    *(f"{group}/model/{name}" for group in ("shape", "color", "expression") for name in _PCA),
    *_CELLS,
    _POINTS,
)
_DARK, _BRIGHT = 1 / 255, 0.99  # sRGB: the fit works on the logarithm of the albedo
# The ibug landmarks that Basel's named points are.
_NAMED = {
    "center.chin.tip": 8,
    "center.nose.tip": 30,
    "right.eye.corner_outer": 36,
    "right.eye.corner_inner": 39,
    "left.eye.corner_inner": 42,
    "left.eye.corner_outer": 45,
    "right.lips.corner": 48,
    "center.lips.upper.outer": 51,
    "left.lips.corner": 54,
    "center.lips.lower.outer": 57,
    "center.lips.upper.inner": 62,
    "center.lips.lower.inner": 66,
}
# Vertices of the 2009 mesh, from 1: github.com/anilbas/BFMLandmarks, Landmarks68_BFM.anl (Anil Bas
# 2017, MIT).
_LANDMARKS_2009 = (
    22143, 22813, 22840, 23250, 44124, 45884, 47085, 47668, 48188, 48708, 49299, 50498, 52457,
    32022, 32386,
    32359, 32979, 38886, 39636, 40030, 40238, 40433, 41172, 41368, 41578, 42011, 42646, 8291,
    8305, 8314, 8320,
    6783, 7687, 8331, 8977, 9879, 1832, 3760, 5050, 6087, 4546, 3516, 10731, 11758, 12919, 14859,
    13191, 12157,
    5523, 6155, 7442, 8345, 9506, 10799, 11199, 10179, 9277, 8374, 7471, 6566, 5909, 7322, 8354,
    9386, 10941,
    9141, 8367, 7194,
)  # fmt: skip


def load_bfm(path: Path, default_head: Callable[[], FaceModel]) -> FaceModel:
    """The whole model: every identity, expression and color mode of the file, without eyeballs or
    teeth (it has none).

    ``path``: one of the published files, or the folder it lies in. Raises InputError when it is
    something else.
    """
    path = find_published(Path(path), NAMES, "Basel Face Model", _FETCH)
    read = _read_2009 if path.suffix.lower() == ".mat" else _read_statismo
    return _assemble(path, read(path), default_head)


@dataclass(frozen=True)
class _Published:
    """What a file holds, in metres and sRGB of 0..1."""

    name: str
    vertices: np.ndarray  # (n, 3) float64, the mean
    triangles: np.ndarray  # (t, 3) int64
    identity: np.ndarray  # (k, n, 3) float32 per standard deviation
    color: np.ndarray  # (n, 3), the mean
    color_modes: np.ndarray  # (d, n, 3) per standard deviation
    expressions: np.ndarray | None = None  # (e, n, 3) float32, the first is their mean
    # A table (68, 6) of the ibug landmarks, or (0, 6), and the places of single ones.
    landmarks: np.ndarray = field(default_factory=lambda: np.zeros((0, 6)))
    known: dict[int, np.ndarray] = field(default_factory=dict)


def _read_2009(path: Path) -> _Published:
    size = 3 * VERTEX_COUNT_2009
    data = _arrays(read_mat, path, (*_NAMES_2009, "tl"), "a MATLAB")
    arrays = {name: data.get(name, np.zeros(0)) for name in _NAMES_2009}
    for kind in ("shape", "tex"):
        modes = arrays[f"{kind}PC"].shape[-1] if arrays[f"{kind}PC"].ndim == 2 else 0
        for suffix, shape in (("MU", (size, 1)), ("PC", (size, modes)), ("EV", (modes, 1))):
            _check(path, kind + suffix, arrays[kind + suffix], shape)
    triangles = np.asarray(data.get("tl", np.zeros(0)))
    if triangles.ndim != 2 or triangles.shape[1] != 3:
        raise InputError(
            f"'{path}' is no Basel Face Model: tl has shape {triangles.shape}, not (t, 3); {_FETCH}"
        )
    micrometer = 1e-6
    return _Published(
        name="Basel Face Model 2009",
        vertices=_vertices(arrays["shapeMU"]) * micrometer,
        triangles=triangles.astype(np.int64) - 1,
        identity=_modes(arrays["shapePC"], arrays["shapeEV"]) * np.float32(micrometer),
        color=_vertices(arrays["texMU"]) / 255,
        color_modes=_modes(arrays["texPC"], arrays["texEV"]) / np.float32(255),
        landmarks=table_of_vertices(np.array(_LANDMARKS_2009) - 1),
    )


def _read_statismo(path: Path) -> _Published:
    millimeter = 1e-3
    data = _arrays(read_hdf5, path, _NAMES_STATISMO, "an HDF5")
    mean, basis = _pca(path, data, "shape")
    color, color_basis = _pca(path, data, "color", len(mean))
    has_expressions = any(name.startswith("expression/") for name in data)
    expression = _pca(path, data, "expression", len(mean)) if has_expressions else None
    cells = next((data[name] for name in _CELLS if name in data), np.zeros(0))
    if cells.ndim != 2 or cells.shape[0] != 3 or cells.dtype.kind not in "iu":
        raise InputError(f"'{path}' is no Basel Face Model: it lacks {_CELLS[0]} (3, t); {_FETCH}")
    triangles = cells.T.astype(np.int64)
    named = _named_points(path, data)
    year = next((year for year in ("2009", "2017", "2019") if year in path.name), "")
    known: dict[int, np.ndarray] = {}
    if named:
        known = {
            _NAMED[name]: point * millimeter for name, point in named.items() if name in _NAMED
        }
    expressions = None
    if expression is not None:
        expressions = np.concatenate(
            [expression[0].astype(np.float32)[None], expression[1]]
        ) * np.float32(millimeter)
    return _Published(
        name=f"Basel Face Model {year}".strip(),
        vertices=mean * millimeter,
        triangles=triangles,
        identity=basis * np.float32(millimeter),
        color=color,
        color_modes=color_basis,
        expressions=expressions,
        known=known,
    )


def _assemble(
    path: Path, published: _Published, default_head: Callable[[], FaceModel]
) -> FaceModel:
    mean, triangles = published.vertices, published.triangles
    if triangles.size == 0 or triangles.min() < 0 or triangles.max() >= len(mean):
        raise InputError(
            f"'{path}' is damaged: its triangles refer to vertices outside 0..{len(mean) - 1}; "
            f"{_FETCH}"
        )
    check_head(path, mean, "Basel Face Model", _FETCH)
    triangles = outward(mean, triangles)
    tables = landmark_schemes(published.landmarks, mean, triangles, default_head, published.known)
    regions = face_regions(mean, np.ones(len(mean), bool), tables[SCHEME])
    centre = mean[regions["narrow_face"]].mean(axis=0)
    uvs, triangle_uvs = unwrap(mean, triangles)
    albedo, albedo_basis = log_albedo(published.color, published.color_modes)
    expressions = published.expressions
    if expressions is None:
        expressions = np.zeros((0, len(mean), 3), np.float32)
    names = tuple(
        "expressionMean" if k == 0 else f"expression{k - 1:03d}" for k in range(len(expressions))
    )
    return FaceModel(
        name=published.name,
        license=LICENSE,
        source=SOURCE,
        vertices=(mean - centre).astype(np.float32),
        polygons=quads_of(triangles),
        polygon_uvs=quads_of(triangle_uvs),
        polygon_part=np.full(len(triangles), SKIN, np.uint8),
        uvs=uvs,
        identity_names=tuple(f"identity{k:03d}" for k in range(len(published.identity))),
        identity_basis=published.identity,
        expression_names=names,
        expression_basis=expressions,
        expression_prior=("box",) * min(len(names), 1) + ("gaussian",) * (len(names) - 1),
        albedo_mean=albedo,
        albedo_basis=albedo_basis,
        landmarks=tables,
        regions=regions,
        face_tile=SKIN_TILE,
    )


def log_albedo(color: np.ndarray, modes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean linear albedo (n, 3) float32 and basis (d, n, 3) float32 of log albedo, from sRGB (n, 3)
    and its modes.

    modes (d, n, 3): change of sRGB in 0..1 per standard deviation.
    """
    middle = np.log(_linear(color))
    basis = np.empty(modes.shape, np.float32)
    for k, mode in enumerate(modes):
        basis[k] = 0.5 * (np.log(_linear(color + mode)) - np.log(_linear(color - mode)))
    return np.exp(middle).astype(np.float32), basis


def _linear(srgb: np.ndarray) -> np.ndarray:
    return srgb_to_linear(np.clip(srgb, _DARK, _BRIGHT))


def _arrays(reader: Reader, path: Path, names: tuple[str, ...], kind: str) -> dict[str, np.ndarray]:
    """The arrays of ``names`` that the file has; ``kind`` is the file's, in words."""
    try:
        return read_in_child(reader, path, names, _LIMITS)
    except ReaderFailedError as error:
        raise InputError(f"'{path}' cannot be read as {kind} file ({error}); {_FETCH}") from error


def _pca(
    path: Path, data: dict[str, np.ndarray], group: str, vertices: int | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Mean (n, 3) float64 and modes (k, n, 3) float32 per standard deviation of one of the file's
    models.
    """
    names = [f"{group}/model/{name}" for name in _PCA]
    missing = [name for name in names if name not in data]
    if missing:
        raise InputError(
            f"'{path}' is no Basel Face Model, it lacks {', '.join(missing)}; {_FETCH}"
        )
    mean, basis, variance = (data[name] for name in names)
    size, modes = mean.size, variance.size
    if (
        size % 3
        or size > 3 * _VERTEX_MAX
        or modes > _MODES_MAX
        or size != 3 * (vertices or size // 3)
    ):
        raise InputError(
            f"'{path}' is no Basel Face Model: {names[0]} has {size} entries; {_FETCH}"
        )
    if basis.shape != (size, modes):
        raise InputError(
            f"'{path}' is no Basel Face Model: {names[1]} has shape {basis.shape}, not "
            f"{(size, modes)}; {_FETCH}"
        )
    for name, array in zip(names, (mean, basis, variance), strict=True):
        _check(path, name, array, array.shape)
    return _vertices(mean), _modes(basis, np.sqrt(np.maximum(variance, 0.0)))


def _named_points(path: Path, data: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Basel's landmarks by name, in the file's unit; none where it has none."""
    if _POINTS not in data:
        return {}
    try:
        entries = json.loads(data[_POINTS].tobytes())
        points = {
            str(entry["id"]): np.array(entry["coordinates"], float).reshape(3) for entry in entries
        }
        if not np.isfinite(list(points.values())).all():
            raise ValueError("NaN or infinity")
    except (ValueError, TypeError, KeyError, OverflowError, RecursionError) as error:
        raise InputError(
            f"'{path}' has damaged landmarks in {_POINTS} ({_short(error)})."
        ) from error
    return points


def _vertices(flat: np.ndarray) -> np.ndarray:
    return np.asarray(flat, np.float64).reshape(-1, 3)


def _modes(basis: np.ndarray, deviation: np.ndarray) -> np.ndarray:
    """(k, n, 3) float32 from unit columns (3n, k) and their standard deviations."""
    scaled = np.asarray(basis, np.float32).T * np.asarray(deviation, np.float32).reshape(-1, 1)
    return np.ascontiguousarray(scaled).reshape(len(scaled), -1, 3)


def _check(path: Path, name: str, array: np.ndarray, shape: tuple[int, ...]) -> None:
    if array.size == 0 and 0 not in shape:
        raise InputError(f"'{path}' is no Basel Face Model, it lacks {name}; {_FETCH}")
    if array.shape != shape or array.dtype.kind not in "iuf":
        raise InputError(
            f"'{path}' is no Basel Face Model: {name} is {array.dtype} {array.shape}, not "
            f"{shape}; {_FETCH}"
        )
    check_numbers(path, name, array, _FETCH)


def _short(error: Exception) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__

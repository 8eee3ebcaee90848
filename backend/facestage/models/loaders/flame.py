"""FLAME (Li, Bolkart, Black, Li and Romero 2017, "Learning a model of facial shape and expression
from 4D scans").

Reads the published ``generic_model.pkl`` (2017, 2019, 2020; also ``female_model.pkl`` and
``male_model.pkl``), ``flame2023.pkl``, ``flame2023_Open.pkl``, and the same arrays as .npz. Format,
as the code that its authors publish reads it (github.com/TimoBolkart/TF_FLAME,
github.com/soubhiksanyal/FLAME_PyTorch, github.com/vchoutas/smplx): v_template (5023, 3) m, f (9976,
3), shapedirs (5023, 3, 400) scaled to standard deviations, 300 of identity before 100 of
expression, posedirs (5023, 3, 36), J_regressor (5, 5023), weights (5023, 5), kintree_table (2, 5);
joints: root, neck, jaw, left eye, right eye; +Y up, looking along +Z. The eyeballs are the vertices
3931 to 5022.

Beside the model, each used when it is there: ``landmark_embedding.npy`` (full_lmk_faces_idx,
full_lmk_bary_coords: the 68 ibug landmarks), ``flame_static_embedding.pkl`` (lmk_face_idx,
lmk_b_coords: the last 51 of them), and ``FLAME_texture.npz`` or
``albedoModel2020_FLAME_albedoPart.npz`` for the authors' UV layout (vt, ft) alone.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy import sparse

from facestage.contract.errors import InputError
from facestage.contract.face_model import EYES, SKIN, FaceModel
from facestage.contract.files.reading import GIB, MIB
from facestage.contract.files.storage import read_arrays
from facestage.models.anatomy.regions import eyeball_colors, face_regions, quads_of
from facestage.models.anatomy.skin import albedo_basis
from facestage.models.correspondence.embedding import SCHEME, landmark_schemes, table_of_triangles
from facestage.models.files.published_file import (
    MODEL_LIMIT,
    check_head,
    check_numbers,
    find_published,
)
from facestage.models.files.restricted_pickle import read_pickle
from facestage.models.mesh.skinning import Skeleton, gaze_shapes
from facestage.models.mesh.unwrap import SKIN_TILE, unwrap

SOURCE = "https://flame.is.tue.mpg.de"
OPEN_LICENSE = "CC-BY-4.0 (FLAME 2023 Open, Max Planck Institute for Intelligent Systems)"
LICENSE = (
    "FLAME model licence of the Max Planck Society: non-commercial scientific research, education "
    "and art only (https://flame.is.tue.mpg.de/modellicense.html); FLAME 2023 Open alone is "
    "CC-BY-4.0"
)
MODEL_NAMES = (
    "flame2023_Open.pkl",
    "flame2023.pkl",
    "generic_model.pkl",
    "FLAME_NEUTRAL.pkl",
    "flame2023.npz",
)
LANDMARK_NAMES = ("landmark_embedding.npy", "flame_static_embedding.pkl")
UV_NAMES = ("FLAME_texture.npz", "flame_texture.npz", "albedoModel2020_FLAME_albedoPart.npz")
# The textures themselves, which are not read, have up to 2 GB; the layout has 0.3 MB.
TEXTURE_LIMIT, UV_LIMIT = 8 * GIB, 16 * MIB
VERTEX_COUNT, TRIANGLE_COUNT, EYES_START = 5023, 9976, 3931
IDENTITY_COUNT, EXPRESSION_COUNT, JOINT_COUNT = 300, 100, 5
_JAW, _LEFT_EYE, _RIGHT_EYE = 2, 3, 4
# Rotation vectors at weight 1. The authors show the jaw open by pi/8; sideways and forward it moves
# about 1 cm.
_JAW_SHAPES = {
    "jawOpen": (np.pi / 8, 0.0, 0.0),
    "jawLeft": (0.0, 0.1, 0.0),
    "jawRight": (0.0, -0.1, 0.0),
}
_SHAPES = {
    "v_template": (VERTEX_COUNT, 3),
    "f": (TRIANGLE_COUNT, 3),
    "shapedirs": (VERTEX_COUNT, 3, IDENTITY_COUNT + EXPRESSION_COUNT),
    "posedirs": (VERTEX_COUNT, 3, 36),
    "J_regressor": (JOINT_COUNT, VERTEX_COUNT),
    "weights": (VERTEX_COUNT, JOINT_COUNT),
    "kintree_table": (2, JOINT_COUNT),
}


def load_flame(path: Path, default_head: Callable[[], FaceModel]) -> FaceModel:
    """The whole model: 300 identity modes, 100 Gaussian expressions, and jaw and gaze as shapes of
    weight 0 to 1.

    ``path``: the model's .pkl or .npz, or the folder it lies in. Raises InputError when it is
    something else.
    """
    path = find_published(Path(path), MODEL_NAMES, "FLAME model", _FETCH)
    arrays = _read(path)
    mean = arrays["v_template"].astype(np.float64)
    check_head(path, mean, "FLAME model", _FETCH)
    triangles = arrays["f"].astype(np.int64)
    if triangles.min() < 0 or triangles.max() >= VERTEX_COUNT:
        raise InputError(
            f"'{path}' is damaged: f refers to vertices outside 0..{VERTEX_COUNT - 1}; {_FETCH}"
        )
    modes = np.moveaxis(arrays["shapedirs"], -1, 0)
    names, shapes = _posed_shapes(arrays, mean)
    eyes = np.arange(VERTEX_COUNT) >= EYES_START
    part = np.where(eyes[triangles].all(axis=1), EYES, SKIN).astype(np.uint8)
    landmarks = _landmarks(path.parent, mean, triangles[part == SKIN], triangles, default_head)
    regions = face_regions(mean, ~eyes, landmarks[SCHEME])
    mean = mean - mean[regions["narrow_face"]].mean(axis=0)
    uvs, triangle_uvs, tile = _uvs(path.parent, mean, triangles)
    color, color_basis = albedo_basis(mean, triangles[part == SKIN], ~eyes)
    middle = (EYES_START + VERTEX_COUNT) // 2
    for start, end in ((EYES_START, middle), (middle, VERTEX_COUNT)):
        color[start:end] = eyeball_colors(mean[start:end])
        side = "left" if mean[start:end, 0].mean() > 0 else "right"
        regions[f"eye_{side}"] = np.arange(start, end, dtype=np.int32)
    expressions = tuple(f"expression{k:03d}" for k in range(EXPRESSION_COUNT))
    return FaceModel(
        name="FLAME",
        license=OPEN_LICENSE if "open" in path.stem.lower() else LICENSE,
        source=SOURCE,
        vertices=mean.astype(np.float32),
        polygons=quads_of(triangles),
        polygon_uvs=quads_of(triangle_uvs),
        polygon_part=part,
        uvs=uvs,
        identity_names=tuple(f"identity{k:03d}" for k in range(IDENTITY_COUNT)),
        identity_basis=np.ascontiguousarray(modes[:IDENTITY_COUNT], np.float32),
        expression_names=expressions + names,
        expression_basis=np.concatenate([modes[IDENTITY_COUNT:], shapes]).astype(np.float32),
        expression_prior=("gaussian",) * len(expressions) + ("box",) * len(names),
        albedo_mean=color,
        albedo_basis=color_basis,
        landmarks=landmarks,
        regions=regions,
        face_tile=tile,
    )


_FETCH = f"expected FLAME's generic_model.pkl, flame2023.pkl or flame2023_Open.pkl from {SOURCE}"


def _read(path: Path) -> dict[str, Any]:
    """The model's arrays, with their published shapes."""
    if path.suffix.lower() == ".npz":
        data: dict[str, Any] = dict(read_arrays(path, "FLAME model", MODEL_LIMIT, _SHAPES))
    else:
        data = read_pickle(path, "FLAME model")
    missing = [name for name in _SHAPES if name not in data]
    if missing:
        raise InputError(f"'{path}' is no FLAME model, it lacks {', '.join(missing)}; {_FETCH}")
    result = {}
    for name, shape in _SHAPES.items():
        array = _array(data[name])
        if array.shape != shape or array.dtype.kind not in "iuf":
            raise InputError(
                f"'{path}' is no FLAME model: {name} is {array.dtype} {array.shape}, not "
                f"{shape}; {_FETCH}"
            )
        check_numbers(path, name, array, _FETCH)
        result[name] = array
    return result


def _array(value: Any) -> np.ndarray:
    """The value as an array; an empty one of what is neither an array nor a sparse matrix."""
    # The reader of pickles lets no matrix through that is large when it is written out.
    value = value.toarray() if sparse.issparse(value) else value
    return value if isinstance(value, np.ndarray) else np.zeros(0)


def _posed_shapes(arrays: dict[str, Any], mean: np.ndarray) -> tuple[tuple[str, ...], np.ndarray]:
    """Names and offsets (s, n, 3) of the jaw's and the eyes' turns on the mean face, pose
    correctives included.
    """
    # The root's parent is -1, which the files hold as an unsigned number.
    parents = np.where(np.arange(JOINT_COUNT) == 0, 0, arrays["kintree_table"][0].astype(np.int64))
    if (parents[1:] >= np.arange(1, JOINT_COUNT)).any() or (parents < 0).any():
        raise InputError(
            f"The FLAME model is damaged: kintree_table orders its joints wrongly; {_FETCH}"
        )
    skeleton = Skeleton(
        arrays["J_regressor"].astype(np.float64) @ mean,
        parents,
        arrays["weights"].astype(np.float64),
        np.moveaxis(arrays["posedirs"].astype(np.float64), -1, 0),
        corrective_joints=1,
    )
    gaze_names, gaze = gaze_shapes(skeleton, mean, _LEFT_EYE, _RIGHT_EYE)
    jaw = [skeleton.shape(mean, _JAW, rotation) for rotation in _JAW_SHAPES.values()]
    return (*_JAW_SHAPES, *gaze_names), np.stack(jaw + gaze)


def _landmarks(
    folder: Path,
    vertices: np.ndarray,
    skin: np.ndarray,
    triangles: np.ndarray,
    default_head: Callable[[], FaceModel],
) -> dict[str, np.ndarray]:
    """Landmark tables: from the embedding beside the model, what it lacks carried over from the
    default head.
    """
    for name in LANDMARK_NAMES:
        path = folder / name
        if not path.is_file():
            continue
        data = read_pickle(path, "FLAME landmark file")
        for faces, weights in (
            ("full_lmk_faces_idx", "full_lmk_bary_coords"),
            ("lmk_face_idx", "lmk_b_coords"),
        ):
            if faces in data and weights in data:
                rows, points = _array(data[faces]).reshape(-1), _array(data[weights])
                table = table_of_triangles(
                    triangles, rows, points.reshape(-1, 3 if points.size % 3 == 0 else 1), path
                )
                return landmark_schemes(table, vertices, skin, default_head)
        raise InputError(
            f"The FLAME landmark file '{path}' lacks full_lmk_faces_idx and full_lmk_bary_coords; "
            "expected the landmark_embedding.npy of DECA or the flame_static_embedding.pkl of "
            "RingNet, or none."
        )
    return landmark_schemes(np.zeros((0, 6)), vertices, skin, default_head)


def _uvs(
    folder: Path, vertices: np.ndarray, triangles: np.ndarray
) -> tuple[np.ndarray, np.ndarray, tuple[float, float, float]]:
    """The authors' UV points, triangles and tile where they lie beside the model, else ones made
    here.
    """
    for name in UV_NAMES:
        path = folder / name
        if not path.is_file():
            continue
        data = read_arrays(path, "FLAME texture file", UV_LIMIT, ("vt", "ft"), TEXTURE_LIMIT)
        points, faces = data.get("vt"), data.get("ft")
        if (
            points is None
            or faces is None
            or points.ndim != 2
            or points.shape[1] < 2
            or points.dtype.kind not in "iuf"
            or not np.isfinite(points).all()
            or faces.dtype.kind not in "iu"
            or faces.shape != triangles.shape
            or faces.min() < 0
            or faces.max() >= len(points)
        ):
            raise InputError(
                f"The FLAME texture file '{path}' has no UV layout of {TRIANGLE_COUNT} triangles "
                "(vt, ft); remove it, or fetch it again."
            )
        return (
            np.clip(points[:, :2], 0, 1).astype(np.float32),
            faces.astype(np.int32),
            (0.0, 0.0, 1.0),
        )
    return (*unwrap(vertices, triangles), SKIN_TILE)

"""GNM Head v3 (Google 2026, "GNM Head: A Generative aNthropometric Model of the human head",
arXiv:2607.23687).

Reads ``gnm_head.npz`` as github.com/google/GNM and huggingface.co/google/gnm-v3 publish it (v3_0;
gnm/shape/gnm_xnp.py and README.md say what is in it): template_vertex_positions (V, 3) m,
vertex_identity_basis (I, V, 3), expression_basis (E, V, 3) for coefficients of unit variance, quads
(Q, 4), quad_uvs (Q, 4, 2) with one unit square for each region, vertex_groups (G, V) in 0..1 and
their names, joints that linear blend skinning and pose correctives turn (template_joint_positions
(J, 3), joint_parent_indices, skinning_weights (J, V), pose_correctives_regressor (9 J, 3 V)), and
names of modes and joints. The head has V = 17821, I = 253, E = 383, J = 4. +X is the subject's
left, +Y up, +Z forward.

The landmarks are in a file of their own, ``head_sparse_68.txt``: 68 rows of three vertices, each
with its weight. It is looked for beside the model and at its place in the repository
(data/landmarks, two folders up). Versions of it went round whose line of the jaw is not in the ibug
order; it is put in order here.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.face_model import EYES, MOUTH, OTHER, SKIN, TEETH, FaceModel
from facestage.contract.files.reading import MIB, read_bytes
from facestage.contract.files.storage import read_arrays
from facestage.models.anatomy.regions import (
    GUM,
    IRIS,
    PART_ALBEDO,
    PUPIL,
    TONGUE,
    face_regions,
    landmark_points,
)
from facestage.models.anatomy.skin import albedo_basis
from facestage.models.correspondence.embedding import SCHEME, WEIGHT_MAX, landmark_schemes
from facestage.models.files.published_file import (
    MODEL_LIMIT,
    check_head,
    check_numbers,
    find_published,
)
from facestage.models.mesh.skinning import Skeleton, gaze_shapes

LICENSE = "Apache-2.0 (Google LLC)"
SOURCE = "https://github.com/google/GNM"
NAMES = ("gnm_head.npz",)
LANDMARKS = "head_sparse_68.txt"
LANDMARKS_LIMIT = 1 * MIB  # it has 5 kB
_FETCH = f"expected gnm_head.npz (v3) from {SOURCE} or https://huggingface.co/google/gnm-v3"
_JAW = 17
# Where the unit square of each region lies in the atlas: corner u, v and side.
_TILES = {
    "skin": (0.0, 0.25, 0.75),
    "left_eye": (0.0, 0.0, 0.2),
    "left_cornea": (0.2, 0.0, 0.2),
    "right_eye": (0.4, 0.0, 0.2),
    "right_cornea": (0.6, 0.0, 0.2),
    "teeth": (0.8, 0.0, 0.2),
    "tongue": (0.75, 0.25, 0.25),
}


def load_gnm(path: Path, default_head: Callable[[], FaceModel]) -> FaceModel:
    """The whole model: identity modes, Gaussian expressions, and both eyes' gaze as shapes of
    weight 0 to 1.

    ``path``: gnm_head.npz, or the folder it lies in. Raises InputError when it is something else.
    """
    path = find_published(Path(path), NAMES, "GNM head", _FETCH)
    data = _read(path)
    mean = data["template_vertex_positions"].astype(np.float64)
    check_head(path, mean, "GNM head", _FETCH)
    quads = data["quads"].astype(np.int32)
    groups = dict(
        zip(map(str, data["vertex_group_names"]), data["vertex_groups"] > 0.5, strict=True)
    )
    missing = [name for name in ("skin", "left_eye", "right_eye") if name not in groups]
    if missing:
        raise InputError(
            f"'{path}' is no GNM head: it has no vertex group {', '.join(missing)}; {_FETCH}"
        )
    part, region = _parts(quads, groups)
    skin = np.zeros(len(mean), bool)
    skin[quads[part == SKIN]] = True
    triangles = np.concatenate(
        [quads[part == SKIN][:, [0, 1, 2]], quads[part == SKIN][:, [0, 2, 3]]]
    )
    landmarks = landmark_schemes(_landmarks(path, mean), mean, triangles, default_head)
    regions = face_regions(mean, skin, landmarks[SCHEME])
    for side in ("left", "right"):
        regions[f"eye_{side}"] = np.flatnonzero(groups[f"{side}_eye"]).astype(np.int32)
    names, gaze = _gaze(path, data, mean)
    mean = mean - mean[regions["narrow_face"]].mean(axis=0)
    color, color_basis = _colors(mean, triangles, skin, quads, part, groups)
    uvs, quad_uvs = _atlas(data["quad_uvs"].astype(np.float64), quads, region)
    expressions = tuple(map(str, data["expression_names"]))
    return FaceModel(
        name="GNM Head",
        license=LICENSE,
        source=SOURCE,
        vertices=mean.astype(np.float32),
        polygons=quads,
        polygon_uvs=quad_uvs,
        polygon_part=part,
        uvs=uvs,
        identity_names=tuple(map(str, data["identity_names"])),
        identity_basis=data["vertex_identity_basis"].astype(np.float32),
        expression_names=expressions + names,
        expression_basis=np.concatenate([data["expression_basis"].astype(np.float32), gaze]),
        expression_prior=("gaussian",) * len(expressions) + ("box",) * len(names),
        albedo_mean=color,
        albedo_basis=color_basis,
        landmarks=landmarks,
        regions=regions,
        face_tile=_TILES["skin"],
    )


def _read(path: Path) -> dict[str, np.ndarray]:
    """The arrays that are used, with shapes that agree."""
    needed = (
        "version",
        "variant",
        "template_vertex_positions",
        "template_joint_positions",
        "vertex_identity_basis",
        "expression_basis",
        "identity_names",
        "joint_names",
        "expression_names",
        "joint_parent_indices",
        "skinning_weights",
        "quads",
        "quad_uvs",
        "pose_correctives_regressor",
        "vertex_groups",
        "vertex_group_names",
    )
    data = read_arrays(path, "GNM head", MODEL_LIMIT, needed)
    missing = [name for name in needed if name not in data]
    if missing:
        raise InputError(f"'{path}' is no GNM head, it lacks {', '.join(missing)}; {_FETCH}")
    names = ("identity_names", "expression_names", "joint_names", "vertex_group_names")
    if any(data[name].ndim != 1 for name in (*names, "joint_parent_indices")) or any(
        data[name].ndim == 0 for name in ("template_vertex_positions", "quads")
    ):
        raise InputError(
            f"'{path}' is no GNM head: some of its arrays have other dimensions; {_FETCH}"
        )
    if str(data["variant"]) != "head" or not str(data["version"]).startswith("3"):
        raise InputError(
            f"'{path}' is the GNM variant '{str(data['variant'])[:20]}' of version "
            f"{str(data['version'])[:20]}; {_FETCH}"
        )
    v, q = len(data["template_vertex_positions"]), len(data["quads"])
    i, e, j = len(data["identity_names"]), len(data["expression_names"]), len(data["joint_names"])
    g = len(data["vertex_group_names"])
    shapes = {
        "template_vertex_positions": (v, 3),
        "template_joint_positions": (j, 3),
        "vertex_identity_basis": (i, v, 3),
        "expression_basis": (e, v, 3),
        "joint_parent_indices": (j,),
        "skinning_weights": (j, v),
        "quads": (q, 4),
        "quad_uvs": (q, 4, 2),
        "vertex_groups": (g, v),
        "pose_correctives_regressor": (9 * j, 3 * v),
    }
    for name, shape in shapes.items():
        array = data[name]
        if array.shape != shape or array.dtype.kind not in "iufb":
            raise InputError(
                f"'{path}' is no GNM head: {name} is {array.dtype} {array.shape}, not {shape}; "
                f"{_FETCH}"
            )
        check_numbers(path, name, array, _FETCH)
    if q == 0 or data["quads"].min() < 0 or data["quads"].max() >= v:
        raise InputError(
            f"'{path}' is damaged: quads refer to vertices outside 0..{v - 1}; {_FETCH}"
        )
    return data


def _parts(quads: np.ndarray, groups: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Part (q,) uint8 and UV region (q,) str of each polygon; later rules go over earlier ones."""

    def all_in(name: str) -> np.ndarray:
        return groups[name][quads].all(axis=1) if name in groups else np.zeros(len(quads), bool)

    part = np.full(len(quads), SKIN, np.uint8)
    region = np.full(len(quads), "skin", dtype="U12")
    rules = (
        ("mouth_sock", MOUTH, None),
        ("upper_teeth_and_gums", MOUTH, "teeth"),
        ("lower_teeth_and_gums", MOUTH, "teeth"),
        ("teeth", TEETH, "teeth"),
        ("tongue", MOUTH, "tongue"),
        ("left_eye", EYES, "left_eye"),
        ("right_eye", EYES, "right_eye"),
    )
    for name, label, tile in rules:
        rows = all_in(name)
        part[rows] = label
        if tile is not None:
            region[rows] = tile
    # The cornea is clear; the iris behind it is what is seen.
    for side in ("left", "right"):
        rows = all_in(f"{side}_eye") & all_in("eye_exteriors")
        part[rows], region[rows] = OTHER, f"{side}_cornea"
    return part, region


def _atlas(
    quad_uvs: np.ndarray, quads: np.ndarray, region: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """UV points (u, 2) in one square and (q, 4) int32 of them, from squares for each region that
    lie on each other.
    """
    corner = np.array([_TILES[name][:2] for name in region])
    side = np.array([_TILES[name][2] for name in region])
    placed = (corner[:, None] + side[:, None, None] * np.clip(quad_uvs, 0.0, 1.0)).astype(
        np.float32
    )
    # Two corners are one point where they are the same vertex at the same place.
    keys = np.column_stack([quads.ravel().astype(np.float64), placed.reshape(-1, 2)])
    points, rows = np.unique(keys, axis=0, return_inverse=True)
    return points[:, 1:].astype(np.float32), rows.reshape(quads.shape).astype(np.int32)


def _gaze(
    path: Path, data: dict[str, np.ndarray], mean: np.ndarray
) -> tuple[tuple[str, ...], np.ndarray]:
    names = [str(name) for name in data["joint_names"]]
    parents = data["joint_parent_indices"].astype(np.int64)
    if (
        "left_eye" not in names
        or "right_eye" not in names
        or (parents[1:] >= np.arange(1, len(parents))).any()
    ):
        raise InputError(
            f"'{path}' is no GNM head: its joints are {', '.join(names)[:80]}; {_FETCH}"
        )
    skeleton = Skeleton(
        data["template_joint_positions"].astype(np.float64),
        np.maximum(parents, 0),
        data["skinning_weights"].T.astype(np.float64),
        data["pose_correctives_regressor"].astype(np.float64).reshape(9 * len(names), len(mean), 3),
    )
    shape_names, shapes = gaze_shapes(
        skeleton, mean, names.index("left_eye"), names.index("right_eye")
    )
    return shape_names, np.stack(shapes).astype(np.float32)


def _colors(
    mean: np.ndarray,
    triangles: np.ndarray,
    skin: np.ndarray,
    quads: np.ndarray,
    part: np.ndarray,
    groups: dict[str, np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """Skin from melanin and haemoglobin harmonics (the model brings no statistics of color); fixed
    colors elsewhere.
    """
    color, basis = albedo_basis(mean, triangles, skin)
    for label in (OTHER, MOUTH, TEETH, EYES):
        used = np.unique(quads[part == label])
        color[used[~skin[used]]] = PART_ALBEDO[label]
    # Each is painted over what it is a part of.
    for name, value in (
        ("upper_teeth_and_gums", GUM),
        ("lower_teeth_and_gums", GUM),
        ("teeth", PART_ALBEDO[TEETH]),
        ("tongue", TONGUE),
        ("irises", IRIS),
        ("pupils", PUPIL),
    ):
        if name in groups:
            color[groups[name] & ~skin] = value
    return color, basis


def _landmarks(path: Path, vertices: np.ndarray) -> np.ndarray:
    """(68, 6) of the ibug scheme from the file that goes with the model, or (0, 6) without it."""
    folder = path.parent
    file = next(
        (
            f
            for f in (folder / LANDMARKS, folder.parent.parent / "landmarks" / LANDMARKS)
            if f.is_file()
        ),
        None,
    )
    if file is None:
        return np.zeros((0, 6))
    try:
        rows = np.loadtxt(
            io.BytesIO(read_bytes(file, "GNM landmark file", LANDMARKS_LIMIT)), ndmin=2
        )
    except ValueError as error:
        raise InputError(
            f"The GNM landmark file '{file}' holds something else than numbers ({error})."
        ) from error
    indices, weights = rows[:, ::2], rows[:, 1::2]
    if (
        rows.shape != (68, 6)
        or not np.isfinite(rows).all()
        or (indices != np.round(indices)).any()
        or indices.min() < 0
        or indices.max() >= len(vertices)
        or np.abs(weights).max() > WEIGHT_MAX
        or not np.allclose(weights.sum(axis=1), 1, atol=1e-2)
    ):
        raise InputError(
            f"The GNM landmark file '{file}' is of another model or damaged; expected 68 rows of "
            "three vertices, each followed by its weight."
        )
    table = np.concatenate([indices, weights / weights.sum(axis=1, keepdims=True)], axis=1)
    points = landmark_points(vertices, table)
    jaw = points[:_JAW] - points[_JAW + 10]  # from the bridge of the nose
    table[:_JAW] = table[np.argsort(np.arctan2(jaw[:, 0], -jaw[:, 1]))]
    return table

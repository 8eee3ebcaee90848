"""Landmark tables of face models: three vertices of a triangle and their weights for each
landmark.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.face_model import FaceModel
from facestage.models.anatomy.regions import landmark_points
from facestage.models.correspondence.registration import register
from facestage.models.correspondence.transfer import landmark_tables

SCHEME = "ibug68"
_IBUG = 68
WEIGHT_MAX = 2.0  # a landmark lies on its triangle, or little beside it
_INNER = 51  # the last of them: without the line of the jaw


def table_of_vertices(indices: np.ndarray) -> np.ndarray:
    """(m, 6) table of landmarks that are vertices, (m,)."""
    zeros = np.zeros(len(indices))
    return np.stack([indices, indices, indices, zeros + 1, zeros, zeros], axis=1)


def table_of_triangles(
    triangles: np.ndarray, rows: np.ndarray, weights: np.ndarray, path: Path
) -> np.ndarray:
    """(m, 6) table of landmarks on triangles (m,) with barycentric weights (m, 3) that ``path``
    held.

    Raises InputError when they are not points on triangles of this mesh.
    """
    if len(rows) != len(weights) or len(rows) not in (_IBUG, _INNER):
        raise InputError(
            f"The landmark file '{path}' holds {len(rows)} landmarks; expected {_IBUG} or {_INNER}."
        )
    if weights.shape != (len(rows), 3):
        raise InputError(
            f"The landmark file '{path}' has weights of shape {weights.shape}; expected "
            f"({len(rows)}, 3)."
        )
    if rows.dtype.kind not in "iu" or rows.min() < 0 or rows.max() >= len(triangles):
        raise InputError(
            f"The landmark file '{path}' is of another mesh: it refers to triangles that are "
            "not there."
        )
    total = weights.sum(axis=1) if weights.dtype.kind == "f" else np.zeros(len(weights))
    if not np.allclose(total, 1.0, atol=1e-2) or np.abs(weights).max() > WEIGHT_MAX:
        raise InputError(
            f"The landmark file '{path}' is damaged: its barycentric weights do not add up to 1."
        )
    return np.concatenate([triangles[rows], weights / total[:, None]], axis=1)


def landmark_schemes(
    table: np.ndarray,
    vertices: np.ndarray,
    triangles: np.ndarray,
    default_head: Callable[[], FaceModel],
    points: Mapping[int, np.ndarray] | None = None,
) -> dict[str, np.ndarray]:
    """Landmark tables for every scheme of the default model, from what a face model itself says of
    its landmarks.

    table: (68, 6) of the ibug scheme, or (51, 6) of its last, or (0, 6). vertices (n, 3) m,
    triangles (t, 3): the skin. default_head: gives the default model.
    points: index of an ibug landmark -> its place (3,), where only that is known. What the model
    does not say is carried over from the default head by registration. Raises InputError when no
    face is found.
    """
    head = default_head()
    if len(table) == _IBUG and set(head.landmarks) == {SCHEME}:
        return {SCHEME: table}
    rows = range(_IBUG - len(table), _IBUG)
    known = dict(points or {}) | dict(zip(rows, landmark_points(vertices, table), strict=True))
    tables = landmark_tables(register(head, vertices, triangles, known), vertices, triangles, known)
    tables[SCHEME][list(rows)] = table
    return tables

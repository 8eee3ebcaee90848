"""Landmark tables of face models: three vertices of a triangle and their weights for each landmark."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from facestage.contract.errors import InputError

_IBUG = 68
_INNER = 51  # the last of them: without the line of the jaw


def table_of_vertices(indices: np.ndarray) -> np.ndarray:
    """(m, 6) table of landmarks that are vertices, (m,)."""
    zeros = np.zeros(len(indices))
    return np.stack([indices, indices, indices, zeros + 1, zeros, zeros], axis=1)


def table_of_triangles(triangles: np.ndarray, rows: np.ndarray, weights: np.ndarray, path: Path) -> np.ndarray:
    """(m, 6) table of landmarks on triangles (m,) with barycentric weights (m, 3) that ``path`` held.

    Raises InputError when they are not points on triangles of this mesh.
    """
    if len(rows) != len(weights) or len(rows) not in (_IBUG, _INNER):
        raise InputError(f"The landmark file '{path}' holds {len(rows)} landmarks; expected {_IBUG} or {_INNER}.")
    if rows.dtype.kind not in "iu" or rows.min() < 0 or rows.max() >= len(triangles):
        raise InputError(f"The landmark file '{path}' is of another mesh: it refers to triangles that are not there.")
    total = weights.sum(axis=1) if weights.dtype.kind == "f" else np.zeros(len(weights))
    if not np.allclose(total, 1.0, atol=1e-2):
        raise InputError(f"The landmark file '{path}' is damaged: its barycentric weights do not add up to 1.")
    return np.concatenate([triangles[rows], weights / total[:, None]], axis=1)


def complete_ibug68(table: np.ndarray, vertices: np.ndarray, triangles: np.ndarray, path: Path) -> np.ndarray:
    """(68, 6) table from one of all 68 or of the last 51 landmarks, or of none.

    vertices (n, 3) m and triangles (t, 3) of the skin; ``path`` names the file that would hold them.
    """
    if len(table) == _IBUG:
        return table
    raise InputError(f"The face model lacks landmarks; put the file '{path.name}' beside it in '{path.parent}'.")

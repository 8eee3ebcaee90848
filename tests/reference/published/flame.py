"""A FLAME file of the published structure: the true keys, counts, types and classes, on a head made
for tests.
"""

from __future__ import annotations

import io
import pickle
import sys
import types
from pathlib import Path

import numpy as np
from scipy import sparse

from reference.published.heads import ball, head, smooth_modes

HEAD, EYE = 3931, 546
EYE_RADIUS = 0.012  # m


def flame_arrays(seed: int = 0) -> dict[str, object]:
    """The entries of generic_model.pkl."""
    skin = head(HEAD, ring=60)
    marks = skin.landmarks
    centres = [marks[k : k + 6].mean(axis=0) - [0, 0, EYE_RADIUS - 0.003] for k in (42, 36)]
    mouth = marks[[48, 54]].mean(axis=0)
    eyes = [ball(EYE, EYE_RADIUS, centre) for centre in centres]
    vertices = np.concatenate([skin.vertices, *(points for points, _ in eyes)])
    faces = np.concatenate(
        [skin.triangles, *(rows + HEAD + k * EYE for k, (_, rows) in enumerate(eyes))]
    )
    count = len(vertices)
    joints = np.array(
        [[0, -0.16, -0.06], [0, -0.1, -0.06], [0, marks[0, 1], marks[0, 2]], *centres]
    )
    weights = np.zeros((count, 5))
    eye = np.arange(count) >= HEAD
    jaw = (
        _smoothstep(mouth[1] - vertices[:, 1], 0.006)
        * _smoothstep(vertices[:, 2] - joints[2, 2], 0.03)
        * ~eye
    )
    neck = 1 - _smoothstep(vertices[:, 1] + 0.12, 0.02)
    weights[:, 2] = jaw * (1 - neck)
    weights[:, 0] = neck * ~eye
    weights[HEAD : HEAD + EYE, 3] = 1
    weights[HEAD + EYE :, 4] = 1
    weights[:, 1] = 1 - weights.sum(axis=1)
    random = np.random.default_rng(seed)
    modes = np.concatenate(
        [smooth_modes(vertices, 300, 2.5e-3, seed), smooth_modes(vertices, 100, 1.5e-3, seed + 1)]
    )
    modes[300:, eye] = 0
    # Rows that bring each joint out of the vertices: the nearest eight, so that their mean is the
    # joint.
    regressor = np.zeros((5, count))
    for row, joint in enumerate(joints):
        near = np.argsort(np.linalg.norm(vertices - joint, axis=1))[:8]
        around = np.vstack([vertices[near].T, np.ones(8)])
        regressor[row, near] = np.linalg.lstsq(around, np.append(joint, 1.0), rcond=None)[0]
    return {
        "v_template": vertices,
        "f": faces.astype(np.uint32),
        "shapedirs": np.moveaxis(modes, 0, -1).astype(np.float64),
        "posedirs": 2e-4 * random.normal(size=(count, 3, 36)),
        "J_regressor": sparse.csc_matrix(regressor),
        "J": joints,
        "weights": weights,
        "bs_style": "lbs",
        "bs_type": "lrotmin",
        "kintree_table": np.array([[2**32 - 1, 0, 1, 1, 1], [0, 1, 2, 3, 4]], np.uint32),
    }


def embedding() -> dict[str, np.ndarray]:
    """The entries of landmark_embedding.npy."""
    skin = head(HEAD, ring=60)
    full = skin.landmark_triangle.astype(np.int64), skin.landmark_weights
    return {
        "static_lmk_faces_idx": full[0][17:],
        "static_lmk_bary_coords": full[1][17:],
        "dynamic_lmk_faces_idx": np.zeros((79, 17), np.int64),
        "dynamic_lmk_bary_coords": np.zeros((79, 17, 3)),
        "full_lmk_faces_idx": full[0][None],
        "full_lmk_bary_coords": full[1][None],
    }


def write_flame(path: Path, arrays: dict[str, object]) -> Path:
    """As Python 2 wrote the published files: protocol 2, shapedirs a chumpy array, names of an old
    numpy and scipy.
    """
    module = types.ModuleType("chumpy.ch")
    kind = type("Ch", (), {"__module__": "chumpy.ch"})
    module.Ch = kind  # type: ignore[attr-defined]
    wrapped = kind()
    wrapped.__dict__.update(x=arrays["shapedirs"], _dirty_vars=set(), dterms=("x",))
    before = {name: sys.modules.get(name) for name in ("chumpy", "chumpy.ch")}
    sys.modules |= {"chumpy": types.ModuleType("chumpy"), "chumpy.ch": module}
    try:
        stream = io.BytesIO()
        pickle.dump(arrays | {"shapedirs": wrapped}, stream, 2)
    finally:
        for name, old in before.items():
            if old is None:
                del sys.modules[name]
            else:
                sys.modules[name] = old
    content = stream.getvalue()
    for new, former in (
        (b"numpy._core.multiarray", b"numpy.core.multiarray"),
        (b"scipy.sparse._csc", b"scipy.sparse.csc"),
    ):
        content = content.replace(b"c" + new + b"\n", b"c" + former + b"\n")
    path.write_bytes(content)
    return path


def write_embedding(path: Path, entries: dict[str, np.ndarray]) -> Path:
    """landmark_embedding.npy: an array of one object."""
    np.save(path, np.array(entries, dtype=object))
    return path


def _smoothstep(value: np.ndarray, width: float) -> np.ndarray:
    share = np.clip(value / width + 0.5, 0, 1)
    return share * share * (3 - 2 * share)

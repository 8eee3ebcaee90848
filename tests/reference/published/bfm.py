"""Basel Face Model files of the published structures, on heads made for tests."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import scipy.io

from facestage.models.loaders.bfm import _LANDMARKS_2009, _NAMED
from reference.published.heads import Head, head, smooth_modes


def unit_columns(modes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit columns (3n, k) and standard deviations (k,) whose products are the modes (k, n, 3)."""
    flat = modes.reshape(len(modes), -1).T.astype(np.float64)
    deviation = np.linalg.norm(flat, axis=0)
    return flat / deviation, deviation


def skin_srgb(vertices: np.ndarray) -> np.ndarray:
    """(n, 3) a skin that is redder about the mouth."""
    red = np.exp(-(((vertices - [0, -0.045, 0.02]) / 0.03) ** 2).sum(axis=1))
    return np.array([0.72, 0.55, 0.47]) - red[:, None] * [0.05, 0.2, 0.15]


def color_modes(vertices: np.ndarray, count: int) -> np.ndarray:
    """(count, n, 3) sRGB per standard deviation; the first is how light the skin is, as large as
    Basel's.
    """
    modes = smooth_modes(vertices, count, 0.03, 5).astype(np.float64)
    modes[0] = [0.09, 0.10, 0.10]
    return modes


def head_2009() -> tuple[Head, np.ndarray]:
    """A head of 53490 vertices and 106466 triangles with the landmarks where Basel has them; those
    (68,).
    """
    plain = head(53490, ring=512)
    corner = plain.triangles[plain.landmark_triangle, plain.landmark_weights.argmax(axis=1)]
    wanted = np.array(_LANDMARKS_2009) - 1
    order = np.arange(len(plain.vertices))
    for vertex, place in zip(corner, wanted, strict=True):
        at = int(np.flatnonzero(order == vertex)[0])
        order[at], order[place] = order[place], order[at]
    number = np.argsort(order)
    moved = Head(
        plain.vertices[order],
        number[plain.triangles],
        plain.landmark_triangle,
        plain.landmark_weights,
    )
    return moved, wanted


def write_2009(path: Path, face: Head, modes: int = 3) -> dict[str, np.ndarray]:
    """01_MorphableModel.mat, with fewer modes; its arrays. Its triangles face inwards."""
    shape_pc, shape_ev = unit_columns(smooth_modes(face.vertices, modes, 2e-3, 1) * 1e6)
    tex_pc, tex_ev = unit_columns(color_modes(face.vertices, modes) * 255)
    arrays: dict[str, np.ndarray] = {
        "shapeMU": (face.vertices * 1e6).reshape(-1, 1).astype(np.float32),
        "shapePC": shape_pc.astype(np.float32),
        "shapeEV": shape_ev[:, None].astype(np.float32),
        "texMU": (skin_srgb(face.vertices) * 255).reshape(-1, 1).astype(np.float32),
        "texPC": tex_pc.astype(np.float32),
        "texEV": tex_ev[:, None].astype(np.float32),
        "tl": (face.triangles[:, ::-1] + 1).astype(np.int32),
        "segMM": np.zeros((4, 1)),
        "segMB": np.zeros((4, 1)),
        "segbin": np.zeros((4, 4)),
    }
    scipy.io.savemat(path, arrays)
    return arrays


def write_statismo(
    path: Path, face: Head, modes: int = 4, expressions: int = 3
) -> dict[str, np.ndarray]:
    """model2017-1_bfm_nomouth.h5 or one of 2019; the modes in metres and sRGB that it holds."""
    random = np.random.default_rng(0)
    n = len(face.vertices)
    held = {
        "shape": smooth_modes(face.vertices, modes, 2e-3, 1),
        "color": color_modes(face.vertices, modes),
        "expression": smooth_modes(face.vertices, expressions, 2e-3, 2),
        "expression_mean": smooth_modes(face.vertices, 1, 2e-3, 3)[0],
    }
    means = {
        "shape": face.vertices * 1e3,
        "color": skin_srgb(face.vertices),
        "expression": held["expression_mean"] * 1e3,
    }
    units = {"shape": 1e3, "color": 1.0, "expression": 1e3}
    with h5py.File(path, "w") as file:
        for group, mean in means.items():
            basis, deviation = unit_columns(held[group] * units[group])
            model = file.create_group(f"{group}/model")
            model["mean"] = mean.reshape(-1).astype(np.float32)
            model["pcaBasis"] = basis.astype(np.float32)
            model["pcaVariance"] = (deviation**2).astype(np.float32)
            model["noiseVariance"] = np.float32(0)
            representer = file.create_group(f"{group}/representer")
            representer["points"] = (face.vertices * 1e3).T.astype(np.float32)
            representer["cells"] = face.triangles.T.astype(np.int32)
            file[f"{group}/modelinfo/build-time"] = "today"
        file["version/majorVersion"] = np.int32(0)
        marks = face.landmarks * 1e3
        entries = [
            {"id": name, "coordinates": marks[index].tolist()} for name, index in _NAMED.items()
        ]
        entries.append(
            {"id": "right.ear.lobule.tip", "coordinates": random.normal(size=3).tolist()}
        )
        file["metadata/landmarks/json"] = json.dumps(entries)
    assert n == len(face.vertices)
    return held

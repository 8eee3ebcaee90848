"""How well each vertex is known: the joint covariance of the shape coefficients, carried through
the basis.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from facestage.contract.face_model import FaceModel

ROWS_AT_ONCE = 8192
# Nobody is made of a face model's modes: standard deviation in mm of a person's surface from the
# nearest face that a model has. Of eight random people of the built-in head, whom ICT-FaceKit's
# modes were fitted to with their prior, half of the points lie within 0.52 mm, which are 0.674
# standard deviations.
REACH_MM = 0.77
# What the noise model takes for chance is in part skin that passes for shading, and the same in all
# of a photo: so much larger are the modes' errors than their covariance says. Of three photographs
# of a scanned head, and right for four others of it (docs/certainty.md).
MISFIT_FACTOR = 1.3


def beyond_the_model(deviation_mm: np.ndarray) -> np.ndarray:
    """(n, 3) float32: deviations along the camera's axes that the covariance of the modes knows of,
    as far as they are too small, and what no coefficient of the model can say of a person.
    """
    return np.hypot(MISFIT_FACTOR * deviation_mm, REACH_MM).astype(np.float32)


def similarity_motions(vertices: np.ndarray) -> np.ndarray:
    """(n, 3, 7) motion of ``vertices`` (n, 3) by a unit of each translation, rotation and of
    relative size.
    """
    motions = np.zeros((len(vertices), 3, 7))
    motions[:, :, :3] = np.eye(3)
    motions[:, :, 3:6] = np.moveaxis(np.cross(np.eye(3)[:, None], vertices[None]), 0, 2)
    motions[:, :, 6] = vertices
    return motions


def _basis(model: FaceModel, chosen: np.ndarray, relief: np.ndarray | None = None) -> np.ndarray:
    """(k + e + r, c, 3) of the ``chosen`` vertices."""
    bases = [model.identity_basis[:, chosen], model.expression_basis[:, chosen]]
    if relief is not None:
        bases.append(relief[:, chosen])
    return np.concatenate(bases).astype(np.float64)


def shape_columns(model: FaceModel, vertices: np.ndarray, region: np.ndarray) -> np.ndarray:
    """(r, 3, k + e) motion in metres of the vertices in ``region`` by each coefficient of the
    shape, less what the best similarity transform over them takes out; model frame.
    """
    motions = similarity_motions((vertices - vertices[region].mean(axis=0))[region])
    basis = _basis(model, region)
    flat, rows = motions.reshape(-1, 7), basis.reshape(len(basis), -1).T
    taken, *_ = np.linalg.lstsq(flat, rows, rcond=None)
    return (rows - flat @ taken).reshape(len(region), 3, len(basis))


def vertex_deviation(
    model: FaceModel,
    vertices: np.ndarray,
    rotation: np.ndarray,
    covariance: np.ndarray,
    region: np.ndarray,
    relief: np.ndarray | None = None,
) -> np.ndarray:
    """(n, 3) float32 standard deviation in mm of every vertex along the camera's axes,
    similarity-aligned.

    The square roots of the diagonal of J C J^T with C the ``covariance`` (k + e + r, k + e + r) of
    identity and expression, and of the weights of ``relief`` (r, n, 3), if given. J is the basis
    less what the best similarity transform over the vertices in ``region`` takes out, so pose and
    size drop out, as in errors after alignment; so does a coefficient that nothing holds (infinite:
    it moves nothing). ``vertices`` (n, 3) m, model frame; ``rotation`` (3, 3) to the camera. The
    length of a row is a vertex's root mean square distance from the truth, if the model is right.
    """
    covariance = np.where(np.isfinite(covariance), covariance, 0.0)
    values, vectors = eigh(covariance) if len(covariance) else (np.zeros(0), np.zeros((0, 0)))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    root = root[:, values > 1e-9 * max(float(values.max(initial=0.0)), 1e-30)]
    if not root.shape[1]:
        return np.zeros((len(vertices), 3), np.float32)
    centred = vertices - vertices[region].mean(axis=0)
    motions = similarity_motions(centred[region]).reshape(-1, 7)
    inside = _basis(model, region, relief).reshape(len(root), -1).T @ root
    taken, *_ = np.linalg.lstsq(motions, inside, rcond=None)
    result = np.zeros((len(vertices), 3), np.float32)
    for start in range(0, len(vertices), ROWS_AT_ONCE):
        chosen = np.arange(start, min(start + ROWS_AT_ONCE, len(vertices)))
        # One product of large matrices each, many times as fast as one for each vertex.
        moved = root.T @ _basis(model, chosen, relief).reshape(len(root), -1)
        moved -= taken.T @ similarity_motions(centred[chosen]).reshape(-1, 7).T
        moved = moved.reshape(len(moved), len(chosen), 3) @ rotation.T
        result[chosen] = 1e3 * np.sqrt(np.einsum("kny,kny->ny", moved, moved))
    return result

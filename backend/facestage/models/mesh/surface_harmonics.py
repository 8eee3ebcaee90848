"""Smooth functions on any triangle mesh: the lowest eigenvectors of its Laplace-Beltrami operator.

Cotangent weights after Pinkall and Polthier 1993, "Computing Discrete Minimal Surfaces and Their
Conjugates"; eigenvectors as a spectral basis after Vallet and Levy 2008, "Spectral Geometry
Processing with Manifold Harmonics".
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix, diags
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import eigsh
from scipy.spatial import cKDTree

from facestage.contract.errors import InputError


def surface_harmonics(
    vertices: np.ndarray, triangles: np.ndarray, mask: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """The `count` smoothest functions on the masked part of a mesh, mass-orthogonal with unit
    area-weighted RMS.

    vertices (n, 3) in any unit, triangles (t, 3) int, mask (n,) bool or vertex indices. Returns
    functions (count, n) float64, zero outside the mask, and eigenvalues (count,) in 1 / unit^2,
    ascending; the first function is the constant 1. Duplicate, unused and degenerate elements are
    fine, and so are loose pieces: coinciding vertices are welded and pieces are joined by one weak
    link each, so that no function lives on a single piece only because it is a separate piece.
    Deterministic, signs included.
    """
    selected = np.zeros(len(vertices), bool)
    selected[mask] = True
    if count < 1 or selected.sum() < count + 2:
        raise InputError(
            f"{count} surface harmonics need more than {count + 1} vertices; the mask has "
            f"{selected.sum()}."
        )
    points, faces, vertex_to_point = _welded(
        np.asarray(vertices, np.float64), np.asarray(triangles), selected
    )
    count_solved = min(count, len(points) - 2)
    laplacian, mass = laplacian_and_mass(points, faces)
    laplacian = laplacian + _links(points, laplacian)
    scale = mass.mean()
    # A start vector with parts of every frequency, and no random numbers.
    start = np.cos(np.arange(len(points)) * 12.9898) + 0.1
    shift = -0.01 * scale / mass.sum()
    values, functions = eigsh(
        laplacian.tocsc(), k=count_solved, M=diags(mass / scale).tocsc(), sigma=shift, v0=start
    )
    order = np.argsort(values)
    values, functions = values[order] / scale, functions[:, order].T
    functions = _canonical(functions, points, mass)
    result = np.zeros((count, len(vertices)))
    result[:count_solved, selected] = functions[:, vertex_to_point]
    eigenvalues = np.full(count, values[-1])
    eigenvalues[:count_solved] = np.maximum(values, 0.0)
    eigenvalues[0] = 0.0
    return result, eigenvalues


def laplacian_and_mass(points: np.ndarray, faces: np.ndarray) -> tuple[csr_matrix, np.ndarray]:
    """Positive semi-definite cotangent Laplacian (n, n) and lumped vertex areas (n,), in the square
    of the unit.

    Cotangents are clamped to 0.01..10: obtuse and sliver triangles then cannot make a weight
    negative or huge.
    """
    n = len(points)
    rows, columns, weights = [], [], []
    area = np.zeros(n)
    for corner in range(3):
        a, b, c = (faces[:, (corner + k) % 3] for k in range(3))
        u, v = points[b] - points[a], points[c] - points[a]
        cross = np.linalg.norm(np.cross(u, v), axis=1)
        cotangent = np.einsum("ij,ij->i", u, v) / np.maximum(cross, 1e-30)
        rows.append(b)
        columns.append(c)
        weights.append(0.5 * np.clip(cotangent, 0.01, 10.0))
        area += np.bincount(a, cross / 6.0, n)
    row, column, weight = np.concatenate(rows), np.concatenate(columns), np.concatenate(weights)
    adjacency = coo_matrix((weight, (row, column)), (n, n)).tocsr()
    adjacency = adjacency + adjacency.T
    laplacian = diags(np.asarray(adjacency.sum(axis=1)).ravel()) - adjacency
    positive = area[area > 0]
    floor = 1e-3 * positive.mean() if len(positive) else 1.0
    return laplacian.tocsr(), np.maximum(area, floor)


def _welded(
    vertices: np.ndarray, triangles: np.ndarray, selected: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distinct points of the selected vertices, their non-degenerate faces, and the point of each
    selected vertex.
    """
    kept = vertices[selected]
    size = max(float(np.ptp(kept, axis=0).max()), 1e-30)
    keys = np.round((kept - kept.min(axis=0)) / size * 1e6).astype(np.int64)
    _, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    inverse = inverse.ravel()
    to_point = np.full(len(vertices), -1)
    to_point[selected] = inverse
    faces = to_point[triangles] if len(triangles) else np.zeros((0, 3), int)
    a, b, c = faces.T
    faces = faces[(faces.min(axis=1, initial=0) >= 0) & (a != b) & (b != c) & (c != a)]
    return kept[first], faces, inverse


def _links(points: np.ndarray, laplacian: csr_matrix) -> csr_matrix:
    """Laplacian of extra links that join every loose piece to the nearest point of the largest
    one.
    """
    pieces, label = connected_components(laplacian, directed=False)
    n = len(points)
    if pieces == 1:
        return csr_matrix((n, n))
    largest = np.flatnonzero(label == np.bincount(label).argmax())
    tree = cKDTree(points[largest])
    others = np.setdiff1d(np.arange(n), largest)
    distance, nearest = tree.query(points[others])
    order = np.lexsort((distance, label[others]))
    _, first = np.unique(label[others][order], return_index=True)
    row = others[order][first]
    column = largest[nearest[order][first]]
    adjacency = coo_matrix((np.ones(len(row)), (row, column)), (n, n)).tocsr()
    adjacency = adjacency + adjacency.T
    return (diags(np.asarray(adjacency.sum(axis=1)).ravel()) - adjacency).tocsr()


def _canonical(functions: np.ndarray, points: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """Unit RMS, the constant exactly 1, the others free of it, and a sign that follows the
    coordinates.
    """
    share = mass / mass.sum()
    functions = functions.copy()
    functions[0] = 1.0
    functions[1:] -= (functions[1:] @ share)[:, None]
    functions[1:] /= np.sqrt((functions[1:] ** 2) @ share)[:, None]
    # Mixed, incommensurate moments: odd and even functions of a symmetric mesh both have a definite
    # sign.
    span = np.maximum(np.ptp(points, axis=0), 1e-30)
    x, y, z = ((points - points.mean(axis=0)) / span).T
    probe = np.exp(1.3 * x + 0.7 * y + 0.41 * z) + 0.2 * np.sin(7 * x + 5 * y + 3 * z)
    sign = np.sign((functions * share) @ probe)
    return functions * np.where(sign == 0, 1.0, sign)[:, None]

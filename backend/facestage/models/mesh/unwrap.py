"""UV coordinates for a mesh that has none: every loose piece becomes a chart that does not overlap
itself.

The largest piece, the skin, is laid on a disc: cut open along the back of the head where it goes
all the way round, its holes filled, its border put on a circle, and everything else at the mean
value coordinates of its neighbors. With a convex border and positive weights no triangle turns over
(Tutte 1963, "How to Draw a Graph"; Floater 2003, "Mean Value Coordinates", theorem 1), and they
stay positive while they are changed for less stretch. Other pieces (eyeballs) are seen from the
front, by their angle to the axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.sparse.linalg import splu

# Where the skin's chart lies in the atlas: corner u, v and side; the other pieces lie below it.
SKIN_TILE = (0.125, 0.25, 0.75)
_SMALL_STRIP = 0.25
_MARGIN = 0.01
# Of Yoshizawa, Belyaev and Seidel 2004, "A fast and simple stretch-minimizing mesh
# parameterization".
STRETCH_STEPS = 2
# Share of the area that must look backwards for a piece to count as going all the way round.
_BACK_SHARE = 0.15


@dataclass(frozen=True)
class _Cut:
    """A triangle mesh with a point for each side of a cut."""

    faces: np.ndarray  # (t, 3) int point indices
    vertex: np.ndarray  # (p,) the vertex of each point
    loops: list[np.ndarray]  # borders as closed walks, the surface on their left


def unwrap(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """UV points (u, 2) float32 in 0..1 and their triangles (t, 3) int32, row for row with
    ``triangles``.

    vertices (n, 3) in the model frame (+Y up, looking along +Z), triangles (t, 3) int,
    counter-clockwise from outside. Up in the texture is up on the face.
    """
    vertices = np.asarray(vertices, np.float64)
    piece = _pieces(len(vertices), triangles)[triangles[:, 0]]
    order = np.argsort(-np.bincount(piece), kind="stable")
    order = order[: len(np.unique(piece))]
    small = max(len(order) - 1, 1)
    columns = int(np.ceil(np.sqrt(small / _SMALL_STRIP)))
    side = min(1.0 / columns, _SMALL_STRIP)
    uvs, triangle_uvs, start = [], np.zeros(triangles.shape, np.int32), 0
    for rank, label in enumerate(order):
        rows = piece == label
        if rank == 0:
            points, faces = unwrap_disc(vertices, triangles[rows])
            corner, scale = np.array(SKIN_TILE[:2]), SKIN_TILE[2]
        else:
            points, faces = _from_the_front(vertices, triangles[rows])
            corner, scale = side * np.array(divmod(rank - 1, columns)[::-1], float), side
        uvs.append(corner + scale * points)
        triangle_uvs[rows] = faces + start
        start += len(points)
    return np.concatenate(uvs).astype(np.float32), triangle_uvs


def unwrap_disc(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One connected piece on a disc in the unit square: points (p, 2) and triangles (t, 3) of them.

    A piece that is no disc even when cut (a handle, more than two triangles at an edge) is seen
    from the front.
    """
    mesh = _cut_open(triangles, np.zeros((0, 2), int))
    if _goes_round(vertices, triangles) or not mesh.loops:
        mesh = _cut_open(triangles, _seam(vertices, triangles, mesh))
    if not _is_disc(mesh):
        return _from_the_front(vertices, triangles)
    points = _mean_value_embedding(vertices[mesh.vertex], mesh)
    points = _upright(points, vertices[mesh.vertex], mesh.faces)
    return 0.5 + (0.5 - _MARGIN) * points, mesh.faces


def flipped(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(t,) bool, the triangles that lie face down or have no area."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    (x1, y1), (x2, y2) = (b - a).T, (c - a).T
    return x1 * y2 - y1 * x2 <= 0


def _pieces(count: int, triangles: np.ndarray) -> np.ndarray:
    """(n,) label of the connected piece of each vertex."""
    row, column = triangles[:, [0, 1]].ravel(), triangles[:, [1, 2]].ravel()
    return connected_components(
        sparse.coo_matrix((np.ones(len(row)), (row, column)), (count, count)), False
    )[1]


def _cut_open(triangles: np.ndarray, seam: np.ndarray) -> _Cut:
    """Points that triangles share only across edges that are not in ``seam`` (k, 2)."""
    corner = np.arange(triangles.size).reshape(triangles.shape)
    start, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    first, second = corner.ravel(), np.roll(corner, -1, axis=1).ravel()
    count = int(triangles.max()) + 1
    key = np.minimum(start, end).astype(np.int64) * count + np.maximum(start, end)
    cut = np.sort(seam, axis=1)
    key_order = np.argsort(key, kind="stable")
    unique, at, uses = np.unique(key[key_order], return_index=True, return_counts=True)
    pair = at[(uses == 2) & ~np.isin(unique, cut[:, 0] * count + cut[:, 1])]
    one, other = key_order[pair], key_order[pair + 1]
    # Two triangles of the same direction along an edge do not face the same way: they are not
    # joined.
    good = start[one] == end[other]
    one, other = one[good], other[good]
    row = np.concatenate([first[one], second[one]])
    column = np.concatenate([second[other], first[other]])
    size = triangles.size
    _, point = connected_components(
        sparse.coo_matrix((np.ones(len(row)), (row, column)), (size, size)), False
    )
    _, example = np.unique(point, return_index=True)
    faces = point.reshape(triangles.shape)
    inner = np.zeros(size, bool)
    inner[one] = inner[other] = True
    border = ~inner
    return _Cut(
        faces, triangles.ravel()[example], _walks(point[first[border]], point[second[border]])
    )


def _walks(start: np.ndarray, end: np.ndarray) -> list[np.ndarray]:
    """Closed walks along directed edges of which every point has one in and one out."""
    following = dict(zip(start.tolist(), end.tolist(), strict=True))
    loops = []
    while following:
        first, point = following.popitem()
        loop = [first]
        while point != first and point in following:
            loop.append(point)
            point = following.pop(point)
        loops.append(np.array(loop))
    return loops


def _is_disc(mesh: _Cut) -> bool:
    """Whether filling all borders but one leaves a disc."""
    edges = np.sort(
        np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]]),
        axis=1,
    )
    euler = len(mesh.vertex) - len(np.unique(edges, axis=0)) + len(mesh.faces)
    whole = len(np.unique(_pieces(len(mesh.vertex), mesh.faces))) == 1
    return (
        bool(mesh.loops)
        and whole
        and euler + len(mesh.loops) == 2
        and min(map(len, mesh.loops)) >= 3
    )


def _goes_round(vertices: np.ndarray, triangles: np.ndarray) -> bool:
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    return bool(
        np.clip(-normal[:, 2], 0, None).sum() > _BACK_SHARE * np.linalg.norm(normal, axis=1).sum()
    )


def _seam(vertices: np.ndarray, triangles: np.ndarray, mesh: _Cut) -> np.ndarray:
    """(k, 2) edges of a path up the back of the head, from the longest border to the crown."""
    used = np.unique(triangles)
    points = vertices[used]
    size = max(float(np.ptp(points, axis=0).max()), 1e-30)
    x, y, z = ((points - 0.5 * (points.min(0) + points.max(0))) / size).T
    backness = -z - 2.0 * np.abs(x)
    low = used[np.argmax(backness - y)]
    if mesh.loops:
        border = mesh.vertex[max(mesh.loops, key=lambda loop: _length(vertices[mesh.vertex[loop]]))]
        rank = np.searchsorted(used, border)
        low = border[np.argmax(backness[rank])]
    crown = used[np.argmax(y - np.abs(x))]
    edges = np.unique(
        np.sort(
            np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]),
            axis=1,
        ),
        axis=0,
    )
    # The path keeps to the back and to the middle.
    cost = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1) / size
    away = np.zeros(len(vertices))
    away[used] = np.abs(x) + np.clip(z + 0.1, 0, None)
    cost *= 1.0 + 20.0 * (away[edges[:, 0]] + away[edges[:, 1]])
    graph = sparse.coo_matrix((cost, (edges[:, 0], edges[:, 1])), (len(vertices), len(vertices)))
    _, before = dijkstra(graph, directed=False, indices=low, return_predecessors=True)
    path = [int(crown)]
    while path[-1] != low and before[path[-1]] >= 0:
        path.append(int(before[path[-1]]))
    return np.stack([path[:-1], path[1:]], axis=1)


def _length(walk: np.ndarray) -> float:
    return float(np.linalg.norm(np.roll(walk, -1, axis=0) - walk, axis=1).sum())


def _mean_value_embedding(points: np.ndarray, mesh: _Cut) -> np.ndarray:
    """(p, 2) in the unit disc: the longest border on the circle by its length, the rest by mean
    value weights.
    """
    longest = max(range(len(mesh.loops)), key=lambda k: _length(points[mesh.loops[k]]))
    border = mesh.loops[longest]
    fans: list[np.ndarray] = []
    centres: list[np.ndarray] = []
    for k, loop in enumerate(mesh.loops):
        if k != longest:
            middle = np.full(len(loop), len(points) + len(centres))
            fans.append(np.stack([np.roll(loop, -1), loop, middle], axis=1))
            centres.append(points[loop].mean(axis=0))
    faces = np.concatenate([mesh.faces, *fans])
    filled = np.concatenate([points, np.reshape(centres, (-1, 3))])
    count = len(filled)
    walk = points[border]
    travelled = np.linalg.norm(np.roll(walk, -1, axis=0) - walk, axis=1)
    # Two points may coincide in space, but not on the circle.
    travelled = np.maximum(travelled, max(1e-3 * travelled.mean(), 1e-30))
    angle = 2 * np.pi * np.concatenate([[0.0], np.cumsum(travelled)[:-1]]) / travelled.sum()
    weights = _mean_value_weights(filled, faces, count)
    inside = np.ones(count, bool)
    inside[border] = False
    result = np.zeros((count, 2))
    result[border] = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    identity = sparse.identity(int(inside.sum()), format="csc")
    for step in range(STRETCH_STEPS + 1):
        if step:
            # Neighbors that are stretched pull less, so that texels spread over the surface more
            # evenly.
            weights = _rows_of_one(weights @ sparse.diags(1.0 / _stretch(result, filled, faces)))
        system = (identity - weights[inside][:, inside]).tocsc()
        result[inside] = splu(system).solve(weights[inside][:, ~inside] @ result[~inside])
    return result[: len(points)]


def _stretch(laid: np.ndarray, points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(p,) how much longer a step is on the surface than on the chart, around each point (Sander et
    al. 2001).
    """
    a, b, c = (laid[faces[:, k]] for k in range(3))
    p, q, r = (points[faces[:, k]] for k in range(3))
    (x1, y1), (x2, y2) = (b - a).T, (c - a).T
    double = np.maximum(np.abs(x1 * y2 - y1 * x2), 1e-12)[:, None]
    along_u = ((q - p) * y2[:, None] - (r - p) * y1[:, None]) / double
    along_v = ((r - p) * x1[:, None] - (q - p) * x2[:, None]) / double
    squared = 0.5 * ((along_u**2).sum(axis=1) + (along_v**2).sum(axis=1))
    area = np.linalg.norm(np.cross(q - p, r - p), axis=1)
    area = np.maximum(area, max(1e-6 * area.mean(), 1e-30))
    total, weight = np.zeros(len(points)), np.zeros(len(points))
    for corner in range(3):
        total += np.bincount(faces[:, corner], area * squared, len(points))
        weight += np.bincount(faces[:, corner], area, len(points))
    return np.sqrt(np.maximum(total / weight, 1e-12) / max(total.sum() / weight.sum(), 1e-12))


def _mean_value_weights(points: np.ndarray, faces: np.ndarray, count: int) -> sparse.csr_matrix:
    """(p, p) rows of positive weights that sum to 1 (Floater 2003, eq. 2.1, with the angles of the
    surface).
    """
    scale = max(
        float(np.linalg.norm(points[faces[:, 1]] - points[faces[:, 0]], axis=1).mean()), 1e-30
    )
    rows, columns, values = [], [], []
    for corner in range(3):
        i, j, k = (faces[:, (corner + shift) % 3] for shift in range(3))
        u, v = points[j] - points[i], points[k] - points[i]
        short_u = np.maximum(np.linalg.norm(u, axis=1), 1e-3 * scale)
        short_v = np.maximum(np.linalg.norm(v, axis=1), 1e-3 * scale)
        cosine = np.clip(np.einsum("ij,ij->i", u, v) / (short_u * short_v), -1, 1)
        half = np.clip(np.tan(0.5 * np.arccos(cosine)), 1e-3, 1e3)
        rows += [i, i]
        columns += [j, k]
        values += [half / short_u, half / short_v]
    weights = sparse.coo_matrix(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), (count, count)
    ).tocsr()
    return _rows_of_one(weights)


def _rows_of_one(weights: sparse.csr_matrix) -> sparse.csr_matrix:
    return sparse.diags(1.0 / np.asarray(weights.sum(axis=1)).ravel()) @ weights


def _upright(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The disc turned so that up and right on what looks forward are up and right in it."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    weight = np.clip(normal[:, 2], 0, None) ** 2
    weight = weight / max(weight.sum(), 1e-30)
    seen = vertices[faces].mean(axis=1)[:, :2]
    laid = points[faces].mean(axis=1)
    seen, laid = seen - weight @ seen, laid - weight @ laid
    covariance = (seen * weight[:, None]).T @ laid
    turn = np.arctan2(covariance[0, 1] - covariance[1, 0], covariance[0, 0] + covariance[1, 1])
    cosine, sine = np.cos(-turn), np.sin(-turn)
    return points @ np.array([[cosine, sine], [-sine, cosine]])


def _from_the_front(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Azimuthal equidistant projection about the piece's middle, +Z in the centre of the unit
    square.
    """
    used, faces = np.unique(triangles, return_inverse=True)
    points = vertices[used]
    direction = points - 0.5 * (points.min(0) + points.max(0))
    direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-30)
    angle = np.arccos(np.clip(direction[:, 2], -1, 1)) / np.pi
    across = np.maximum(np.hypot(direction[:, 0], direction[:, 1]), 1e-30)
    laid = direction[:, :2] * (angle / across)[:, None]
    return 0.5 + (0.5 - _MARGIN) * laid, faces.reshape(triangles.shape)

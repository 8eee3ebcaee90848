"""The default face laid onto any face mesh: a similarity, shape coefficients, and a smooth rest.

Non-rigid iterative closest points over a morphable model (Amberg, Knothe and Vetter 2008,
"Expression Invariant 3D Face Recognition with a Morphable Model"): point-to-plane residuals (Chen
and Medioni 1992) on neighbours whose normals agree, robust weights, more modes as the distances
shrink. What the model cannot follow is left to a smooth warp.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from facestage.contract.errors import InputError
from facestage.contract.face_model import FaceModel
from facestage.models.correspondence.coarse_alignment import coarse_alignments
from facestage.models.correspondence.face_openings import FrontView, face_features
from facestage.models.correspondence.smooth_warp import smooth_displacement
from facestage.models.mesh.mirror import mirrored_axis
from facestage.models.mesh.similarity import Similarity, procrustes
from facestage.models.mesh.surface import Surface, normals_and_areas, pieces, vertex_normals

SCHEME = "ibug68"
_NOSE_TIP = 30
# (identity modes, expressions too, scale of the robust distance in metres, steps)
_SCHEDULE = (
    (0, False, 8e-3, 4),
    (12, False, 5e-3, 5),
    (40, False, 2.5e-3, 6),
    (80, True, 1.5e-3, 6),
    (80, True, 1e-3, 5),
)
_POINTS = 1200
_NOISE = 0.5e-3  # metres: what a mesh's surface differs from the model's beyond its modes, and
_CORRELATED = 20.0  # how many neighbouring points share that difference
_COSINE = 0.5
_TANGENTIAL = 0.1  # weight of sliding along the surface against leaving it
_EXPRESSION_SPREAD = 0.05  # a mesh at rest is nearly neutral
_KNOWN_SPREAD = 0.7e-3  # metres
_WARP_REACH, _WARP_POINTS, _WARP_STEPS = 12e-3, 600, 2  # metres
# A face is found when the narrow face lies this close, on the default face's scale.
SMALLEST = 0.1
MEDIAN_MAX, COVERED_MIN = 1.8e-3, 0.6
ASKEW_MAX = 20.0  # degrees between a mirrored mesh's sides and those of the face that is found


@dataclass(frozen=True)
class Registration:
    """The default face on a mesh (the target, in its own unit and frame)."""

    model: FaceModel  # the default face
    target: Surface
    similarity: Similarity  # default model frame -> target frame
    identity: np.ndarray  # (k,)
    expression: np.ndarray  # (e,)
    offsets: np.ndarray  # (n, 3) metres, model frame: the smooth rest that the coefficients leave
    right_side_out: bool  # the mesh's triangles face outwards; the target's always do

    @cached_property
    def shape(self) -> np.ndarray:
        """(n, 3) float64 metres, the fitted default face in its own frame, warped."""
        return self.model.shape(self.identity, self.expression).astype(np.float64) + self.offsets

    @cached_property
    def vertices(self) -> np.ndarray:
        """(n, 3) float64, the fitted default face in the target's frame and unit."""
        return self.similarity.apply(self.shape)

    @cached_property
    def median_distance(self) -> float:
        """Metres on the default face's scale: median distance of its narrow face from the target's
        surface.
        """
        return self._narrow_distances[0]

    @cached_property
    def covered(self) -> float:
        """Share of the default's narrow face that lies on the target, not over a hole or beyond its
        edge.
        """
        return self._narrow_distances[1]

    @cached_property
    def _narrow_distances(self) -> tuple[float, float]:
        narrow = self.model.regions["narrow_face"]
        normals = vertex_normals(self.vertices, self.model.triangles)[narrow]
        nearest = self.target.nearest(self.vertices[narrow], normals, 0.3)
        distance = nearest.distance / self.similarity.scale
        found = (distance < 0.015) & ~nearest.boundary
        return float(np.median(distance[found])) if found.any() else np.inf, float(found.mean())


def _found(fit: Registration) -> bool:
    return fit.median_distance <= MEDIAN_MAX and fit.covered >= COVERED_MIN


def _askew(fit: Registration, vertices: np.ndarray) -> float:
    """Degrees by which the face's right and left are not those of a mesh that was modelled with a
    mirror; 0 for any other mesh.
    """
    axis = mirrored_axis(vertices)
    if axis is None:
        return 0.0
    return float(np.degrees(np.arccos(min(1.0, abs(fit.similarity.rotation[axis, 0])))))


def register(
    model: FaceModel,
    vertices: np.ndarray,
    triangles: np.ndarray,
    known_points: Mapping[int, np.ndarray] | None = None,
    focus: np.ndarray | None = None,
    warp: bool = True,
) -> Registration:
    """Lay the default face onto a face mesh.

    model: the default model. vertices (n, 3), triangles (t, 3): the mesh, any unit, any axes,
    closed or a mask, with or without loose parts. known_points: index of an ibug68 landmark -> its
    place (3,) on the mesh, as many as are known. focus (n,) bool: the vertices among which the face
    is, where that is known (those that expressions move).
    warp: let the face leave its model smoothly for what the coefficients cannot follow.
    Deterministic. Raises InputError when no face is found.
    """
    known = {
        int(index): np.asarray(point, np.float64) for index, point in (known_points or {}).items()
    }
    if not np.isfinite(vertices).all():
        raise InputError(
            "The mesh has vertices at NaN or infinity; repair it, or choose the mesh of a face."
        )
    surface = Surface(vertices, main_piece(vertices, triangles, focus))
    wanted = np.ones(len(surface.vertices), bool) if focus is None else np.asarray(focus, bool)
    if not wanted.any():
        wanted[:] = True
    source = _Source(model)
    fits = []
    for _, start in _starts(source, surface, known, wanted):
        fit = _fit(source, surface, start, known, _SCHEDULE[:2])
        fits.append((_score(fit), fit))
    if not fits:
        raise InputError(
            "No face was found on the mesh: it has no vertices on a surface; choose the mesh "
            "of a face."
        )
    best = min(fits, key=lambda item: item[0])[1]
    best = _fit(source, best.target, best.similarity, known, _SCHEDULE[2:3], best)
    anchors = _anchors(source, best) | known
    plain, best = best, _fit(source, best.target, best.similarity, anchors, _SCHEDULE[2:], best)
    if not _found(best):
        # What was taken for the openings of eyes and mouth was something else.
        anchors = known
        best = _fit(source, plain.target, plain.similarity, known, _SCHEDULE[2:], plain)
    # A head is about a seventh of a body: something much smaller is not a face, however well it
    # fits.
    tiny = (
        best.similarity.scale * source.height
        < SMALLEST * np.ptp(surface.vertices[wanted], axis=0).max()
    )
    askew = 0.0 if known else _askew(best, surface.vertices[wanted])
    if not known and (tiny or not _found(best) or askew > ASKEW_MAX):
        turned = f", turned {askew:.0f} degrees from the mesh's mirror" if askew > ASKEW_MAX else ""
        raise InputError(
            "No face was found on the mesh: the nearest fit of a face is "
            f"{best.median_distance * 1e3:.1f} mm off and covers {best.covered:.0%}{turned}; mark "
            "some landmarks (eye corners, nose tip, mouth corners, chin), or choose the mesh of a "
            "face."
        )
    return _warped(source, best, anchors) if warp else best


def _anchors(source: _Source, fit: Registration) -> dict[int, np.ndarray]:
    """Landmarks that the openings of the mesh's eyes and mouth show, index -> place (3,) in the
    target's frame.
    """
    target = fit.target
    mesh = FrontView(fit.similarity.inverse().apply(target.vertices), target.triangles)
    whole = FrontView(fit.shape, fit.model.triangles)
    found = face_features(mesh, whole, source.landmark_points(fit.shape))
    return {
        index: fit.similarity.apply(place)
        for index, place in found.items()
        if np.isfinite(place).all()
    }


def main_piece(
    vertices: np.ndarray, triangles: np.ndarray, focus: np.ndarray | None = None
) -> np.ndarray:
    """The triangles of the connected piece with the largest area (in focus): the skin, without
    eyes, teeth, lashes.
    """
    triangles = np.asarray(triangles, np.int64).reshape(-1, 3)
    vertices = np.asarray(vertices, np.float64)
    if not len(triangles):
        return triangles
    _, area = normals_and_areas(vertices, triangles)
    if focus is not None:
        area = area * np.asarray(focus, bool)[triangles].any(axis=1)
    piece = pieces(vertices, triangles)[triangles[:, 0]]
    return triangles[piece == np.bincount(piece, area).argmax()]


class _Source:
    """The part of the default model that is laid onto meshes: its visible face, thinned out."""

    def __init__(self, model: FaceModel) -> None:
        self.model = model
        face = np.asarray(model.regions["face"])
        narrow = np.zeros(len(model.vertices), bool)
        narrow[model.regions["narrow_face"]] = True
        rng = np.random.default_rng(0)
        chosen = np.sort(rng.choice(face, min(_POINTS, len(face)), replace=False))
        self.index = chosen
        self.narrow = narrow[chosen]
        self.mean = model.vertices[chosen].astype(np.float64)
        self.identity = model.identity_basis[:, chosen].astype(np.float64)
        self.expression = model.expression_basis[:, chosen].astype(np.float64)
        self.normals = vertex_normals(model.vertices.astype(np.float64), model.triangles)
        self.nose = model.vertices[int(model.landmarks[SCHEME][_NOSE_TIP, 0])].astype(np.float64)
        self.height = float(np.ptp(model.vertices[:, 1]))
        # Every vertex stands for the area around it.
        a, b, c = (model.vertices[model.triangles[:, k]] for k in range(3))
        third = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6
        area = np.bincount(model.triangles.ravel(), np.repeat(third, 3), len(model.vertices))
        self.share = area[chosen] / area[chosen].mean()
        landmarks = model.landmarks[SCHEME]
        self._corners, self._corner_weights = (
            landmarks[:, :3].astype(int),
            landmarks[:, 3:].astype(np.float64),
        )

    def landmark_points(self, shape: np.ndarray) -> np.ndarray:
        """(68, ...) values at the landmarks of vertex values (n, ...)."""
        return np.einsum("mk,mk...->m...", self._corner_weights, shape[self._corners])

    def jacobian(self, points: np.ndarray, modes: int, moving: int) -> np.ndarray:
        """(m, 3, 7 + modes + moving) derivative of points (m, 3) by rotation, translation, log
        size, coefficients.
        """
        return _columns(points, self.identity[:modes], self.expression[:moving])

    def known_rows(
        self,
        shape: np.ndarray,
        known: Mapping[int, np.ndarray],
        back: Similarity,
        modes: int,
        moving: int,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Rows (3 m, p) and residuals (3 m,) that pull landmarks to their known places."""
        order = sorted(known)
        points = self.landmark_points(shape)[order]
        corners, weights = self._corners[order], self._corner_weights[order]
        bases = [
            np.einsum("mk,emkc->emc", weights, basis[:, corners])
            for basis in (self.model.identity_basis[:modes], self.model.expression_basis[:moving])
        ]
        rows = _columns(points, *bases)
        away = back.apply(np.stack([known[index] for index in order])) - points
        return rows.reshape(-1, rows.shape[2]), away.ravel()


def _columns(points: np.ndarray, identity: np.ndarray, expression: np.ndarray) -> np.ndarray:
    x, y, z = points.T
    zero = np.zeros_like(x)
    turn = np.stack(
        [np.stack([zero, z, -y], 1), np.stack([-z, zero, x], 1), np.stack([y, -x, zero], 1)], axis=1
    )
    shift = np.broadcast_to(np.eye(3), (len(points), 3, 3))
    bases = [basis.transpose(1, 2, 0) for basis in (identity, expression)]
    return np.concatenate([turn, shift, points[:, :, None], *bases], axis=2)


def _starts(
    source: _Source, surface: Surface, known: Mapping[int, np.ndarray], focus: np.ndarray
) -> list[tuple[float, Similarity]]:
    """Similarities to start from: that of the known points when they fix one, else the best
    guesses.
    """
    if len(known) >= 3:
        order = sorted(known)
        ours = source.landmark_points(source.model.vertices.astype(np.float64))[order]
        if np.linalg.svd(ours - ours.mean(axis=0), compute_uv=False)[1] > 0.01:
            return [(0.0, procrustes(ours, np.stack([known[index] for index in order])))]
    narrow = source.index[source.narrow]
    points, normals = source.model.vertices[narrow].astype(np.float64), source.normals[narrow]
    return coarse_alignments(points, normals, source.nose, source.height, surface, focus)


def _score(fit: Registration) -> float:
    """Median distance, punished for what is not covered."""
    return fit.median_distance / max(fit.covered, 1e-3)


def _fit(
    source: _Source,
    surface: Surface,
    start: Similarity,
    known: Mapping[int, np.ndarray],
    schedule: tuple[tuple[int, bool, float, int], ...],
    previous: Registration | None = None,
) -> Registration:
    """Gauss-Newton over pose, size and coefficients, neighbours found anew at each step."""
    model, similarity = source.model, start
    alpha = np.zeros(len(model.identity_names)) if previous is None else previous.identity.copy()
    beta = np.zeros(len(model.expression_names)) if previous is None else previous.expression.copy()
    turned = previous is not None and not previous.right_side_out
    if previous is None and _inside_out(
        surface, similarity, source.mean, source.normals[source.index]
    ):
        surface, turned = surface.flipped(), True
    for modes, with_expression, spread, steps in schedule:
        modes, moving = min(modes, len(alpha)), len(beta) if with_expression else 0
        prior = np.concatenate(
            [np.full(7, 1e-6), np.ones(modes), np.full(moving, _EXPRESSION_SPREAD**-2)]
        )
        for _ in range(steps):
            full = model.shape(alpha, beta).astype(np.float64)
            points = full[source.index]
            normals = vertex_normals(full, model.triangles)[source.index]
            nearest = surface.nearest(
                similarity.apply(points), normals @ similarity.rotation.T, _COSINE
            )
            back = similarity.inverse()
            gap = np.where(np.isfinite(nearest.distance), nearest.distance, 0.0) / similarity.scale
            trust = (
                source.share
                * np.isfinite(nearest.distance)
                * (gap < 6 * spread)
                * ~nearest.boundary
            )
            trust = trust / (1 + (gap / spread) ** 2) ** 2 / (_NOISE**2 * _CORRELATED)
            toward = back.apply(nearest.point) - points
            J = source.jacobian(points, modes, moving)
            planes = np.einsum("mc,mcp->mp", nearest.normal @ similarity.rotation, J)
            offset = np.einsum("mc,mc->m", nearest.normal @ similarity.rotation, toward)
            matrix = (planes * trust[:, None]).T @ planes
            right = (planes * trust[:, None]).T @ offset
            # Every fourth point also holds on to where it is, weakly, so that nothing slides along
            # a flat cheek.
            some = slice(None, None, 4)
            weak = np.repeat(4 * _TANGENTIAL**2 * trust[some], 3)
            rows = J[some].reshape(-1, J.shape[2])
            matrix += (rows * weak[:, None]).T @ rows
            right += (rows * weak[:, None]).T @ toward[some].ravel()
            if known:
                rows, away = source.known_rows(full, known, back, modes, moving)
                matrix += rows.T @ rows / _KNOWN_SPREAD**2
                right += rows.T @ away / _KNOWN_SPREAD**2
            matrix[np.diag_indices(len(prior))] += prior
            right -= prior * np.concatenate([np.zeros(7), alpha[:modes], beta[:moving]])
            step = np.linalg.solve(matrix, right)
            alpha[:modes] += step[7 : 7 + modes]
            beta[:moving] = np.clip(beta[:moving] + step[7 + modes :], 0.0, 1.0)
            similarity = _moved(similarity, step[:7])
    offsets = np.zeros((len(model.vertices), 3))
    return Registration(model, surface, similarity, alpha, beta, offsets, not turned)


def _moved(similarity: Similarity, step: np.ndarray) -> Similarity:
    """The similarity after turning by step[:3], shifting by step[3:6] and growing by step[6] in the
    source frame.
    """
    turn, grow = (
        Rotation.from_rotvec(np.clip(step[:3], -0.3, 0.3)).as_matrix(),
        float(np.exp(np.clip(step[6], -0.15, 0.15))),
    )
    rotation = similarity.rotation @ turn
    shift = similarity.scale * similarity.rotation @ step[3:6]
    return Similarity(similarity.scale * grow, rotation, similarity.translation + shift)


def _inside_out(
    surface: Surface, similarity: Similarity, points: np.ndarray, normals: np.ndarray
) -> bool:
    """Whether the surface's triangles face away from the face that lies on it."""
    nearest = surface.nearest(similarity.apply(points))
    cosine = np.einsum("mc,mc->m", nearest.normal, normals @ similarity.rotation.T)
    return bool(np.median(cosine) < -0.3)


def _warped(source: _Source, fit: Registration, known: Mapping[int, np.ndarray]) -> Registration:
    """The registration with offsets that bring its known landmarks to their places, and its surface
    onto the mesh.
    """
    back = fit.similarity.inverse()
    for _ in range(_WARP_STEPS):
        shape = fit.shape
        chosen = source.index[:: max(1, len(source.index) // _WARP_POINTS)]
        normals = vertex_normals(shape, fit.model.triangles)[chosen]
        nearest = fit.target.nearest(
            fit.similarity.apply(shape[chosen]), normals @ fit.similarity.rotation.T, _COSINE
        )
        held = ~nearest.boundary & (nearest.distance < _WARP_REACH * fit.similarity.scale)
        points, noise = shape[chosen[held]], np.full(held.sum(), 0.5)
        toward = back.apply(nearest.point[held]) - points
        if known:
            order = sorted(known)
            marks = source.landmark_points(shape)[order]
            points = np.concatenate([points, marks])
            toward = np.concatenate(
                [toward, back.apply(np.stack([known[index] for index in order])) - marks]
            )
            noise = np.concatenate([noise, np.full(len(order), 0.05)])
        offsets = smooth_displacement(points, toward, noise, shape, _WARP_REACH)
        fit = replace(fit, offsets=fit.offsets + offsets)
    return fit

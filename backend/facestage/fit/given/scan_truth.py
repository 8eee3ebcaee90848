"""Errors against a scan of the head in the photo, whose vertices are not the face model's."""

from __future__ import annotations

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.light_stage import LightStage
from facestage.contract.scan import MILLIMETRES, Scan
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.state import State
from facestage.fit.forward.shading import ForwardModel
from facestage.models.mesh.closest_alignment import closest_alignment
from facestage.models.mesh.similarity import Similarity
from facestage.models.mesh.surface import Surface, normals_and_areas

# A finer scan says no more of errors of a millimetre: so many of its face's points are compared.
POINTS_MAX = 20_000
COVERED_ROUNDS = 3
COVERED_MIN = 50  # points below which a mesh covers nothing that it could be laid on
# What of the model the scan's face is, the smallest first: models draw the line in other places,
# and a mesh that is too small is drawn out to points that it has nothing for.
REGIONS = ("narrow_face", "face", "skin")
LARGE_ENOUGH = 0.9  # of the scan's face, by radius


class ScanTruth:
    """A scan's face, in metres in the camera frame; what is measured is how far its points lie from
    the fitted mesh, cut to the smallest region of the model that is as large.
    """

    cheap = False  # an alignment takes as long as a step of the fit

    def __init__(self, scan: Scan, geometry: FaceGeometry) -> None:
        self.geometry = geometry
        every = -(-len(scan.face) // POINTS_MAX)
        self.points = scan.vertices[scan.face[::every]] / MILLIMETRES
        self.region, self.triangles = _as_large(geometry, _face_radius(scan))
        self._scan = scan

    def geometry_errors(self, state: State) -> dict[str, float]:
        """Median, mean and 90 % quantile in mm of the distance of the scan's face points from the
        mesh, after similarity and after rigid alignment of the mesh to them.

        Aligned on the 95 % nearest points, measured on all.
        """
        surface = self._surface(state)
        best = self._aligned(surface)
        errors = _quantiles("similarity", _Laid(surface, self.points, best))
        middle = self.points.mean(axis=0)
        rotated = best.rotation @ best.inverse().apply(middle[None])[0]
        start = Similarity(1.0, best.rotation, middle - rotated)
        rigid = closest_alignment(surface, self.points, start, rigid=True)
        return errors | _quantiles("rigid", _Laid(surface, self.points, rigid))

    def covered_errors(self, state: State) -> dict[str, float]:
        """``covered_mm``, the median over the points that the mesh covers, laid on these alone, and
        ``covered``, their share; the others lie beyond its border, and say where it ends.
        """
        surface = self._surface(state)
        laid = self._covered(surface, self._aligned(surface))
        return {
            "covered_mm": MILLIMETRES * float(np.median(laid.distance)),
            "covered": len(laid.distance) / len(self.points),
        }

    def calibration(
        self, state: State, deviation_mm: Float[np.ndarray, "vertices 3"]
    ) -> dict[str, float]:
        """How honest standard deviations in mm, along the camera's axes, are: after similarity
        alignment, the shares of the scan's face points whose distance from the mesh is within one
        and two of the mesh's own deviation there, along its normal (0.68 and 0.95 if normal), and
        the root mean square of distance over deviation.
        """
        surface = self._surface(state)
        best = self._aligned(surface)
        score = _Laid(surface, self.points, best).score(deviation_mm)
        covered = self._covered(surface, best).score(deviation_mm)
        return {
            "within_1_sigma": float((score < 1).mean()),
            "within_2_sigma": float((score < 2).mean()),
            "error_over_sigma": float(np.sqrt((score**2).mean())),
            "covered_within_1_sigma": float((covered < 1).mean()),
            "covered_within_2_sigma": float((covered < 2).mean()),
        }

    def seen(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The true surface: vertices (n, 3) in metres in the camera frame, triangles (t, 3), and
        which of these (t,) are the face.
        """
        face = np.zeros(len(self._scan.vertices), bool)
        face[self._scan.face] = True
        triangles = self._scan.triangles.astype(np.int64)
        return self._scan.vertices / MILLIMETRES, triangles, face[triangles].all(axis=1)

    def light_error(self, stage: LightStage, centre: Float[np.ndarray, 3]) -> float | None:
        """A scan knows no light."""
        return None

    def albedo_error(self, texture: Float[np.ndarray, "texels texels 3"]) -> float | None:
        """A scan's texture has no place in the model's."""
        return None

    def tone_errors(self, texture: Float[np.ndarray, "texels texels 3"]) -> dict[str, float]:
        """Nothing, for the same reason."""
        return {}

    def normal_errors(
        self,
        forward: ForwardModel,
        state: State,
        normal_map: Float[np.ndarray, "texels texels 3"] | None,
    ) -> dict[str, float]:
        """Nothing: a scan's finer relief lies in a normal map of its own."""
        return {}

    def _surface(self, state: State) -> Surface:
        """The fitted mesh in the camera frame, cut to its region."""
        vertices = self.geometry.all_vertices(state)
        return Surface(vertices @ state.rotation.T + state.translation, self.triangles)

    def _aligned(self, surface: Surface) -> Similarity:
        """The similarity that lays the mesh on the scan.

        Both are seen at the same place of the photo, so where it begins only their distance from
        the camera differs.
        """
        depth = np.median(surface.vertices[self.region, 2])
        ratio = float(np.median(self.points[:, 2]) / depth) if depth < 0 else 1.0
        return closest_alignment(surface, self.points, Similarity(ratio, np.eye(3), np.zeros(3)))

    def _covered(self, surface: Surface, at: Similarity) -> _Laid:
        """The points that the mesh covers, whose nearest point is not on its border, and the mesh
        laid on them, begun where it lies by ``at``.

        Points far beyond the border have drawn it towards them, so it is laid, and looked at what
        it covers, a few times.
        """
        points = self.points
        for _ in range(COVERED_ROUNDS):
            inside = self.points[~_Laid(surface, self.points, at).nearest.boundary]
            points = inside if len(inside) >= COVERED_MIN else self.points
            at = closest_alignment(surface, points, at)
        return _Laid(surface, points, at)


class _Laid:
    """A mesh laid on points (m, 3), and where it is nearest to each, in its own frame."""

    def __init__(self, surface: Surface, points: np.ndarray, at: Similarity) -> None:
        self.surface, self.scale = surface, at.scale
        self.nearest = surface.nearest(at.inverse().apply(points))
        self.distance = at.scale * self.nearest.distance  # (m,) metres

    def score(self, deviation_mm: Float[np.ndarray, "vertices 3"]) -> Float[np.ndarray, " points"]:
        """Distance over the mesh's own standard deviation there, along its normal."""
        corners = self.surface.triangles[self.nearest.triangle]
        # The axes' errors are taken for independent: their correlations are not in the result.
        variance = np.einsum("pk,pkx->px", self.nearest.weights, deviation_mm[corners] ** 2)
        along = np.sqrt((variance * self.nearest.normal**2).sum(axis=1))
        return MILLIMETRES * self.distance / np.maximum(self.scale * along, 1e-6)


def _as_large(geometry: FaceGeometry, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of the smallest of ``REGIONS`` whose radius is about ``radius`` metres
    or more; else of all that the model shows.
    """
    model = geometry.model
    for region in [model.regions[name] for name in REGIONS if name in model.regions]:
        inside = np.zeros(len(model.vertices), bool)
        inside[region] = True
        triangles = model.triangles[inside[model.triangles].all(axis=1)]
        middles = model.vertices[triangles].mean(axis=1)
        area = normals_and_areas(model.vertices, triangles)[1]
        if _radius(middles, area) >= LARGE_ENOUGH * radius:
            return region, triangles
    return geometry.used, geometry.used[geometry.triangles]


def _face_radius(scan: Scan) -> float:
    """The radius of the scan's face, whose vertices may be denser around the eyes."""
    _, area = normals_and_areas(scan.vertices, scan.triangles)
    share = np.bincount(scan.triangles.ravel(), np.repeat(area, 3), len(scan.vertices))[scan.face]
    return _radius(scan.vertices[scan.face] / MILLIMETRES, share if share.any() else None)


def _radius(points: np.ndarray, weight: np.ndarray | None = None) -> float:
    """Root mean square distance of points (n, 3) from their middle."""
    middle = np.average(points, axis=0, weights=weight)
    return float(np.sqrt(np.average(((points - middle) ** 2).sum(axis=1), weights=weight)))


def _quantiles(name: str, laid: _Laid) -> dict[str, float]:
    """The errors called ``name``, in mm."""
    millimetres = MILLIMETRES * laid.distance
    return {
        f"{name}_mm": float(np.median(millimetres)),
        f"{name}_mean_mm": float(millimetres.mean()),
        f"{name}_90_percent_mm": float(np.quantile(millimetres, 0.9)),
    }

"""Lay a face model onto the scan of a case, held by points that somebody marked: what
ablate_scan.py takes for the truth.

python tools/register_to_scan.py CASE --model ict:PATH --marks marks.json --out registered.npz

``marks.json`` is a landmarks file of scheme ibug68 for the case's photo, with null for each point
that is not marked: corners and edges of the lids, corners and borders of the lips, the base of the
nose. Without them closest points slide along the skin. Leave out the brows, which are paint, and
the jaw, which is no place of the skin.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from facestage.contract.camera import Camera
from facestage.contract.errors import InputError
from facestage.contract.face_model import SKIN, FaceModel
from facestage.contract.files.storage import write_arrays
from facestage.contract.landmarks import IBUG, Landmarks
from facestage.contract.scan import MILLIMETRES, Scan
from facestage.fit.face.unknowns import EXPRESSION_SIGMA, WEIGHT_RANGE
from facestage.fit.forward.shading import pixel_rays
from facestage.fit.solve.bounded_step import bounded_step
from facestage.models.mesh.similarity import procrustes
from facestage.models.mesh.surface import Surface, vertex_normals
from facestage.models.registry import load_model
from facestage.render.tracer import RayTracer
from facestage.render.variant import start_renderer

# How heavy the prior is, in vertices that lie 1 mm off, and how heavy one mark.
PRIOR, MARK = 10.0, 30.0
# Distance in mm at which a vertex counts half, beyond which it counts nothing, and the cosine
# between normals that belong together.
HALF, FAR, COSINE = 1.5, 10.0, 0.6
ROUNDS = 40
SETTLED = 2e-3  # largest change of a coefficient
MARKS_MIN = 6


@dataclass(frozen=True)
class Laid:
    """A model in the scan's frame; millimetres."""

    model: FaceModel
    weights: np.ndarray  # (k + e,) of identity and expression
    rotation: np.ndarray  # (3, 3)
    translation: np.ndarray  # (3,)

    @property
    def vertices(self) -> np.ndarray:
        """(n, 3)."""
        count = len(self.model.identity_names)
        shape = self.model.shape(self.weights[:count], self.weights[count:])
        return MILLIMETRES * shape @ self.rotation.T + self.translation

    def moved(self, step: np.ndarray) -> Laid:
        """By ``step`` (k + e + 6,): coefficients, rotation about the frame's place, shift."""
        turn = Rotation.from_rotvec(step[-6:-3]).as_matrix()
        return Laid(
            self.model, self.weights + step[:-6], turn @ self.rotation, self.translation + step[-3:]
        )


class Registration:
    """The least-squares problem of one scan: closest points towards its tangents, and marks."""

    def __init__(self, model: FaceModel, scan: Scan, marks: np.ndarray) -> None:
        """``marks`` (68, 3) in mm in the scan's frame; NaN where nothing is marked."""
        self.model, self.scan = model, Surface(scan.vertices, scan.triangles)
        self.marked = np.isfinite(marks).all(axis=1)
        if self.marked.sum() < MARKS_MIN:
            raise InputError(
                f"{self.marked.sum()} marks lie on the scan; expected at least {MARKS_MIN}."
            )
        self.marks = marks[self.marked]
        corners, weights = model.landmark_vertices(IBUG)
        self.corners, self.corner_weights = corners[self.marked], weights[self.marked]
        bases = np.concatenate([model.identity_basis, model.expression_basis])
        self.basis = MILLIMETRES * bases.transpose(1, 2, 0).astype(np.float64)  # (n, 3, k + e)
        self.skin = model.triangles[model.triangle_part == SKIN]
        narrow = np.zeros(len(model.vertices), bool)
        narrow[model.regions["narrow_face"]] = True
        self.compared = np.unique(self.skin[narrow[self.skin].all(axis=1)])
        gaussian = ~model.expression_box
        identities = len(model.identity_names)
        self.low = np.concatenate(
            [np.full(identities, WEIGHT_RANGE[0]), np.where(gaussian, -np.inf, 0.0)]
        )
        self.high = np.concatenate(
            [np.full(identities, WEIGHT_RANGE[1]), np.where(gaussian, np.inf, 1.0)]
        )
        spread = np.where(gaussian, 1.0, EXPRESSION_SIGMA)
        self.prior = PRIOR / np.concatenate([np.ones(identities), spread]) ** 2

    def start(self) -> Laid:
        """The mean face by its marks alone."""
        points = np.einsum(
            "mi,mix->mx", self.corner_weights, self.model.vertices[self.corners]
        ).astype(np.float64)
        pose = procrustes(MILLIMETRES * points, self.marks, rigid=True)
        return Laid(self.model, np.zeros(len(self.prior)), pose.rotation, pose.translation)

    def solved(self) -> Laid:
        """After so many rounds, or when nothing moves."""
        laid = self.start()
        for _ in range(ROUNDS):
            step = self._step(laid)
            laid = laid.moved(step)
            if np.abs(step[:-6]).max() < SETTLED:
                break
        return laid

    def _step(self, laid: Laid) -> np.ndarray:
        vertices = laid.vertices
        normals = vertex_normals(vertices, self.skin)[self.compared]
        found = self.scan.nearest(vertices[self.compared], normals, COSINE)
        usable = (found.distance < FAR) & ~found.boundary
        near = self.compared[usable]
        weights = 1.0 / (1.0 + (found.distance[usable] / HALF) ** 2)
        place = np.ones((len(near), 1))
        normal = found.normal[usable]
        offset = ((vertices[near] - found.point[usable]) * normal).sum(axis=1)
        hessian, gradient = self._system(laid, near[:, None], place, normal, weights, offset)
        marks = np.einsum("mi,mix->mx", self.corner_weights, vertices[self.corners])
        for axis in np.eye(3):
            along = np.tile(axis, (len(marks), 1))
            heavy = np.full(len(marks), MARK)
            more = self._system(
                laid, self.corners, self.corner_weights, along, heavy, (marks - self.marks) @ axis
            )
            hessian, gradient = hessian + more[0], gradient + more[1]
        shape = slice(0, len(self.prior))
        hessian[shape, shape] += np.diag(self.prior)
        gradient[shape] += self.prior * laid.weights
        free = np.full(6, np.inf)
        return bounded_step(
            hessian,
            gradient,
            0.0,
            np.concatenate([laid.weights, np.zeros(6)]),
            np.concatenate([self.low, -free]),
            np.concatenate([self.high, free]),
            np.ones(len(gradient), bool),
        ).step

    def _system(
        self,
        laid: Laid,
        corners: np.ndarray,
        corner_weights: np.ndarray,
        along: np.ndarray,
        weights: np.ndarray,
        offset: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Normal equations of points that are off by ``offset`` (m,) ``along`` (m, 3) directions.

        The points lie at ``corner_weights`` (m, c) of the vertices ``corners`` (m, c).
        """
        basis = np.einsum("mi,mixk->mxk", corner_weights, self.basis[corners])
        points = np.einsum("mi,mix->mx", corner_weights, laid.vertices[corners])
        columns = [
            np.einsum("mx,mxk->mk", along @ laid.rotation, basis),
            np.cross(points - laid.translation, along),
            along,
        ]
        jacobian = np.concatenate(columns, axis=1)
        weighted = jacobian * weights[:, None]
        return jacobian.T @ weighted, weighted.T @ offset


def lifted(landmarks: Landmarks, camera: Camera, scan: Scan) -> np.ndarray:
    """(m, 3) where the marks in the photo lie on the scan, mm; NaN off it. The renderer runs."""
    points = np.asarray(landmarks.points, np.float64)
    result = np.full((len(points), 3), np.nan)
    given = np.flatnonzero(np.isfinite(points).all(axis=1) & landmarks.visible)
    middle = scan.vertices.mean(axis=0)
    tracer = RayTracer(scan.triangles.astype(np.int64), len(scan.vertices))
    tracer.update((scan.vertices - middle) / MILLIMETRES)
    hits = tracer.first_hits(-middle / MILLIMETRES, pixel_rays(camera, points[given]))
    hit = hits.triangle >= 0
    corners = scan.vertices[scan.triangles[hits.triangle[hit]]]
    result[given[hit]] = np.einsum("mi,mix->mx", hits.barycentric[hit], corners)
    return result


def main() -> None:
    """Register, say how well, and write the file."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("case", type=Path)
    parser.add_argument("--model", required=True)
    parser.add_argument("--marks", type=Path, required=True)
    parser.add_argument("--face-region", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    start_renderer("cpu")
    model, scan = (
        load_model(options.model),
        Scan.load(options.case / "scan.npz", options.face_region),
    )
    landmarks = Landmarks.read(options.marks)
    if landmarks.scheme != IBUG:
        parser.error(f"{options.marks} is of scheme {landmarks.scheme}, expected {IBUG}")
    marks = lifted(landmarks, Camera.read(options.case / "camera.json"), scan)
    registration = Registration(model, scan, marks)
    laid = registration.solved()
    identities = len(model.identity_names)
    identity, expression = laid.weights[:identities], laid.weights[identities:]
    write_arrays(
        options.out,
        {
            "identity": identity,
            "expression": expression,
            "vertices": laid.vertices,
            "scan": scan.vertices,
        },
    )
    found = registration.scan.nearest(laid.vertices[registration.compared])
    inside = found.distance[~found.boundary]
    print(
        f"median {np.median(inside):.2f} mm from the scan, held by {registration.marked.sum()} "
        f"marks; energy of the identity {0.5 * identity @ identity:.0f} "
        f"({np.sqrt((identity**2).mean()):.2f} standard deviations per mode)"
    )


if __name__ == "__main__":
    main()

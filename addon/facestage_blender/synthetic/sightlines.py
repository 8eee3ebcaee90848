"""What the camera sees first along a line, from the meshes themselves rather than from a render."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from mathutils.bvhtree import BVHTree

from facestage.contract.camera import Camera
from facestage.contract.face_model import EYES, MOUTH, OTHER, SKIN, TEETH, FaceModel

# Labels of a picture's pixels.
BACKGROUND, NARROW_FACE, FACE, HEAD, EYE, INSIDE_MOUTH, WORN = range(7)
TOLERANCE = 0.004  # metres; a landmark on a lid or lip lies in the surface, not before it


class Sightlines:
    """Rays from the camera to a head (n, 3) in the camera frame and to other meshes, without
    see-through shells.
    """

    def __init__(
        self,
        model: FaceModel,
        vertices: np.ndarray,
        others: Sequence[tuple[np.ndarray, np.ndarray]] = (),
    ) -> None:
        rendered = model.triangle_part != OTHER
        points, triangles = [vertices], [model.triangles[rendered]]
        labels = [_labels(model)[rendered]]
        for other, faces in others:
            triangles.append(faces + sum(map(len, points)))
            points.append(other)
            labels.append(np.full(len(faces), WORN, np.uint8))
        self.labels = np.concatenate(labels)
        self.tree = BVHTree.FromPolygons(
            np.concatenate(points).tolist(), np.concatenate(triangles).tolist()
        )

    def picture(self, camera: Camera) -> np.ndarray:
        """(h, w) uint8 label of what lies at the centre of each pixel."""
        x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
        principal = camera.principal_px
        rays = np.stack(
            [
                (x - principal[0]) / camera.focal_px,
                (principal[1] - y) / camera.focal_px,
                np.full_like(x, -1.0),
            ],
            axis=-1,
        )
        hits = [self.tree.ray_cast((0, 0, 0), ray)[2] for ray in rays.reshape(-1, 3).tolist()]
        labels = [BACKGROUND if hit is None else self.labels[hit] for hit in hits]
        return np.array(labels, np.uint8).reshape(x.shape)

    def visible(self, points: np.ndarray) -> np.ndarray:
        """(m,) bool: nothing lies between the camera and a point (m, 3) but what is within
        TOLERANCE of it.
        """
        return unhidden(self.tree, points, TOLERANCE)


def unhidden(tree: BVHTree, points: np.ndarray, tolerance: float) -> np.ndarray:
    """(m,) bool: nothing of the tree lies between the camera, at the origin, and a point (m, 3) but
    what is within ``tolerance`` of it.
    """
    distance = np.linalg.norm(points, axis=1)
    return np.array(
        [
            tree.ray_cast((0, 0, 0), (point / far).tolist(), float(far - tolerance))[2] is None
            for point, far in zip(points, distance, strict=True)
        ],
        bool,
    )


def _labels(model: FaceModel) -> np.ndarray:
    """(t,) uint8 label of each of the model's triangles."""
    labels = np.full(len(model.triangles), HEAD, np.uint8)
    for region, label in (("face", FACE), ("narrow_face", NARROW_FACE)):
        inside = np.zeros(len(model.vertices), bool)
        inside[model.regions.get(region, [])] = True
        labels[inside[model.triangles].all(axis=1) & (model.triangle_part == SKIN)] = label
    labels[model.triangle_part == EYES] = EYE
    labels[np.isin(model.triangle_part, (MOUTH, TEETH))] = INSIDE_MOUTH
    return labels

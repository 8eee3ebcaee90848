"""What fixed pixels of a photo see of a face that moves: points of the skin, and where another
photo shows them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from facestage.contract.arrays import Float, Int
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.face.surface_points import SurfacePoints
from facestage.fit.forward.shading import pixel_rays


@dataclass(frozen=True, eq=False)
class SeenPoints:
    """Pixels of a photo, each with the triangle that it sees, whose plane stands for the skin as
    long as it is placed there.
    """

    geometry: FaceGeometry
    pixels: Float[np.ndarray, "points 2"]
    corners: Int[np.ndarray, "points 3"]  # rendered-vertex indices

    def weights(
        self, state: State, vertices: Float[np.ndarray, "vertices 3"]
    ) -> Float[np.ndarray, "points 3"]:
        """Barycentric weights of what the pixels see at ``state``, whose rendered mesh is at
        ``vertices``, in the camera frame.
        """
        triangles = vertices[self.corners].transpose(0, 2, 1)
        rays = pixel_rays(state.camera, self.pixels)
        along = np.linalg.solve(triangles, rays[..., None])[..., 0]
        return np.asarray(along / along.sum(axis=1, keepdims=True))

    def at(self, weights: Float[np.ndarray, "points 3"]) -> SurfacePoints:
        """These points of the skin."""
        return SurfacePoints(self.geometry, self.corners, weights)


def camera_vertices(geometry: FaceGeometry, state: State) -> Float[np.ndarray, "vertices 3"]:
    """The rendered mesh in the camera frame."""
    return geometry.at(state) @ state.rotation.T + state.translation


def shown(
    vertices: Float[np.ndarray, "vertices 3"],
    corners: Int[np.ndarray, "points 3"],
    weights: Float[np.ndarray, "points 3"],
    state: State,
) -> Float[np.ndarray, "points 2"]:
    """Where a photo at ``state`` shows these points of its mesh, in pixels."""
    return state.camera.project(np.einsum("pi,pix->px", weights, vertices[corners]))


def between_photos(
    vertices: tuple[Float[np.ndarray, "vertices 3"], Float[np.ndarray, "vertices 3"]],
    corners: Int[np.ndarray, "points 3"],
    weights: Float[np.ndarray, "points 3"],
    states: tuple[State, State],
) -> Float[np.ndarray, "points 2 2"]:
    """How the second photo's pixel moves as the first one's moves over the same triangle."""
    first, second = (
        _by_slide(mesh, corners, weights, state)
        for mesh, state in zip(vertices, states, strict=True)
    )
    return np.asarray(second @ np.linalg.inv(first))


def _by_slide(
    vertices: np.ndarray, corners: np.ndarray, weights: np.ndarray, state: State
) -> Float[np.ndarray, "points 2 2"]:
    """Derivative of where points show by their first two weights, the third giving way."""
    points = vertices[corners]
    edges = np.stack([points[:, 0] - points[:, 2], points[:, 1] - points[:, 2]], axis=-1)
    place = np.einsum("pi,pix->px", weights, points)
    depth, focal = -place[:, 2], state.camera.focal_px
    by_point = np.zeros((len(place), 2, 3))
    by_point[:, 0, 0], by_point[:, 0, 2] = focal / depth, focal * place[:, 0] / depth**2
    by_point[:, 1, 1], by_point[:, 1, 2] = -focal / depth, -focal * place[:, 1] / depth**2
    return np.asarray(by_point @ edges)


def jacobian_of(
    points: SurfacePoints, state: State, layout: Layout, moving: Int[np.ndarray, " moving"]
) -> Float[np.ndarray, "points 2 moving"]:
    """Derivative of where ``points`` show by the parameters ``moving``."""
    return np.asarray(points.jacobian(state, layout)[..., moving])

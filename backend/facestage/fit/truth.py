"""Errors against the --truth file: it changes nothing in the fit, it only adds numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.light_stage import LightStage
from facestage.contract.storage import read_arrays
from facestage.fit.geometry import FaceGeometry
from facestage.fit.metrics import aligned_difference, aligned_distance, relative_error, scaled_rmse
from facestage.fit.parameters import State
from facestage.fit.shading import sample_bilinear

PROBE_NORMALS = 512


class Truth:
    """Known vertices (n, 3) in the camera frame, and optionally lights and albedo texture."""

    def __init__(self, path: Path, geometry: FaceGeometry) -> None:
        self.geometry = geometry
        self.arrays = read_arrays(path, "truth file")
        vertices = self.arrays.get("vertices")
        count = len(geometry.model.vertices)
        if vertices is None or vertices.shape != (count, 3):
            found = "no vertices" if vertices is None else f"vertices of shape {vertices.shape}"
            raise InputError(f"The truth file '{path}' holds {found}; this face model has ({count}, 3).")
        if not np.isfinite(vertices).all():
            raise InputError(f"The truth file '{path}' has NaN or infinite vertices; write it again.")
        region = geometry.model.regions.get("narrow_face", geometry.used)
        self.region = region
        self.compared = geometry.new_index[region]
        self.vertices = vertices[region].astype(np.float64)

    def geometry_errors(self, state: State) -> dict[str, float]:
        """Mean distance over the narrow face in mm, after rigid and after similarity alignment."""
        vertices = self.geometry.vertices(state.identity, state.expression)[self.compared]
        found = vertices @ state.rotation.T + state.translation
        return {
            "rigid_mm": 1e3 * float(aligned_distance(found, self.vertices, scale=False).mean()),
            "similarity_mm": 1e3 * float(aligned_distance(found, self.vertices, scale=True).mean()),
        }

    def calibration(self, state: State, deviation_mm: np.ndarray) -> dict[str, float]:
        """How honest standard deviations (n, 3) in mm, along the camera's axes, are: after similarity alignment, the
        shares of the narrow face's coordinates within one and two of them (0.68 and 0.95 if normal), and the root mean
        square of error over deviation (1 if right, more if they are too small).
        """
        vertices = self.geometry.vertices(state.identity, state.expression)[self.compared]
        error = 1e3 * np.abs(aligned_difference(vertices @ state.rotation.T, self.vertices, scale=True))
        score = error / np.maximum(deviation_mm[self.region], 1e-6)
        return {
            "within_1_sigma": float((score < 1).mean()), "within_2_sigma": float((score < 2).mean()),
            "error_over_sigma": float(np.sqrt((score**2).mean())),
        }  # fmt: skip

    def light_error(self, stage: LightStage, centre: np.ndarray) -> float | None:
        """Relative error of the irradiance over all normals that face the camera, best scale factored out.

        Two stages need not have their lights at the same places; what they do to a face can be compared.
        ``stage`` and ``centre`` (3,) are in the camera frame.
        """
        needed = ("light_position", "light_direction", "light_radiance", "light_corners")
        if any(name not in self.arrays for name in needed):
            return None
        corners = self.arrays["light_corners"]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 1]), axis=1)
        true = probe_irradiance(
            self.arrays["light_position"], self.arrays["light_direction"], area, self.arrays["light_radiance"],
            self.vertices.mean(0),
        )  # fmt: skip
        found = probe_irradiance(stage.position, stage.direction, stage.side**2, stage.radiance, centre)
        return relative_error(found, true)

    def albedo_error(self, texture: np.ndarray) -> float | None:
        """RMSE of an atlas texture (S, S, 3) over the narrow face's vertices, best single scale factored out."""
        true = self.arrays.get("albedo")
        if true is None or true.ndim != 3 or true.shape[0] != true.shape[1]:
            return None
        model = self.geometry.model
        inside = np.zeros(len(model.vertices), bool)
        inside[model.regions.get("narrow_face", self.geometry.used)] = True
        rows = inside[model.triangles].all(axis=1)
        uvs = model.uvs[np.unique(model.triangle_uvs[rows])]
        u, v, scale = model.face_tile
        true_uvs = (uvs - np.array([u, v])) / scale
        return scaled_rmse(sample_bilinear(texture, uvs), sample_bilinear(true.astype(np.float64), true_uvs))


def probe_irradiance(
    position: np.ndarray, direction: np.ndarray, area: np.ndarray, radiance: np.ndarray, centre: np.ndarray
) -> np.ndarray:
    """(PROBE_NORMALS, 3) irradiance at ``centre`` for normals spread over the hemisphere towards +Z."""
    index = np.arange(PROBE_NORMALS)
    height = 1.0 - (index + 0.5) / PROBE_NORMALS
    angle = np.pi * (3.0 - np.sqrt(5.0)) * index
    ring = np.sqrt(1.0 - height**2)
    normals = np.stack([ring * np.cos(angle), ring * np.sin(angle), height], axis=1)
    offset = position - centre
    distance = np.linalg.norm(offset, axis=1)
    towards = offset / distance[:, None]
    solid_angle = area * np.maximum(-(direction * towards).sum(1), 0) / distance**2
    return np.maximum(normals @ towards.T, 0) @ (solid_angle[:, None] * radiance)

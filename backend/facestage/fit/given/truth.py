"""Errors against the --truth file: it changes nothing in the fit, it only adds numbers.

A truth is the vertices of the very face model that is fitted, or a scan (:mod:`.scan_truth`).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.errors import InputError
from facestage.contract.files.reading import GIB
from facestage.contract.files.storage import read_arrays
from facestage.contract.light_stage import COUNT_MAX, FAR, RADIANCE_MAX, LightStage
from facestage.contract.scan import MARK, Scan
from facestage.contract.schemas.array_field import Array, unit
from facestage.contract.schemas.schema import FileSchema, checked
from facestage.contract.skin_tone import chromaticity, typology_angle
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.state import State
from facestage.fit.forward.shading import ForwardModel, sample_bilinear
from facestage.fit.given.face_color import face_uvs
from facestage.fit.given.metrics import (
    aligned_difference,
    aligned_distance,
    relative_error,
    scaled_rmse,
)
from facestage.fit.given.scan_truth import ScanTruth
from facestage.fit.given.seen_normals import SeenNormals
from facestage.models.mesh.similarity import procrustes

PROBE_NORMALS = 512
TRUTH_ARRAYS_MAX = 1 * GIB
TEXELS_MAX = 8192  # along a side of the albedo
ALBEDO_MAX = 1e3
HEIGHT_MAX = 50.0  # mm


class TruthSchema(FileSchema):
    """A truth.npz for a model with a known number of vertices; all but the vertices may be
    missing.
    """

    dimensions: ClassVar = {
        "texels": (1, TEXELS_MAX),
        "heights": (2, TEXELS_MAX),
        "lights": (1, COUNT_MAX),
    }

    vertices = Array(("vertices", 3), minimum=-FAR, maximum=FAR)
    albedo = Array(("texels", "texels", 3), minimum=0, maximum=ALBEDO_MAX, required=False)
    height_mm = Array(
        ("heights", "heights"), minimum=-HEIGHT_MAX, maximum=HEIGHT_MAX, required=False
    )
    light_position = Array(("lights", 3), minimum=-FAR, maximum=FAR, required=False)
    light_direction = Array(("lights", 3), minimum=-2, maximum=2, validate=unit, required=False)
    light_radiance = Array(("lights", 3), minimum=0, maximum=RADIANCE_MAX, required=False)
    light_corners = Array(("lights", 4, 3), minimum=-FAR, maximum=FAR, required=False)


class VertexTruth:
    """Known vertices (n, 3) in the camera frame, and optionally lights and albedo texture."""

    cheap = True  # to be asked after every step

    def __init__(
        self, path: Path, arrays: Mapping[str, np.ndarray], geometry: FaceGeometry
    ) -> None:
        """``arrays`` of the file ``path``. Raises InputError for what is not this model's."""
        self.geometry = geometry
        subject = f"The truth file '{path}' does not fit this face model"
        self.arrays = checked(TruthSchema(vertices=len(geometry.model.vertices)), arrays, subject)
        vertices = self.arrays["vertices"]
        region = geometry.model.regions.get("narrow_face", geometry.used)
        self.region = region
        self.compared = geometry.new_index[region]
        self.vertices = vertices[region].astype(np.float64)

    def geometry_errors(self, state: State) -> dict[str, float]:
        """Mean distance over the narrow face in mm, after rigid and after similarity alignment."""
        vertices = self.geometry.at(state)[self.compared]
        found = vertices @ state.rotation.T + state.translation
        return {
            "rigid_mm": 1e3 * float(aligned_distance(found, self.vertices, scale=False).mean()),
            "similarity_mm": 1e3 * float(aligned_distance(found, self.vertices, scale=True).mean()),
        }

    def covered_errors(self, state: State) -> dict[str, float]:
        """Nothing: every known vertex is one of the mesh."""
        return {}

    def calibration(self, state: State, deviation_mm: np.ndarray) -> dict[str, float]:
        """How honest standard deviations (n, 3) in mm, along the camera's axes, are: after
        similarity alignment, the shares of the narrow face's coordinates within one and two of them
        (0.68 and 0.95 if normal), and the root mean square of error over deviation (1 if right,
        more if they are too small).
        """
        vertices = self.geometry.at(state)[self.compared]
        error = 1e3 * np.abs(
            aligned_difference(vertices @ state.rotation.T, self.vertices, scale=True)
        )
        score = error / np.maximum(deviation_mm[self.region], 1e-6)
        return {
            "within_1_sigma": float((score < 1).mean()),
            "within_2_sigma": float((score < 2).mean()),
            "error_over_sigma": float(np.sqrt((score**2).mean())),
        }

    def seen(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The true surface: vertices (n, 3) in metres in the camera frame, triangles (t, 3), and
        which of these (t,) are the face.
        """
        vertices = self.arrays["vertices"][self.geometry.used].astype(np.float64)
        return vertices, self.geometry.triangles, self.geometry.fitted

    def light_error(self, stage: LightStage, centre: np.ndarray) -> float | None:
        """Relative error of the irradiance over all normals that face the camera, best scale
        factored out.

        Two stages need not have their lights at the same places; what they do to a face can be
        compared. ``stage`` and ``centre`` (3,) are in the camera frame.
        """
        needed = ("light_position", "light_direction", "light_radiance", "light_corners")
        if any(name not in self.arrays for name in needed):
            return None
        corners = self.arrays["light_corners"]
        area = np.linalg.norm(
            np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 1]), axis=1
        )
        true = probe_irradiance(
            self.arrays["light_position"],
            self.arrays["light_direction"],
            area,
            self.arrays["light_radiance"],
            self.vertices.mean(0),
        )
        found = probe_irradiance(
            stage.position, stage.direction, stage.side**2, stage.radiance, centre
        )
        return relative_error(found, true)

    def albedo_error(self, texture: np.ndarray) -> float | None:
        """RMSE of an atlas texture (S, S, 3) over the narrow face's vertices, best single scale
        factored out.
        """
        colors = self._face_colors(texture)
        return None if colors is None else scaled_rmse(*colors)

    def tone_errors(self, texture: np.ndarray) -> dict[str, float]:
        """The tone of the narrow face's median albedo in an atlas texture (S, S, 3), no scale
        factored out: the true individual typology angle in degrees (what was found: face_tone), and
        how far its shares of red, green and blue are from the truth. Nothing where the albedo is
        not known.
        """
        colors = self._face_colors(texture)
        if colors is None:
            return {}
        found, true = (np.median(color, axis=0) for color in colors)
        return {
            "true_ita": float(typology_angle(true)),
            "chromaticity": float(np.linalg.norm(chromaticity(found) - chromaticity(true))),
        }

    def normal_errors(
        self,
        forward: ForwardModel,
        state: State,
        normal_map: Float[np.ndarray, "texels texels 3"] | None,
    ) -> dict[str, float]:
        """Mean angle in degrees between the normals that the pixels of the narrow face see and the
        true ones, those of the known vertices with the known height on them: of the fitted mesh,
        and with the normal map. After rotation of the face onto the truth; nothing where no height
        is known.
        """
        if "height_mm" not in self.arrays:
            return {}
        vertices = self.arrays["vertices"][self.geometry.used].astype(np.float64)
        seen = SeenNormals.of(forward, state, vertices, self.compared)
        u, v, scale = self.geometry.model.face_tile
        height = self.arrays["height_mm"].astype(np.float64)
        true = seen.true_normals((u, v, scale), height)
        vertices = self.geometry.at(state)[self.compared] @ state.rotation.T
        turn = procrustes(vertices, self.vertices, rigid=True).rotation
        errors = {"mesh_normal_degrees": seen.angle(seen.found_normals(None), true, turn)}
        if normal_map is not None:
            errors["normal_degrees"] = seen.angle(seen.found_normals(normal_map), true, turn)
        return errors

    def _face_colors(self, texture: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """(n, 3) albedo at the narrow face's texture coordinates, found and true."""
        true = self.arrays.get("albedo")
        if true is None:
            return None
        uvs = face_uvs(self.geometry)
        u, v, scale = self.geometry.model.face_tile
        true_uvs = (uvs - np.array([u, v])) / scale
        return (sample_bilinear(texture, uvs), sample_bilinear(true.astype(np.float64), true_uvs))


Truth = VertexTruth | ScanTruth


def read_truth(path: Path, geometry: FaceGeometry, region: Path | None = None) -> Truth:
    """The truth in ``path``: a scan where it has triangles of its own, else vertices of the face
    model.

    ``region``: the file that says which vertices of a scan are its face. Raises InputError.
    """
    names = (*TruthSchema().fields, MARK)
    arrays = read_arrays(path, "truth file", TRUTH_ARRAYS_MAX, names)
    if MARK in arrays:
        return ScanTruth(Scan.load(path, region), geometry)
    if region is not None:
        raise InputError(
            f"A face region was given, but the truth file '{path}' is no scan: it has no "
            f"'{MARK}'; leave out --face-region."
        )
    return VertexTruth(path, arrays, geometry)


def probe_irradiance(
    position: np.ndarray,
    direction: np.ndarray,
    area: np.ndarray,
    radiance: np.ndarray,
    centre: np.ndarray,
) -> np.ndarray:
    """(PROBE_NORMALS, 3) irradiance at ``centre`` for normals spread over the hemisphere towards
    +Z.
    """
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

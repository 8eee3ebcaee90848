"""Errors against a scan: distances and deviations that are known beforehand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.scan import Scan
from facestage.fit.given.scan_truth import ScanTruth
from facestage.fit.given.truth import VertexTruth, read_truth
from facestage.models.mesh.surface import vertex_normals
from facestage.render.variant import start_renderer
from reference.synthetic_scene import Scene, synthetic_scene

ALIGNED = ("similarity", "rigid")


@pytest.fixture(scope="module")
def scene() -> Scene:
    start_renderer("cpu")
    return synthetic_scene()


def scanned(scene: Scene, offset_mm: float = 0.0, scale: float = 1.0) -> Scan:
    """The scene's own head, finer: the middles of its triangles too; ``offset_mm`` along the
    normals, out or in by chance, and ``scale`` about the camera.
    """
    vertices, triangles = scene.forward.pose(scene.state)[1], scene.geometry.triangles
    corners = vertices[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    way = np.random.default_rng(0).choice([-1.0, 1.0], (len(triangles), 1))
    middles = corners.mean(axis=1) + 1e-3 * offset_mm * way * normal
    points = 1e3 * scale * np.concatenate([vertices, middles])
    middle = len(vertices) + np.arange(len(triangles))
    a, b, c = triangles.T
    finer = np.stack([[a, b, middle], [b, c, middle], [c, a, middle]]).transpose(2, 0, 1)
    narrow = np.zeros(len(scene.model.vertices), bool)
    narrow[scene.model.regions["narrow_face"]] = True
    face = middle[narrow[scene.geometry.used][triangles].all(axis=1)]
    return Scan(points, finer.reshape(-1, 3), face)


def test_the_truth_has_no_error(scene: Scene):
    errors = ScanTruth(scanned(scene), scene.geometry).geometry_errors(scene.state)
    kinds = [f"{kind}{what}_mm" for kind in ALIGNED for what in ("", "_mean", "_90_percent")]
    assert list(errors) == kinds
    assert max(errors.values()) < 1e-3


def test_size_and_distance_are_taken_out_by_similarity_alone(scene: Scene):
    errors = ScanTruth(scanned(scene, scale=1.1), scene.geometry).geometry_errors(scene.state)
    assert errors["similarity_90_percent_mm"] < 1e-2
    assert errors["rigid_mm"] > 1.0


def test_a_known_distance_is_measured(scene: Scene):
    errors = ScanTruth(scanned(scene, 0.7), scene.geometry).geometry_errors(scene.state)
    # As far as the alignment can take none of 528 distances out by chance.
    assert errors["similarity_mm"] == pytest.approx(0.7, rel=0.06)
    assert errors["similarity_mean_mm"] == pytest.approx(0.7, rel=0.06)
    assert 0.7 < errors["similarity_90_percent_mm"] < 1.0


def test_another_face_is_further_away(scene: Scene):
    truth = ScanTruth(scanned(scene), scene.geometry)
    other = replace(scene.state, identity=scene.state.identity + np.array([0, 0, 1.5, 0]))
    assert truth.geometry_errors(other)["similarity_90_percent_mm"] > 0.5


def columns(scan: Scan, scene: Scene, reach: float) -> Scan:
    """``scan`` with the sheet's vertices up to ``reach`` of its half width for a face."""
    across = np.tile(np.linspace(-1, 1, 23), len(scene.model.vertices) // 23)[scene.geometry.used]
    return replace(scan, face=np.flatnonzero(np.abs(across) < reach))


def test_points_beyond_the_mesh_are_not_covered(scene: Scene):
    scan = scanned(scene)
    narrow = ScanTruth(scan, scene.geometry)
    assert narrow.covered_errors(scene.state)["covered"] == pytest.approx(1.0, abs=0.02)
    wider = ScanTruth(columns(scan, scene, 0.68), scene.geometry)
    np.testing.assert_array_equal(wider.region, scene.model.regions["narrow_face"])
    found = wider.covered_errors(scene.state)
    # Of 15 columns 13 are the narrow face, and its outermost two are its border.
    assert found["covered"] == pytest.approx(11 / 15, abs=0.05)
    assert found["covered_mm"] < 0.05 < wider.geometry_errors(scene.state)["similarity_mean_mm"]


def test_a_face_much_larger_than_the_narrow_one_is_compared_with_more_of_the_mesh(scene: Scene):
    truth = ScanTruth(columns(scanned(scene), scene, 2.0), scene.geometry)
    assert len(truth.region) == len(scene.geometry.used)
    assert truth.covered_errors(scene.state)["covered"] > 0.85
    assert truth.geometry_errors(scene.state)["similarity_90_percent_mm"] < 1e-3


@pytest.mark.parametrize(("deviation", "shares"), [(0.45, (0, 1)), (1.2, (1, 1)), (0.2, (0, 0))])
def test_deviations_are_compared_along_the_normal(
    scene: Scene, deviation: float, shares: tuple[int, int]
):
    """0.7 mm along the normals, where the mesh's deviation is the same along every axis."""
    truth = ScanTruth(scanned(scene, 0.7), scene.geometry)
    found = truth.calibration(scene.state, np.full((len(scene.model.vertices), 3), deviation))
    for name in ("within_{}_sigma", "covered_within_{}_sigma"):
        assert found[name.format(1)] == pytest.approx(shares[0], abs=0.15)
        assert found[name.format(2)] == pytest.approx(shares[1], abs=0.15)
    assert found["error_over_sigma"] == pytest.approx(0.7 / deviation, rel=0.1)


def test_what_lies_across_the_normal_does_not_count(scene: Scene):
    vertices = scene.forward.pose(scene.state)[1]
    normal = vertex_normals(vertices, scene.geometry.triangles)
    # In the middle of the face the normals look nearly along z.
    facing = np.abs(normal[:, 2]) > 0.97
    scan = scanned(scene, 0.7)
    corner = scan.triangles[scan.triangles[:, 2] >= len(vertices)]
    middle = np.unique(corner[facing[corner[:, 0]] & facing[corner[:, 1]], 2])
    chosen = replace(scan, face=np.intersect1d(scan.face, middle))
    truth = ScanTruth(chosen, scene.geometry)
    across = np.tile([50.0, 50.0, 0.01], (len(scene.model.vertices), 1))
    along = np.tile([0.01, 0.01, 50.0], (len(scene.model.vertices), 1))
    small, large = (truth.calibration(scene.state, item) for item in (across, along))
    assert small["error_over_sigma"] > 1.3 * large["error_over_sigma"]


def test_which_kind_of_truth_a_file_is(scene: Scene, tmp_path: Path):
    path = tmp_path / "scan.npz"
    scanned(scene).save(path)
    assert isinstance(read_truth(path, scene.geometry), ScanTruth)
    np.savez(tmp_path / "truth.npz", vertices=scene.model.vertices)
    assert isinstance(read_truth(tmp_path / "truth.npz", scene.geometry), VertexTruth)
    with pytest.raises(InputError, match="no scan: it has no 'triangles'"):
        read_truth(tmp_path / "truth.npz", scene.geometry, path)

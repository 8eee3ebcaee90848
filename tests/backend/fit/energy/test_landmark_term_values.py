"""How far a landmark may be off, by where the face turns: in numbers done by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.landmarks import Landmarks
from facestage.fit.energy.landmark_term import LandmarkTerm, PlacedLandmarks
from facestage.models.anatomy.landmark_schemes import scheme_of
from reference.synthetic_scene import Scene, moved

SIGMA = 1.5
CONTOUR = scheme_of("ibug68").contour
INNER = np.setdiff1d(np.arange(68), CONTOUR)


def turned(
    scene: Scene, degrees: float, nod: float = 0.0
) -> tuple[LandmarkTerm, PlacedLandmarks, np.ndarray]:
    """The term of a turned face around its state, and the cosine of each landmark's normal and
    view.
    """
    state = moved(scene.state, pose=[np.radians(nod), np.radians(degrees), 0, 0, 0, 0])
    term = LandmarkTerm(scene.geometry, scene.landmarks(state), SIGMA)
    vertices, weights = scene.model.landmark_vertices("ibug68")
    corners = scene.geometry.new_index[vertices]
    shape = scene.geometry.at(state)
    normals = (
        np.einsum("mi,mix->mx", weights, scene.geometry.vertex_normals(shape)[0][corners])
        @ state.rotation.T
    )
    points = np.einsum("mi,mix->mx", weights, shape[corners]) @ state.rotation.T + state.translation
    size = np.linalg.norm(points, axis=1) * np.linalg.norm(normals, axis=1)
    return term, term.at(state), -(points * normals).sum(axis=1) / size


@pytest.mark.parametrize("degrees", [0, 50, 75, 95])
def test_a_point_that_turned_away_is_a_guess_four_times_as_wide(scene: Scene, degrees: float):
    term, placed, cosine = turned(scene, degrees)
    share = np.clip((0.05 - cosine[INNER]) / 0.30, 0, 1)
    deviation = term.sigma[INNER] * 4.0**share
    np.testing.assert_allclose(
        placed.whitening[INNER], np.eye(2) / deviation[:, None, None], rtol=1e-6
    )
    if degrees >= 75:
        assert (share > 0.3).any() and (share == 0).any(), "some show and some do not"


def test_the_deviation_of_a_point_is_its_own_and_hidden_three_times_that(scene: Scene):
    scheme, landmarks = scheme_of("ibug68"), scene.landmarks()
    weights = np.ones(68)
    weights[40], weights[41] = 4.0, 0.0
    visible = np.arange(68) != 33
    points = landmarks.points.copy()
    points[34] = np.nan
    given = Landmarks("ibug68", points, visible & (np.arange(68) != 34), weights)
    term = LandmarkTerm(scene.geometry, given, SIGMA)
    wanted = SIGMA * scheme.deviation
    wanted[[33, 40]] *= [3.0, 0.5]
    wanted[[34, 41]] = np.inf
    np.testing.assert_allclose(term.sigma, wanted)
    assert term.observations == pytest.approx(np.delete(scheme.share, [34, 41]).sum())


@pytest.mark.parametrize(("degrees", "nod"), [(0, 0), (40, 0), (75, 0), (0, -50), (60, -30)])
def test_the_outline_may_slide_along_itself_where_the_face_ends(
    scene: Scene, degrees: float, nod: float
):
    """Hidden marks stay where the scheme has them, so that the cosines are theirs."""
    state = moved(scene.state, pose=[np.radians(nod), np.radians(degrees), 0, 0, 0, 0])
    landmarks = replace(scene.landmarks(state), visible=~np.isin(np.arange(68), CONTOUR))
    term = LandmarkTerm(scene.geometry, landmarks, SIGMA)
    # The 68 points are as sure along the outline as across it; the 478 are not.
    scheme = replace(term.scheme, across=0.6, along=1.7)
    vars(term)["scheme"] = scheme
    placed = term.at(state)
    cosine = turned(scene, degrees, nod)[2][CONTOUR]
    grazing = np.clip((0.5 - cosine) / 0.2, 0, 1)
    deviation = (
        3.0 * SIGMA * scheme.deviation[CONTOUR] * 4.0 ** np.clip((0.05 - cosine) / 0.30, 0, 1)
    )
    step = np.gradient(placed.project(state)[CONTOUR], axis=0)
    tangent = step / np.linalg.norm(step, axis=1, keepdims=True)
    normal = tangent[:, ::-1] * [1, -1]
    whitening = placed.whitening[CONTOUR]
    along = np.linalg.norm(np.einsum("kxy,ky->kx", whitening, tangent), axis=1)
    across = np.linalg.norm(np.einsum("kxy,ky->kx", whitening, normal), axis=1)
    np.testing.assert_allclose(along, 1 / (deviation * scheme.along**grazing), rtol=1e-6)
    np.testing.assert_allclose(across, 1 / (deviation * scheme.across**grazing), rtol=1e-6)
    assert grazing.max() > 0 and grazing.min() < 1
    assert nod == 0 or cosine.max() > 0.55, "some face the camera"


def test_the_robust_energy_is_what_the_weights_pull_down(scene: Scene):
    placed = LandmarkTerm(scene.geometry, scene.landmarks(noise_px=4.0), SIGMA).at(scene.state)
    residual = placed.residuals(scene.state)
    squared = (residual.reshape(-1, 2) ** 2).sum(axis=1)
    wanted = 4.5 * (placed.share * np.log1p(squared / 9)).sum()
    assert placed.robust_energy(residual) == pytest.approx(wanted)
    np.testing.assert_allclose(
        placed.robust_weights(residual), np.repeat(placed.share / (1 + squared / 9), 2)
    )


def test_what_slid_to_the_outline_shows(scene: Scene):
    """However far it is turned away where it slid to, it is no guess; and no surer than it is on
    the skin.
    """
    state = moved(scene.state, pose=[0, np.radians(40), 0, 0, 0, 0])
    landmarks, scheme = scene.landmarks(state), scheme_of("ibug68")
    seen = LandmarkTerm(scene.geometry, landmarks, SIGMA).at(state)
    unseen = LandmarkTerm(
        scene.geometry, replace(landmarks, visible=~np.isin(np.arange(68), CONTOUR)), SIGMA
    ).at(state)
    distance = np.linalg.norm(seen.project(state) - unseen.project(state), axis=1)[CONTOUR]
    slid = CONTOUR[distance > 1e-6]
    assert 0 < len(slid) < len(CONTOUR)
    deviation = (
        1
        / np.linalg.svd(seen.whitening[slid], compute_uv=False)
        / (SIGMA * scheme.deviation[slid, None])
    )
    assert (deviation > 1 - 1e-6).all()
    assert (deviation < max(scheme.across, scheme.along) + 1e-6).all()

"""Landmarks of the outline on a head that turns: where they slide to, and what that is worth to the
shape.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from facestage.contract.camera import Camera
from facestage.contract.job import Weights
from facestage.contract.landmarks import SCHEME_SIZES, Landmarks
from facestage.fit.energy.energy import Energy
from facestage.fit.energy.landmark_term import LandmarkTerm
from facestage.fit.energy.priors import Priors
from facestage.fit.face.contour_lines import contour_lines
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.layout import Layout
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import SHAPE, Known
from facestage.fit.given.metrics import aligned_distance
from facestage.fit.stages.photo_descent import PhotoDescent
from facestage.models.anatomy.landmark_schemes import scheme_of
from facestage.models.registry import load_model

SIDE = 256
MM = 1e-3


@pytest.fixture(scope="module")
def head() -> FaceGeometry:
    return FaceGeometry(load_model("default"))


def turned(
    head: FaceGeometry, yaw: float = 0.0, pitch: float = 0.0, seed: int | None = None
) -> State:
    """The mean face, or a random one, 70 cm away, turned by degrees; positive yaw turns to the
    subject's left.
    """
    random = np.random.default_rng(seed)
    identity = np.zeros(len(head.model.identity_names))
    expression = np.zeros(len(head.model.expression_names))
    if seed is not None:
        identity = np.clip(0.8 * random.normal(size=len(identity)), -2, 2)
        expression[list(head.model.expression_names).index("mouthSmileLeft")] = 0.4
    return State(
        Rotation.from_euler("xy", [pitch, yaw], degrees=True).as_matrix(),
        np.array([0.0, 0.0, -0.7]),
        Camera.default(SIDE, SIDE, 2.5 * SIDE),
        identity,
        expression,
        np.zeros(0),
        np.zeros((0, 2)),
        np.zeros(len(head.model.albedo_basis)),
        0.4,
        np.ones((2, 2)),
    )


def fixed_points(head: FaceGeometry, scheme: str, state: State) -> np.ndarray:
    """(m, 2) pixels of the table's own points."""
    corners, weights = head.model.landmark_vertices(scheme)
    shape = (
        head.model.shape(state.identity, state.expression) @ state.rotation.T + state.translation
    )
    return state.camera.project(np.einsum("mi,mix->mx", weights, shape[corners]))


def landmarks_at(head: FaceGeometry, scheme: str, state: State) -> Landmarks:
    return Landmarks(scheme, fixed_points(head, scheme, state), np.ones(SCHEME_SIZES[scheme], bool))


def slid(head: FaceGeometry, scheme: str, state: State) -> np.ndarray:
    return LandmarkTerm(head, landmarks_at(head, scheme, state), 1.0).at(state).project(state)


def test_lines_lead_over_the_skin_to_their_landmarks(head: FaceGeometry):
    corners, weights = head.model.landmark_vertices("ibug68")
    contour = scheme_of("ibug68").contour
    corners, weights = head.new_index[corners[contour]], weights[contour].astype(float)
    lines = contour_lines(head, corners, weights)
    points = np.einsum("kci,kcix->kcx", lines.weights, head.mean[lines.corners])
    np.testing.assert_allclose(lines.weights.sum(axis=2), 1, atol=1e-6)
    np.testing.assert_allclose(
        points[:, -1], np.einsum("ki,kix->kx", weights, head.mean[corners]), atol=1e-9
    )
    # Each candidate lies in the plane of axis and landmark, and the next one is near.
    aside = np.cross(lines.outward, [0.0, 0.0, 1.0])
    assert np.abs(np.einsum("kcx,kx->kc", points - lines.centre, aside)).max() < 1e-6
    assert np.linalg.norm(np.diff(points, axis=1), axis=2).max() < 25 * MM


@pytest.mark.parametrize("scheme", SCHEME_SIZES)
def test_the_frontal_outline_stays(head: FaceGeometry, scheme: str):
    state = turned(head)
    moved = np.linalg.norm(slid(head, scheme, state) - fixed_points(head, scheme, state), axis=1)
    print(
        f"{scheme}: largest shift {moved.max():.2f} px of {SIDE}, median {np.median(moved):.2f} px"
    )
    assert moved.max() < 3.5 and np.median(moved) < 0.5


@pytest.mark.parametrize("yaw", [30.0, 60.0])
def test_the_far_cheek_lies_on_the_silhouette_and_the_near_one_stays(
    head: FaceGeometry, yaw: float
):
    state = turned(head, yaw)
    found, fixed = slid(head, "ibug68", state), fixed_points(head, "ibug68", state)
    shape = head.mean @ state.rotation.T + state.translation
    skin = state.camera.project(shape[head.fitted_vertices])
    # The nose may stand out further than the cheek.
    skin = skin[np.abs(head.mean[head.fitted_vertices, 0]) > 25 * MM]
    # Turning to its left, the head shows its right side; the left cheek is the outline, to the
    # right of the picture.
    far, opposite = [13, 14, 15] if yaw < 45 else [14, 15], [1, 2, 3]
    np.testing.assert_allclose(found[opposite], fixed[opposite])
    for point in far:
        level = np.abs(skin[:, 1] - found[point, 1]) < 3
        edge = skin[level, 0].max()
        print(
            f"yaw {yaw}, point {point}: {edge - found[point, 0]:.2f} px inside the silhouette, "
            f"fixed {edge - fixed[point, 0]:.2f} px"
        )
        assert abs(edge - found[point, 0]) < 3.5
        assert found[point, 0] >= fixed[point, 0] - 1e-6


def test_where_the_mouth_hides_the_cheek_the_outline_is_a_guess(head: FaceGeometry):
    state = turned(head, 70.0)
    term = LandmarkTerm(head, landmarks_at(head, "ibug68", state), 1.0)
    size = np.linalg.norm(term.at(state).whitening, axis=(1, 2)) * term.sigma
    assert size[13] < 0.5 * size[1:4].min()


def test_a_point_that_is_marked_as_hidden_is_not_the_outline(head: FaceGeometry):
    state = turned(head, 40.0)
    shown = landmarks_at(head, "ibug68", state)
    hidden = replace(shown, visible=np.arange(68) != 14)
    moved = [
        np.linalg.norm(
            LandmarkTerm(head, item, 1.0).at(state).project(state) - shown.points, axis=1
        )
        for item in (shown, hidden)
    ]
    assert moved[0][14] > 5 and moved[1][14] < 1e-6
    np.testing.assert_allclose(moved[0][:14], moved[1][:14])


def test_hidden_points_count_for_little_whatever_the_file_says(head: FaceGeometry):
    state = turned(head, 70.0)
    landmarks = landmarks_at(head, "mediapipe478", state)
    term = LandmarkTerm(head, landmarks, 1.0)
    size = np.linalg.norm(term.at(state).whitening, axis=(1, 2)) * term.sigma
    right_cheek, left_cheek = 137, 366
    assert (
        size[right_cheek] == pytest.approx(np.sqrt(2))
        and size[left_cheek] < 0.3 * size[right_cheek]
    )
    assert (size <= np.sqrt(2) + 1e-9)[np.setdiff1d(np.arange(478), term.scheme.contour)].all()


def test_the_frontal_outline_is_sharper_across_than_along(head: FaceGeometry):
    state = turned(head)
    term = LandmarkTerm(head, landmarks_at(head, "mediapipe478", state), 1.0)
    whitening = term.at(state).whitening[93] * term.sigma[93]
    across, along = (
        np.linalg.norm(whitening @ direction) for direction in ([1.0, 0.0], [0.0, 1.0])
    )
    assert across > 2 * along


def test_weights_are_inverse_variances(head: FaceGeometry):
    state = turned(head)
    plain = landmarks_at(head, "mediapipe478", state)
    weights = np.ones(478)
    weights[[5, 6]] = [4.0, 0.0]
    one, other = (
        LandmarkTerm(head, item, 1.0) for item in (plain, replace(plain, weights=weights))
    )
    ratio = np.diagonal(other.at(state).whitening, axis1=1, axis2=2) / np.diagonal(
        one.at(state).whitening, axis1=1, axis2=2
    )
    np.testing.assert_allclose(ratio[[4, 5, 6]], [[1, 1], [2, 2], [0, 0]])
    assert other.observations == pytest.approx(one.observations - one.scheme.share[6])


@pytest.mark.parametrize("block", ["pose", "identity"])
def test_the_jacobian_is_right_with_the_outline_held(head: FaceGeometry, block: str):
    state = turned(head, 40.0, -8.0, seed=3)
    layout = Layout(state)
    landmarks = landmarks_at(head, "mediapipe478", turned(head, 38.0))
    placed = LandmarkTerm(head, landmarks, 1.0).at(state)
    jacobian = placed.jacobian(state, layout)
    for column in range(layout.slices[block].start, layout.slices[block].start + 4):
        step = np.zeros(layout.size)
        step[column] = 1e-5
        plus, minus = (placed.residuals(layout.apply(state, sign * step)) for sign in (1, -1))
        wanted = (plus - minus) / 2e-5
        error = np.abs(jacobian[:, column] - wanted).max() / np.abs(wanted).max()
        print(f"{block}: error {error:.1e}, margin {1e-3 / error:.0f}x")
        # Shapes are float32.
        assert error < 1e-3


def recovered_mm(
    head: FaceGeometry, truth: State, landmarks: Landmarks, slides: bool = True
) -> float:
    """Mean distance of the narrow face after similarity alignment, from landmarks alone."""
    start = replace(truth, identity=0 * truth.identity, expression=0 * truth.expression)
    layout, weights = Layout(start), Weights()
    term = LandmarkTerm(head, landmarks, 1.0)
    if not slides:
        vars(term)["_candidates"] = replace(term._candidates, lines=None)
    lights = LightParameters(np.zeros(0, bool), np.zeros((0, 3)), False)
    known = Known(lights, start.camera.focal_px, stage_lights=1)
    energy = Energy(layout, (Priors(layout, known, weights), term))
    low, high = layout.bounds(known)
    freeze = layout.mask(["focal"])
    for item in PhotoDescent("landmarks", SHAPE, energy, 15, freeze, low, high).run(
        start, 0, np.inf
    ):
        start = item.state
    region = head.new_index[head.model.regions["narrow_face"]]
    found, wanted = (
        head.vertices(state.identity, state.expression)[region] for state in (start, truth)
    )
    return float(aligned_distance(found, wanted, scale=True).mean()) / MM


def test_478_points_recover_a_face_as_well_as_68(head: FaceGeometry):
    errors: dict[str, list[float]] = {name: [] for name in SCHEME_SIZES}
    for seed in range(3):
        truth = turned(head, yaw=12.0 * seed, seed=seed)
        for name in SCHEME_SIZES:
            exact = landmarks_at(head, name, truth)
            noise = np.random.default_rng(seed).normal(size=exact.points.shape)
            errors[name].append(
                recovered_mm(head, truth, replace(exact, points=exact.points + 0.7 * noise))
            )
    mean = {name: float(np.mean(values)) for name, values in errors.items()}
    print(f"mm after similarity alignment: {mean}")
    assert mean["mediapipe478"] <= 1.05 * mean["ibug68"]


def test_a_sliding_outline_makes_the_shape_of_a_turned_face_better(head: FaceGeometry):
    held, free = [], []
    for seed in range(3):
        truth = turned(head, yaw=45.0, seed=seed)
        points = slid(head, "ibug68", truth)
        points = points + 0.5 * np.random.default_rng(seed).normal(size=points.shape)
        marked = Landmarks("ibug68", points, np.ones(68, bool))
        held.append(recovered_mm(head, truth, marked, slides=False))
        free.append(recovered_mm(head, truth, marked))
    print(f"mm after similarity alignment: fixed vertices {held}, sliding {free}")
    assert np.mean(free) < np.mean(held)

"""The add-on's landmark stage minimises what the backend's does."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.contract.camera import Camera
from facestage.contract.landmarks import Landmarks
from facestage.contract.pins import Pins
from facestage.fit.energy.landmark_term import LANDMARK_SIGMA_SHARE, LandmarkTerm
from facestage.fit.energy.pin_term import PinTerm, surface_points
from facestage.fit.energy.term import Quadratic
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import EXPRESSION_SIGMA
from facestage.models.anatomy.shipped_landmarks import read_deviations
from facestage_blender.pins.solver import Guess, Shapes, Sight, energy, rotation, solve
from reference.synthetic_face import synthetic_face

CAMERA = Camera(96, 96, 200.0, (49.0, 46.0))


def test_constants_are_the_backends():
    from facestage_blender.pins import pinning, rig_shapes

    assert pinning.LANDMARK_SIGMA_SHARE == LANDMARK_SIGMA_SHARE
    assert pytest.approx(read_deviations()[1], rel=0.05) == pinning.INDEPENDENT
    assert rig_shapes.EXPRESSION_SIGMA == EXPRESSION_SIGMA


def test_energy_and_minimum_are_the_backends():
    """68 landmarks with noise, the outline left out, which slides there; and two pins far off."""
    model = synthetic_face()
    geometry, random = FaceGeometry(model), np.random.default_rng(3)
    identities, expressions = len(model.identity_names), len(model.expression_names)

    def state_of(guess: Guess) -> State:
        return State(
            rotation=guess.to_camera[:3, :3],
            translation=guess.to_camera[:3, 3],
            camera=CAMERA,
            identity=guess.sliders[:identities],
            expression=guess.sliders[identities:],
            lights=np.zeros(0),
            light_position=np.zeros((0, 2)),
            albedo=np.zeros(len(model.albedo_basis)),
            roughness=0.4,
            specular=np.ones((2, 2)),
        )

    to_camera = np.eye(4)
    to_camera[:3, :3] = rotation(np.array([0.1, 0.25, -0.05]))
    to_camera[:3, 3] = 0.012, -0.008, -0.6
    truth = Guess(
        to_camera, np.r_[random.normal(size=identities), random.uniform(0.2, 0.8, expressions)]
    )
    corners, weights = model.landmark_vertices("ibug68")
    pinned = np.array([corners[30], corners[48]])
    corners, weights = (
        np.concatenate([corners, pinned]),
        np.concatenate([weights.astype(float), np.full((2, 3), 1 / 3)]),
    )

    def at(basis: np.ndarray) -> np.ndarray:
        return np.einsum("mi,mix->mx", weights, basis[corners].astype(float))

    basis = [*model.identity_basis, *model.expression_basis]
    shapes = Shapes(
        at(model.vertices),
        np.stack([at(each) for each in basis], axis=2),
        np.r_[np.ones(identities), np.full(expressions, EXPRESSION_SIGMA)],
        np.full(len(basis), -20.0),  # the terms know no bounds
        np.full(len(basis), 20.0),
    )
    seen = CAMERA.project(shapes.at(truth.sliders) @ to_camera[:3, :3].T + to_camera[:3, 3])
    seen[:68] += random.normal(size=(68, 2))
    seen[68:] += [[5.0, 2.0], [-3.0, 4.0]]
    counts = np.arange(68) >= 17
    landmarks = Landmarks("ibug68", seen[:68], np.ones(68, bool), counts.astype(float))
    pins = Pins(pinned, np.full((2, 3), 1 / 3), seen[68:], np.full(2, 0.1))
    terms = (LandmarkTerm(geometry, landmarks, 0.8), PinTerm(surface_points(geometry, pins), pins))
    deviation = np.r_[np.where(counts, 0.8, np.inf), pins.deviation]
    sight = Sight(CAMERA, seen, deviation, np.ones(70), np.arange(70) >= 68)
    rest = np.zeros(identities + expressions)

    found = solve(shapes, sight, truth, rest)
    for guess in (truth, found):
        state = state_of(guess)
        robust = sum(sum(term.at(state).weighed(state).robust.values()) for term in terms)
        prior = 0.5 * float(((guess.sliders / shapes.spread) ** 2).sum())
        assert energy(shapes, sight, guess, rest) == pytest.approx(robust + prior, rel=1e-6)
    assert np.abs(found.sliders).max() < 20
    gradient = {}
    for name, guess in (("start", truth), ("found", found)):
        state = state_of(guess)
        layout = Layout(state)
        total = Quadratic.zero(layout, np.ones(layout.size, bool))
        for term in terms:
            term.at(state).weighed(state).add_to(total)
        total.gradient[layout.shape][: len(rest)] += guess.sliders / shapes.spread**2
        moving = np.r_[total.gradient[layout.slices["pose"]], total.gradient[layout.shape]]
        gradient[name] = np.abs(moving).max()
    print(gradient)
    assert gradient["found"] < 1e-3 * gradient["start"]

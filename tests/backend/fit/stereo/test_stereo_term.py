"""The stereo term against differences, and what it does for a shape."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.job import Weights
from facestage.fit.energy.energy import Energy
from facestage.fit.energy.priors import Priors
from facestage.fit.face.joint_layout import JointLayout
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import RELIEF, SHAPE, SHARED
from facestage.fit.stages.joint_descent import JointDescent
from facestage.fit.stages.photo_descent import PhotoDescent
from facestage.fit.stereo.matches import compare
from facestage.fit.stereo.stereo_term import Pair, StereoTerm
from reference.speckled_face import pair, sight, turned, wrong
from reference.synthetic_scene import Scene

FLOOR = 0.15


@pytest.fixture(scope="module")
def truth(scene: Scene) -> tuple[State, State]:
    return turned(scene, 15), turned(scene, -20)


def begun(truth: tuple[State, State]) -> tuple[State, State]:
    """A wrong shape, one for both; the second pose is its own."""
    first, second = (wrong(state) for state in truth)
    return first, replace(second, expression=truth[1].expression)


@pytest.fixture(scope="module")
def term(scene: Scene, truth: tuple[State, State]) -> StereoTerm:
    photos, start = pair(scene, *truth), begun(truth)
    sights = [sight(scene, *one) for one in zip(photos, start, strict=True)]
    found = compare(sights[0], sights[1], 8).matches
    assert found is not None
    return StereoTerm((Pair(0, 1, scene.forward, found),), (FLOOR, FLOOR))


def layout_of(states: tuple[State, ...]) -> JointLayout:
    return JointLayout([Layout(state) for state in states])


def stepped(states: tuple[State, ...], layout: JointLayout, step: np.ndarray) -> tuple[State, ...]:
    return tuple(
        own.apply(state, step[columns])
        for own, state, columns in zip(layout.layouts, states, layout.columns, strict=True)
    )


def test_derivatives_are_those_of_differences(term: StereoTerm, truth: tuple[State, State]):
    states = begun(truth)
    layout = layout_of(states)
    placed = term.weighed(states).pairs[0].placed
    jacobian, columns = placed.jacobian(states, layout)
    # Both photos' poses, lenses and expressions; identity and relief move both.
    own = sum(
        int(one.mask(SHAPE).sum() - one.mask(set(SHAPE) & set(SHARED)).sum())
        for one in layout.layouts
    )
    assert len(columns) == own + len(states[0].identity) + len(states[0].relief)
    worst = 0.0
    for place, column in enumerate(columns):
        step = np.zeros(layout.size)
        step[column] = 3e-4
        ends = [placed.residuals(stepped(states, layout, sign * step)) for sign in (1, -1)]
        numeric = (ends[0] - ends[1]) / 6e-4
        scale = max(float(np.abs(jacobian[..., place]).max()), 1e-3)
        worst = max(worst, float(np.abs(numeric - jacobian[..., place]).max()) / scale)
    print(f"worst difference {worst:.1e} of the column's largest entry")
    assert worst < 2e-3


def test_gradient_is_the_slope_of_the_energy(term: StereoTerm, truth: tuple[State, State]):
    states = begun(truth)
    layout, weighed = layout_of(states), term.weighed(states)
    hessian, gradient = np.zeros((layout.size,) * 2), np.zeros(layout.size)
    weighed.add_to(hessian, gradient, layout)
    moving = np.flatnonzero(gradient)
    step = np.zeros(layout.size)
    step[moving] = 1e-5 * np.random.default_rng(1).normal(size=len(moving))
    step *= np.sign(gradient)
    half = [weighed.decrease(stepped(states, layout, sign * step)) for sign in (1, -1)]
    assert (half[1] - half[0]) / 2 == pytest.approx(gradient @ step, rel=1e-2)
    assert weighed.decrease(states) == 0
    total = sum(sum(one.values()) for one in weighed.energies)
    pair_, squared = weighed.pairs[0], (weighed.pairs[0].residuals ** 2).sum(axis=1)
    assert total == pytest.approx(0.5 * pair_.weights @ squared)


def test_the_truth_explains_the_matches(term: StereoTerm, truth: tuple[State, State]):
    there, before = (
        np.abs(term.weighed(states).pairs[0].residuals) for states in (truth, begun(truth))
    )
    assert np.median(there) < 1.0
    assert np.mean(before) > 3 * np.mean(there)


def test_a_face_behind_the_camera_has_no_energy(term: StereoTerm, truth: tuple[State, State]):
    weighed = term.weighed(truth)
    behind = replace(truth[1], translation=np.array([0.0, 0.0, 0.6]))
    assert weighed.decrease((truth[0], behind)) == -np.inf


def test_it_finds_the_relief_of_the_truth(scene: Scene):
    wanted = np.array([3.0, -2.0])
    truth = tuple(replace(turned(scene, angle), relief=wanted) for angle in (15, -20))
    start = tuple(replace(state, relief=np.zeros(2)) for state in truth)
    photos = pair(scene, *truth)
    sights = [sight(scene, *one) for one in zip(photos, start, strict=True)]
    found = compare(sights[0], sights[1], 8).matches
    assert found is not None
    term = StereoTerm((Pair(0, 1, scene.forward, found),), (FLOOR, FLOOR))
    descents = []
    for state in start:
        layout = Layout(state)
        known = scene.known()
        energy = Energy(layout, (Priors(layout, known, Weights(prior=1e-2)),))
        freeze = np.zeros(layout.size, bool)
        descents.append(
            PhotoDescent("test", RELIEF, energy, 20, freeze, *layout.bounds(known), tolerance=1e-5)
        )
    last = JointDescent(descents, (term,)).last(start, 1)
    assert last is not None
    ended = last.parts[0].state.relief
    print(f"{ended}, true {wanted}")
    np.testing.assert_allclose(ended, wanted, atol=0.6)
    np.testing.assert_array_equal(ended, last.parts[1].state.relief)


def test_it_pulls_the_shape_to_the_truth(
    scene: Scene, term: StereoTerm, truth: tuple[State, State]
):
    # The first photo's pose is held, or all could move as one.
    start = begun(truth)
    start = (
        replace(start[0], rotation=truth[0].rotation, translation=truth[0].translation),
        start[1],
    )
    descents = []
    for number, state in enumerate(start):
        layout = Layout(state)
        known = scene.known()
        energy = Energy(layout, (Priors(layout, known, Weights(prior=1e-2)),))
        freeze = layout.mask(("focal", "pose") if number == 0 else ("focal",))
        descents.append(
            PhotoDescent("test", SHAPE, energy, 20, freeze, *layout.bounds(known), tolerance=1e-5)
        )
    joint = JointDescent(descents, (term,))
    system = joint.system(start, (None, None))
    assert system.total == pytest.approx(sum(sum(one.values()) for one in system.energies)) and all(
        "stereo" in one for one in system.energies
    )
    alone = sum(one.decrease(state, None) for one, state in zip(system.systems, truth, strict=True))
    gained = system.decrease(truth, (None, None)) - alone
    assert gained == pytest.approx(term.weighed(start).decrease(truth)) and gained > 0
    last = joint.last(start, 1)
    assert last is not None
    ended = [part.state for part in last.parts]
    assert all("stereo" in part.energy for part in last.parts)

    def error(state: State, true: State) -> float:
        meshes = [scene.geometry.at(one) for one in (state, true)]
        return float(1e3 * np.linalg.norm(meshes[0] - meshes[1], axis=1).mean())

    before, after = error(start[0], truth[0]), error(ended[0], truth[0])
    print(f"{before:.2f} mm before, {after:.2f} mm after")
    assert after < 0.35 * before

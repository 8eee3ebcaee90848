"""The joint system of several photos against the same rows written out, in float64."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.job import Weights
from facestage.fit.face.joint_layout import JointLayout
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import SHARED
from facestage.fit.solve.covariance import marginal_hessian
from facestage.fit.stages.joint_descent import JointDescent
from facestage.fit.stages.photo_descent import PhotoDescent
from reference.dense_system import data_rows, prior_rows, side_by_side, stacked
from reference.synthetic_scene import Scene, moved
from reference.two_photos import another_photo

BLOCKS = ("pose", "focal", "identity", "expression", "lights", "albedo", "roughness", "specular")
SEED = 3
# float32 products over a block of pixels, relative to the columns' lengths.
BOUND = 5e-6


@pytest.fixture(scope="module")
def scenes(scene: Scene) -> list[Scene]:
    return [scene, another_photo(scene), another_photo(scene, 64, (0.2, 0.1, 0.0))]


def descent_of(scene: Scene, blocks: tuple[str, ...] = BLOCKS, steps: int = 6) -> PhotoDescent:
    photo, _ = scene.render(samples=8)
    return scene.solver(
        photo, blocks, steps, Weights(), samples=4, landmarks=scene.landmarks(noise_px=0.5)
    )


def guess(scene: Scene, seed: int = 5) -> State:
    """A state beside the truth; identity and skin are the same for all photos."""
    shift = np.random.default_rng(seed)
    return moved(
        scene.state,
        pose=0.004 * shift.normal(size=6),
        identity=[0.2, 0.3, -0.3, 0.1],
        albedo=[0.2, 0.1, -0.2, 0, 0.3],
        expression=[0.05, -0.05, 0.1],
        lights=0.3 * np.ones(scene.lights.size),
        roughness=0.02,
    )


def test_hessian_and_gradient_are_those_of_all_rows(scenes: list[Scene]):
    states = tuple(guess(one) for one in scenes)
    joint, alone = (
        JointDescent([descent_of(one) for one in scenes]),
        [descent_of(one) for one in scenes],
    )
    found = joint.system(states, joint.evaluate(states, SEED, everything=True))
    rows = []
    for number, (descent, state) in enumerate(zip(alone, states, strict=True)):
        # The priors of what is shared count once.
        names = set(descent.energy.layout.slices) - (set(SHARED) if number else set())
        rows.append(
            stacked([data_rows(descent, state, SEED), prior_rows(descent, state, sorted(names))])
        )
    whole = side_by_side(rows, [descent.energy.layout for descent in alone], SHARED)
    hessian, gradient = whole.normal_equations()
    assert hessian.shape == found.hessian.shape == (joint.layout.size,) * 2
    length = np.sqrt(np.diag(hessian))
    error = float(
        (np.abs(found.hessian - hessian) / (np.outer(length, length) + 1e-12 * hessian.max())).max()
    )
    scale = length * np.sqrt(float(whole.weights @ whole.residual**2)) + 1e-12
    slope = float((np.abs(found.gradient - gradient) / scale).max())
    print(f"Hessian {error:.1e}, gradient {slope:.1e} of the columns' lengths, allowed {BOUND:g}")
    assert max(error, slope) < BOUND
    first = slice(joint.layout.shared, joint.layout.shared + 3)
    assert not found.hessian[first, -3:].any(), "photos are tied by what they share alone"


def test_a_step_moves_what_is_shared_as_one(scenes: list[Scene]):
    joint = JointDescent([descent_of(one, steps=2) for one in scenes])
    start = tuple(guess(one) for one in scenes)
    steps = list(joint.run(start, SEED, float("inf")))
    assert steps
    states = [part.state for part in steps[-1].parts]
    for name in SHARED:
        for state in states[1:]:
            np.testing.assert_array_equal(
                getattr(state, name), getattr(states[0], name), err_msg=name
            )
    assert not np.allclose(states[0].identity, start[0].identity)
    assert not np.allclose(states[0].expression, states[1].expression)


def test_one_photo_is_the_stage_itself(scene: Scene):
    start = guess(scene)
    (joint,) = [list(JointDescent([descent_of(scene, steps=2)]).run((start,), SEED, float("inf")))]
    plain = list(descent_of(scene, steps=2).run(start, SEED, float("inf")))
    layout = Layout(start)
    for found, wanted in zip(joint, plain, strict=True):
        np.testing.assert_allclose(
            layout.values(found.parts[0].state), layout.values(wanted.state), rtol=1e-6, atol=1e-8
        )
        assert found.finished == wanted.finished


def test_it_goes_on_as_long_as_any_photo_has_not_settled(scenes: list[Scene]):
    def run(further: int, shares: tuple[float, float]) -> list[bool]:
        descents = [descent_of(one, steps=1) for one in scenes[:2]]
        for descent, share in zip(descents, shares, strict=True):
            descent.further, descent.settled_share = further, share
        start = tuple(guess(one) for one in scenes[:2])
        return [step.finished for step in JointDescent(descents).run(start, SEED, float("inf"))]

    assert run(0, (0.0, 0.0)) == [True]
    # A step that lowers the residual by less than 100 % is small, by less than -100 % never.
    assert run(2, (1.0, 1.0)) == [True]
    assert run(2, (1.0, -1.0)) == [False, False, True]
    assert run(2, (-1.0, 1.0)) == [False, False, True]


def test_frozen_by_one_is_frozen_for_all(scenes: list[Scene]):
    descents = [descent_of(one, steps=1) for one in scenes]
    descents[1].freeze = Layout(scenes[1].state).mask({"identity"})
    start = tuple(guess(one) for one in scenes)
    for step in JointDescent(descents).run(start, SEED, float("inf")):
        for part, state in zip(step.parts, start, strict=True):
            np.testing.assert_array_equal(part.state.identity, state.identity)


def test_what_all_say_of_one_photo_is_its_block_of_the_inverse(scenes: list[Scene]):
    states = tuple(guess(one) for one in scenes[:2])
    joint = JointDescent([descent_of(one, steps=1) for one in scenes[:2]])
    step = next(iter(joint.run(states, SEED, float("inf"))))
    free = joint.active
    inverse = np.linalg.inv(step.hessian[np.ix_(free, free)])
    place = np.cumsum(free) - 1
    for index, columns in enumerate(joint.layout.columns):
        part = step.marginal(index, joint.layout, free)
        own = free[columns]
        wanted = inverse[np.ix_(place[columns[own]], place[columns[own]])]
        found = np.linalg.inv(part.hessian[np.ix_(own, own)])
        scale = np.sqrt(np.outer(np.diag(wanted), np.diag(wanted)))
        assert np.abs((found - wanted) / scale).max() < 1e-4
        np.testing.assert_array_equal(
            np.diag(part.prior_hessian)[Layout(states[index]).slices["identity"]], 1.0
        )
        if index == 0:
            # The first photo carries the priors of what is shared, so its own system can be solved
            # alone.
            alone = np.diag(np.linalg.inv(step.parts[0].hessian[np.ix_(own, own)]))
            assert (np.diag(found) <= alone * (1 + 1e-6)).all(), (
                "with another photo nothing is known less well"
            )


def test_a_hessian_without_others_is_itself():
    hessian = np.diag([1.0, 2.0, 3.0])
    np.testing.assert_array_equal(
        marginal_hessian(hessian, np.arange(3), np.ones(3, bool)), hessian
    )


def test_photos_of_other_sizes_of_shape_are_refused(scene: Scene):
    longer = replace(scene.state, identity=np.zeros(5))
    with pytest.raises(ValueError, match="identity"):
        JointLayout([Layout(scene.state), Layout(longer)])

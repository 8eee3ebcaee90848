"""What a stage lets the solver move, and which lights it lets rest."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from facestage.contract.job import Weights
from facestage.fit.energy.photo_term import PhotoTerm
from facestage.fit.energy.plan import Ledger, Work
from facestage.fit.face.layout import Layout
from facestage.fit.stages.photo_descent import PhotoDescent
from reference.known import known
from reference.synthetic_scene import Scene

# Of each of six lights: dark in all colors or not, and where the energy falls.
DARK = [False, True, False, True, True, False]
UPHILL = [1.0] * 3
GRADIENT = np.array([UPHILL, UPHILL, UPHILL, [1, 1, -1], [0, 0, 0], UPHILL], float)


def stage_of(scene: Scene, *blocks: str) -> PhotoDescent:
    return scene.solver(scene.render(samples=2)[0], blocks, 2, Weights())


def landmark_stage(scene: Scene, *blocks: str) -> PhotoDescent:
    """A stage without a photo."""
    stage = stage_of(scene, *blocks)
    stage.energy = stage.energy.without(PhotoTerm)
    return stage


@pytest.fixture
def dim(scene: Scene) -> Scene:
    """The scene with three lights off, and no red in the last."""
    lights = np.where(np.array(DARK)[:, None], 0.0, scene.state.lights.reshape(6, 3))
    lights[5, 0] = 0
    return replace(scene, state=replace(scene.state, lights=lights.ravel()))


def test_only_what_is_not_held_moves(scene: Scene):
    stage, layout = stage_of(scene, "pose", "lights"), Layout(scene.state)
    np.testing.assert_array_equal(stage.active, layout.mask(("pose", "lights")))
    stage.freeze = layout.mask(("pose", "albedo"))
    np.testing.assert_array_equal(stage.active, layout.mask(("lights",)))
    np.testing.assert_array_equal(stage.free(), stage.active)


def test_a_light_rests_that_is_dark_and_that_the_energy_holds_there(dim: Scene):
    stage, layout = stage_of(dim, "pose", "lights"), Layout(dim.state)
    assert len(stage.resting) == 0, "nobody has asked yet"
    gradient = np.zeros(layout.size)
    gradient[layout.slices["lights"]] = GRADIENT.ravel()
    stage.rest(dim.state, gradient)
    # Blue of the fourth would grow, the fifth is at the foot of the slope, the last is not dark.
    np.testing.assert_array_equal(stage.resting, [False, True, False, False, False, False])
    rests = layout.slices["lights"].start + np.arange(3, 6)
    np.testing.assert_array_equal(np.flatnonzero(stage.active & ~stage.free()), rests)
    assert not stage.free()[layout.slices["albedo"]].any()


def test_where_lights_may_not_move_every_dark_one_rests(dim: Scene):
    stage = stage_of(dim, "pose")
    stage.rest(dim.state, np.zeros(Layout(dim.state).size))
    np.testing.assert_array_equal(stage.resting, DARK)


def test_resting_lights_are_not_traced_unless_everything_is_asked_for(dim: Scene):
    stage = stage_of(dim, "pose")
    first = known(stage.evaluate(dim.state, 1)).image.terms.diffuse
    stage.rest(dim.state, np.zeros(Layout(dim.state).size))
    found = known(stage.evaluate(dim.state, 1)).image.terms.diffuse
    np.testing.assert_array_equal(found.any(axis=0), ~np.array(DARK))
    everything = known(stage.evaluate(dim.state, 1, everything=True)).image.terms.diffuse
    np.testing.assert_array_equal(everything, first)


def test_without_a_photo_nothing_is_seen_and_nothing_rests(dim: Scene):
    stage = landmark_stage(dim, "pose", "lights")
    assert stage.evaluate(dim.state, 1) is None
    stage.rest(dim.state, np.ones(Layout(dim.state).size))
    assert len(stage.resting) == 0
    np.testing.assert_array_equal(stage.free(), stage.active)


def test_what_a_stopped_run_had_counted_is_taken_over_once(scene: Scene):
    stage = stage_of(scene, "pose")
    before = Ledger({"rays": Work(seconds=0.5, units=7.0)})
    stage.counted = before
    stage.evaluate(scene.state, 1)
    ledger = known(stage.energy.photo).plan.ledger
    assert ledger.work["rays"].units == 7.0 and vars(stage)["counted"] is None
    stage.evaluate(scene.state, 1)
    assert known(stage.energy.photo).plan.ledger is ledger


def test_a_step_says_what_it_was_taken_from(scene: Scene):
    stage = landmark_stage(scene, "pose")
    start = replace(scene.state, translation=scene.state.translation + np.array([0, 0, 0.01]))
    (first, *_) = stage.run(start, 3, float("inf"))
    system = stage.system(start, None)
    assert (first.number, first.evaluation) == (1, None)
    assert first.energy.keys() >= {"landmarks", "identity"} and first.condition > 1
    np.testing.assert_allclose(first.hessian, system.hessian)
    np.testing.assert_allclose(first.prior_hessian, system.prior_hessian)
    layout = stage.energy.layout
    step = stage.values(first.state) - stage.values(start)
    assert not step.any(), "only the pose moves, which is no value"
    wider = 0.5 * layout.mask(("identity",))
    moved = stage.moved(start, wider)
    np.testing.assert_allclose(moved.identity, start.identity + 0.5)
    np.testing.assert_allclose(stage.values(moved) - stage.values(start), wider)


def test_beside_another_photo_a_stage_leaves_the_priors_of_the_face_to_it(scene: Scene):
    stage, layout = landmark_stage(scene, "identity"), Layout(scene.state)
    other = stage.beside_another(frozenset({"identity"}))
    alone, beside = (np.diag(one.system(scene.state, None).prior_hessian) for one in (stage, other))
    where = layout.slices["identity"]
    assert alone[where].all() and not beside[where].any()
    rest = ~layout.mask(("identity",))
    np.testing.assert_array_equal(beside[rest], alone[rest])
    # All else is the same; the step of one photo is that of the run.
    assert (other.blocks, other.steps, other.name) == (stage.blocks, stage.steps, stage.name)
    (first, *_) = stage.run(scene.state, 3, float("inf"))
    assert first.parts == (first,)


def test_it_goes_on_as_long_as_the_residual_falls(scene: Scene):
    """By 5 % and more in each further step, as measured by hand."""
    stage = scene.solver(scene.render(samples=4)[0], ("lights",), 2, Weights(), samples=4)
    stage.further, stage.settled_share = 6, 0.05
    dark = replace(scene.state, lights=0.2 * scene.state.lights)
    steps = list(stage.run(dark, 3, float("inf")))
    rms = (step.evaluation.rms for step in steps if step.evaluation is not None)
    errors = [error for error in rms if error is not None]
    small = [after > 0.95 * before for before, after in pairwise(errors)]
    print([round(error, 5) for error in errors])
    assert 2 < len(steps) == len(errors) < 8, "the scene shows nothing"
    assert small[1:-1] == [False] * (len(small) - 2), "a small step ended it at once"
    assert small[-1] and steps[-1].finished

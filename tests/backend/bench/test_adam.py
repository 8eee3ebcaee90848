"""The alternative: its chain rule, its optimiser, and that it gets better."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.bench.adam import Adam, AdamRun, SceneMap, learning_rates, run_adam
from facestage.bench.settings import Rates
from facestage.bench.trace import Judge
from facestage.fit.energy.photo_term import common_energy
from facestage.fit.energy.priors import Priors
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import BLOCKS, Known
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.problem import Problem
from facestage.fit.given.truth import Truth
from facestage.fit.runs.driver import FitRun
from facestage.fit.stages.passage import Passage
from facestage.fit.stages.phases import Phase, Schedule
from facestage.render.gradient_scene import SceneValues
from reference.synthetic_scene import Scene
from reference.tiny_bench import TINY

# A run and the state that it starts from.
Start = tuple[AdamRun, State]


def moved_by_adam(layout: Layout) -> tuple[str, ...]:
    """Adam, as in the tutorials, moves no light and no lens."""
    names = layout.blocks_of(learning_rates(layout, Rates(), 1.0) > 0)
    assert {"pose", "identity", "expression", "lights"} <= set(names)
    assert {"albedo", "roughness", "specular"} <= set(names)
    return names


def test_first_steps_of_adam():
    adam = Adam(np.array([0.1, 0.2, 0.0]))
    # Bias correction makes the first step the learning rate against the gradient's sign.
    np.testing.assert_allclose(adam.step(np.array([3.0, -5.0, 1.0])), [-0.1, 0.2, 0.0])
    # m = 0.9 * 0.1 * 3 + 0.1 * 0 over 1 - 0.81, v = 0.999 * 0.001 * 9 over 1 - 0.998001.
    expected = -0.5 * 0.1 * (0.27 / 0.19) / np.sqrt(0.008991 / 0.001999)
    assert adam.step(np.array([0.0, 0.0, 0.0]), share=0.5)[0] == pytest.approx(expected)


def test_chain_rule_agrees_with_finite_differences(scene: Scene):
    state, layout = scene.state, Layout(scene.state)
    mapping = SceneMap(scene.forward, layout, len(state.specular))
    values = mapping.values(state)
    random = np.random.default_rng(1)
    cost = SceneValues(*(random.normal(size=np.shape(value)) for value in vars(values).values()))  # type: ignore[arg-type]

    def total(step: np.ndarray) -> float:
        moved = mapping.values(layout.apply(state, step))
        return sum(
            float((getattr(cost, name) * getattr(moved, name)).sum()) for name in vars(values)
        )

    found = mapping.gradient(state, values, cost)
    worst = 0.0
    for name in moved_by_adam(layout):
        direction = np.zeros(layout.size)
        direction[layout.slices[name]] = random.normal(
            size=layout.slices[name].stop - layout.slices[name].start
        )
        expected = (total(1e-3 * direction) - total(-1e-3 * direction)) / 2e-3
        worst = max(worst, abs(float(found @ direction) - expected) / (abs(expected) + 1e-3))
    print(f"chain rule off by {worst:.1e} (allowed 1e-2)")
    assert worst < 1e-2


@pytest.fixture(scope="module")
def start(opened: tuple[Problem, Truth, Judge], tmp_path_factory: pytest.TempPathFactory) -> Start:
    problem = opened[0]
    forward, schedule = (
        ForwardModel(problem.geometry, problem.lights),
        Schedule().until("light and albedo"),
    )
    run = FitRun(problem, forward, tmp_path_factory.mktemp("start"), schedule=schedule)
    fitted = run.run(float("inf"))
    passage = Passage.prepared(run.view, Phase("adam", BLOCKS, 40.0, 0), fitted.state)
    assert passage is not None
    return AdamRun(passage.descent.energy, passage.scaled, samples=16), passage.scaled


def test_gradients_are_finite_and_every_block_has_one(start: Start):
    adam, state = start
    energy, gradient = adam.loss(state, seed=0)
    assert np.isfinite(energy) and np.isfinite(gradient).all()
    for name in moved_by_adam(adam.energy.layout):
        assert np.abs(gradient[adam.energy.layout.slices[name]]).max() > 0, name


def test_the_photo_costs_what_it_costs_the_fit(start: Start):
    """Half the light: a misfit that the noise of the paths does not hide."""
    adam, state = start
    dark = replace(state, lights=0.5 * state.lights)
    evaluation = adam.photo.evaluate(dark, 1)
    wanted, _ = common_energy(evaluation, evaluation, adam.target.weights)
    found, _ = adam.scene.gradient(adam.map.values(dark), adam.target, 256, 1)
    print(f"photo: {found:.1f}, the fit's {wanted:.1f}, allowed 3 % apart")
    assert found == pytest.approx(wanted, rel=0.03)


def mean_loss(adam: AdamRun, state: State) -> float:
    return float(np.mean([adam.loss(state, seed=1000 + number)[0] for number in range(4)]))


def test_adam_lowers_the_energy(start: Start):
    adam, state = start
    # The start's lights already explain the photo to what a few paths per pixel can tell: begin in
    # the dark.
    state = replace(state, lights=0.5 * state.lights)
    layout = adam.energy.layout
    descent = Adam(learning_rates(layout, Rates(), adam.energy.term(Priors).known.light_scale))
    before = mean_loss(adam, state)
    for number in range(40):
        state = layout.apply(state, descent.step(adam.loss(state, seed=2 * number)[1]))
    after = mean_loss(adam, state)
    print(f"energy {before:.2f} -> {after:.2f} in 40 steps")
    assert after < 0.9 * before


def test_a_run_leaves_snapshots_in_time_order(opened: tuple[Problem, Truth, Judge]):
    problem, truth, judge = opened
    track = run_adam(problem, truth, TINY[1], detail=False)
    seconds = [item.seconds for item in track.snapshots]
    assert seconds == sorted(seconds)
    assert {item.stage for item in track.snapshots} >= {"pose", "landmarks"}
    rows = judge.rows("tiny", "adam", "Adam", track)
    assert rows[0].psnr is None and rows[-1].psnr is not None and np.isfinite(rows[-1].psnr)
    last = track.snapshots[-1].state
    bounds = Layout(last).bounds(Known(problem.lights, last.camera.focal_px))
    values = Layout(last).values(last)
    assert (values >= bounds[0]).all() and (values <= bounds[1]).all()

"""How high teeth stand, from pictures of teeth that stand as high as is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from facestage.fit.face.state import State
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.problem import read_problem
from facestage.fit.runs.driver import FitRun
from facestage.fit.runs.joint_run import JointRun
from facestage.fit.stages.phases import Schedule
from facestage.fit.stages.teeth_height import MODE, teeth_height, with_height, with_teeth_seen
from facestage.fit.stages.view import View
from facestage.models.registry import load_model
from facestage.stress.scene import Scene, plain_scene, render, turn, write_job

SMILE = {
    "mouthSmileLeft": 0.6,
    "mouthSmileRight": 0.6,
    "mouthUpperUpLeft": 0.6,
    "mouthUpperUpRight": 0.6,
    "mouthLowerDownLeft": 0.7,
    "mouthLowerDownRight": 0.7,
}
# An upper lip that hides the gums: heights above where the crowns reach under it are alike.
SMALL_SMILE = SMILE | {"mouthUpperUpLeft": 0.45, "mouthUpperUpRight": 0.45}
AJAR = {"jawOpen": 0.5, "mouthUpperUpLeft": 0.2, "mouthUpperUpRight": 0.2}


def person(expression: dict[str, float], height: float, yaw: float = 0.0) -> Scene:
    """One with teeth of this ``height``, seen closely."""
    scene = plain_scene(load_model("default"), seed=5, side_px=192)
    names, identity = scene.model.expression_names, 0.5 * scene.identity
    identity[scene.model.identity_names.index(MODE)] = height
    weights = np.array([expression.get(name, 0.0) for name in names])
    return replace(scene, identity=identity, expression=weights, rotation=turn(yaw=yaw))


def fitted(folder: Path, scene: Scene, freeze: tuple[str, ...] = ()) -> tuple[View, State]:
    """Of a job's problem, and the truth but for its teeth."""
    given = write_job(folder, scene, render(scene))
    problem = read_problem(replace(given, freeze=freeze))
    view = View(problem, ForwardModel(problem.geometry, problem.lights))
    return view, with_height(scene.state, view.forward, 0.0)


def weight(state: State) -> float:
    return float(state.identity[load_model("default").identity_names.index(MODE)])


@pytest.mark.parametrize(
    ("expression", "height", "least", "most"),
    [
        (AJAR, -1.0, -1.5, -0.5),
        (AJAR, 2.0, 1.5, 2.5),
        # Above closed teeth there are gums, or none: once none is to be seen all heights are alike.
        (SMILE, 2.0, 0.5, 2.5),
    ],
)
def test_teeth_stand_as_high_as_a_photo_shows_them(
    renderer: str,
    tmp_path: Path,
    expression: dict[str, float],
    height: float,
    least: float,
    most: float,
):
    view, state = fitted(tmp_path, person(expression, height))
    (found,) = with_teeth_seen([(view, state)])
    print(f"{height}: {weight(found)}, {least} to {most}")
    assert least <= weight(found) <= most
    np.testing.assert_array_equal(np.delete(found.identity, -1), np.delete(state.identity, -1))
    assert view.problem.geometry.model.identity_names[-1] == MODE


def test_all_photos_of_a_person_have_a_say(renderer: str, tmp_path: Path):
    """A smile bounds the height from below; parted teeth say what it is."""
    folders = tmp_path / "smile", tmp_path / "ajar"
    for folder in folders:
        folder.mkdir()
    smile = fitted(folders[0], person(SMALL_SMILE, 2.0, yaw=20))
    ajar = fitted(folders[1], person(AJAR, 2.0, yaw=-10))
    alone, both = teeth_height([smile]), with_teeth_seen([smile, ajar])
    assert alone is not None and 0 < alone < 1.5
    assert weight(both[0]) == weight(both[1]) >= 1.5
    np.testing.assert_array_equal(both[1].expression, ajar[1].expression)


def test_nothing_is_said_of_teeth_that_are_not_seen_or_held(renderer: str, tmp_path: Path):
    scene = person(AJAR, 2.0)
    held, free = fitted(tmp_path, scene, freeze=("identity",)), fitted(tmp_path, scene)
    assert teeth_height([free]) is not None
    assert teeth_height([held]) is None and teeth_height([free, held]) is None
    assert with_teeth_seen([held]) == [held[1]]
    assert teeth_height([fitted(tmp_path, person({}, 2.0))]) is None, "the lips meet"
    model = scene.model
    without = replace(
        model, identity_names=model.identity_names[:-1], identity_basis=model.identity_basis[:-1]
    )
    other = replace(scene, model=without, identity=scene.identity[:-1])
    problem = read_problem(write_job(tmp_path, other, render(other)))
    view = View(problem, ForwardModel(problem.geometry, problem.lights))
    assert teeth_height([(view, other.state)]) is None


def test_a_fit_ends_with_teeth_as_high_as_its_photos_show(renderer: str, tmp_path: Path):
    """By landmarks alone, on which teeth do not depend; alone and as one of two."""
    schedule = Schedule()
    schedule = schedule.until(schedule.photo_phases[0].name)
    scene = person(AJAR, 2.0)
    problem = read_problem(write_job(tmp_path, scene, render(scene)))
    forward = ForwardModel(problem.geometry, problem.lights)
    one = FitRun(problem, forward, tmp_path, schedule=schedule).run(np.inf)
    assert weight(one.state) >= 1.0
    twice = JointRun(2 * [problem], 2 * [forward], tmp_path, 2 * [None], schedule=schedule)
    both = twice.run(np.inf).photos
    assert weight(both[0].state) == weight(both[1].state) >= 1.0

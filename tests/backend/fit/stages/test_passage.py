"""The way through a phase: what is prepared, where it is entered, who hears of it, when it ends.

States are numbers here, at the photo's full size ten times what a phase sees.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from facestage.fit.energy.plan import Ledger
from facestage.fit.solve.bounded_step import Damping
from facestage.fit.stages.passage import Passage, Within, walk
from facestage.fit.stages.phases import PHASES, Phase, PhaseName, Schedule

FOREVER = float("inf")
JOB_SEED = 40


@dataclass(frozen=True)
class Item:
    number: int
    state: Any
    damping: Damping = field(default_factory=Damping)

    @property
    def parts(self) -> tuple[Item, ...]:
        return (self,)


class FakeDescent:
    """Two steps of one each."""

    def __init__(self) -> None:
        self.damping, self.resting = Damping(), np.zeros(3, bool)
        self.ran: list[tuple[float, int, float, int]] = []
        self.resumed: tuple[Any, ...] = ()

    def run(self, state: float, seed: int, deadline: float, first: int) -> Iterator[Item]:
        self.ran.append((state, seed, deadline, first))
        for number in range(first, 3):
            state += 1
            yield Item(number, state)

    def resume(self, *what: Any) -> None:
        self.resumed = what


class FakeView:
    """Everything in the phases of ``held`` names is held."""

    def __init__(self, held: tuple[str, ...] = ()) -> None:
        self.held = held
        self.done: list[str] = []
        self.problem = SimpleNamespace(job=SimpleNamespace(seed=JOB_SEED))

    def choose_lamps(self, state: float) -> None:
        self.done.append("lamps")

    def look_again(self, phase: Phase, state: float) -> None:
        self.done.append("dark")

    def descent(self, phase: Phase, state: float) -> Any:
        self.done.append(phase.name)
        return None if phase.name in self.held else FakeDescent()

    def with_initial_lights(
        self, phase: Phase, state: float, skin: np.ndarray | None = None
    ) -> float:
        self.done.append("lights")
        return state + 0.5

    def without_next_to_nothing(self, state: float) -> float:
        return state

    def without_unseen_bounces(self, phase: Phase, state: float) -> float:
        return state

    def with_scattering(self, phase: Phase, state: float) -> float:
        return state

    def scaled(self, phase: Phase, state: float) -> float:
        return state / 10

    def full_size(self, phase: Phase, scaled: float, reference: float) -> float:
        return scaled * 10


def prepared(name: str, view: FakeView | None = None, **options: Any) -> Any:
    view = FakeView() if view is None else view
    return Passage.prepared(view, Schedule()[name], 0.0, **options)  # type: ignore[arg-type]


def walked(view: FakeView, phases: Any = PHASES, *rest: Any, **options: Any) -> Any:
    return walk(view, phases, 0.0, *rest, **options)  # type: ignore[arg-type]


def test_light_is_found_before_the_photo_is_looked_at():
    view = FakeView()
    assert prepared(PhaseName.POSE, view).state == 0.0 and view.done == ["pose"]
    view = FakeView()
    assert prepared(PhaseName.LIGHT, view).state == 0.5
    assert view.done == ["lamps", "dark", "lights", "light and albedo"]
    view = FakeView()
    assert prepared(PhaseName.LIGHT, view, keep_light=True).state == 0.0
    assert view.done == ["light and albedo"]


def test_a_phase_of_which_all_is_held_has_no_passage():
    assert prepared(PhaseName.LIGHT, FakeView(("light and albedo",))) is None


def test_steps_lead_where_the_photo_is():
    passage = prepared(PhaseName.LANDMARKS)
    seen = [(item.number, item.state, passage.state) for item in passage.steps(7.0)]
    assert seen == [(1, 1.0, 10.0), (2, 2.0, 20.0)]
    assert passage.descent.ran == [(0.0, JOB_SEED + passage.phase.seed, 7.0, 1)]


def test_it_is_entered_where_it_was_left():
    whole = prepared(PhaseName.LIGHT)
    first = next(iter(whole.steps(FOREVER)))
    within = whole.within(replace(first, damping=Damping(0.25, 2.0)))
    assert (within.step, within.state, within.damping) == (1, first.state, (0.25, 2.0))
    assert within.resting is whole.descent.resting
    list(whole.steps(FOREVER))

    again, ledger = prepared(PhaseName.LIGHT), Ledger()
    again.enter(Within(1, within.state, within.damping, within.resting), ledger)
    assert again.state == 10 * first.state
    damping, resting, counted = again.descent.resumed
    assert damping == Damping(0.25, 2.0) and resting is within.resting
    assert counted == ledger and counted is not ledger, "what is counted on is not the checkpoint's"
    assert [item.number for item in again.steps(FOREVER)] == [2]
    assert again.descent.ran[0][0] == first.state


def test_a_walk_goes_through_every_phase():
    view, heard = FakeView(), []

    def told(passage: Passage, item: Any) -> None:
        heard.append((passage.phase.name, item.number))

    end = walked(view, PHASES, FOREVER, told)
    assert heard == [(phase.name, number) for phase in PHASES for number in (1, 2)]
    # Two steps of ten a phase, and half of one where light is found.
    assert end == pytest.approx(20 * len(PHASES) + 0.5 * len(Schedule().photo_phases))
    assert view.done.count("lamps") == view.done.count("lights") == len(Schedule().photo_phases)


def test_a_walk_leaves_out_what_is_held():
    assert walked(FakeView(tuple(phase.name for phase in PHASES[1:]))) == 20.0


def test_a_walk_ends_before_the_photo_when_time_is_up():
    view = FakeView()
    assert walked(view, PHASES, -1.0) == 40.0
    assert view.done == ["pose", "landmarks"]


def test_a_walk_keeps_the_light_it_was_given():
    view = FakeView()
    walked(view, keep_light=True)
    assert not {"lamps", "lights"} & set(view.done)

"""When the descent takes a step, when it stops, and when it asks the lights: on energies of one
number.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from facestage.fit.solve.bounded_step import Damping
from facestage.fit.solve.descent import CONVERGED_SHARE, Descent, wakes

FOREVER = float("inf")


@dataclass
class Model:
    hessian: np.ndarray
    gradient: np.ndarray
    total: float
    decreases: Callable[[float], float]

    def decrease(self, state: float, evaluation: float) -> float:
        return self.decreases(state)


@dataclass(frozen=True)
class Told:
    number: int
    state: float
    finished: bool


class Toy(Descent[float, float, Model, Told]):
    """``energy`` of one number, of which the quadratic model believes curvature 1 and the given
    slope.
    """

    def __init__(
        self, energy: Callable[[float], float], slope: Callable[[float], float], steps: int = 9
    ) -> None:
        super().__init__(steps, np.full(1, -np.inf), np.full(1, np.inf), 1e-3, Damping())
        self.energy, self.slope = energy, slope
        self.evaluated: list[tuple[float, bool]] = []
        self.asked: list[float] = []

    def evaluate(self, state: float, seed: int, everything: bool) -> float:
        self.evaluated.append((state, everything))
        return self.energy(state)

    def system(self, state: float, evaluation: float) -> Model:
        here = self.energy(state)
        return Model(
            np.eye(1), np.array([self.slope(state)]), here, lambda there: here - self.energy(there)
        )

    def rest(self, state: float, gradient: np.ndarray) -> None:
        self.asked.append(state)

    def free(self) -> np.ndarray:
        return np.ones(1, bool)

    def values(self, state: float) -> np.ndarray:
        return np.array([state])

    def moved(self, state: float, step: np.ndarray) -> float:
        return state + float(step[0])

    def accepted(
        self,
        number: int,
        state: float,
        evaluation: float,
        system: Model,
        condition: float,
        finished: bool,
    ) -> Told:
        assert evaluation == self.energy(state) and condition == 1.0
        return Told(number, state, finished)


def bowl(state: float) -> float:
    return 0.5 * state**2 + 1.0


def shallow(slope: float) -> Toy:
    """A slope that the model takes for ``slope``, and that goes on."""
    return Toy(lambda state: 1e3 - slope * state, lambda state: -slope)


def uphill(slope: float) -> Toy:
    """A slope that is not there: the energy rises on both sides."""
    return Toy(lambda state: 1.0 + abs(state), lambda state: -slope)


def test_a_bowl_is_left_at_its_bottom_by_itself():
    found = list(Toy(bowl, lambda state: state).run(4.0, 0, FOREVER))
    assert [told.number for told in found] == list(range(1, len(found) + 1))
    assert [told.finished for told in found] == [False] * (len(found) - 1) + [True]
    # The first step is damped by a thousandth; the next lowers the energy by less than a thousandth
    # of it.
    assert found[0].state == pytest.approx(4 - 4 / 1.001) and len(found) == 2


def test_a_share_of_a_thousandth_ends_the_run():
    # Decreases of 2.2 and of 0.4 of a thousand.
    assert next(told.finished for told in shallow(1.5).run(0.0, 0, FOREVER)) is False
    assert [told.finished for told in shallow(0.6).run(0.0, 0, FOREVER)] == [True]


def test_the_last_step_is_the_last():
    toy = shallow(3.0)
    toy.steps = 3
    found = list(toy.run(0.0, 0, FOREVER))
    assert [(told.number, told.finished) for told in found] == [(1, False), (2, False), (3, True)]
    assert [told.number for told in toy.run(0.0, 0, FOREVER, first=3)] == [3]


def test_a_step_uphill_is_tried_four_times_with_more_damping():
    toy = uphill(1.0)
    assert list(toy.run(0.0, 0, FOREVER)) == []
    tried = [state for state, _ in toy.evaluated[1:]]
    assert len(tried) == 4
    dampings = (1e-3, 8e-3, 128e-3, 4.096)
    np.testing.assert_allclose(tried, [1 / (1 + damping) for damping in dampings])


def test_what_promises_too_little_is_not_tried_again():
    """After a refusal: less than half a hundredth of the energy is what visibility jumps by."""
    for slope, tries in ((0.09, 1), (0.12, 4)):
        toy = uphill(slope)
        assert list(toy.run(0.0, 0, FOREVER)) == []
        assert len(toy.evaluated) == 1 + tries, slope


def test_a_refused_step_is_taken_when_it_is_short_enough():
    # The model believes a curvature of 1; it is 40.
    toy = Toy(lambda state: 20 * state**2, lambda state: 40 * state)
    toy.damping = Damping(value=3.0)
    found = list(toy.run(1.0, 0, FOREVER))
    assert found and abs(found[0].state) < 1.0
    assert len(toy.evaluated) > 1 + len(found), "one was refused at least"


def test_a_curvature_that_is_far_too_low_is_survived():
    # The model believes a curvature of 1; it is 8: three tries overshoot.
    toy = Toy(lambda state: 4 * state**2, lambda state: 8 * state)
    (told, *_) = toy.run(1.0, 0, FOREVER)
    assert abs(told.state) < 1.0 and len(toy.evaluated) >= 5


def test_lights_are_asked_at_the_first_step_and_every_fourth():
    assert [number for number in range(1, 14) if wakes(number)] == [1, 5, 9, 13]
    toy = shallow(3.0)
    found = list(toy.run(0.0, 0, FOREVER))
    assert len(found) == 9
    states = [0.0] + [told.state for told in found]
    assert toy.asked == [states[0], states[4], states[8]]
    # What a step starts from is evaluated before it, and with every light where the step asks.
    assert [everything for _, everything in toy.evaluated] == [
        wakes(number) for number in range(1, 11)
    ]


def test_past_the_deadline_the_step_that_was_taken_is_the_last():
    toy = shallow(3.0)
    assert len(list(toy.run(0.0, 0, time.monotonic() - 1.0))) == 1
    refused = uphill(1.0)
    assert list(refused.run(0.0, 0, time.monotonic() - 1.0)) == [] and len(refused.evaluated) == 2


def test_numbers_begin_with_one_and_the_usual_end_is_a_thousandth():
    assert [told.number for told in shallow(3.0).run(0.0, 0, FOREVER)][:2] == [1, 2]
    assert CONVERGED_SHARE == 1e-3


def test_what_lowers_nothing_is_no_step():
    flat = Toy(lambda state: 1.0, lambda state: -1.0)
    assert list(flat.run(0.0, 0, FOREVER)) == [] and len(flat.evaluated) == 5


def test_the_damping_follows_what_a_step_gained_of_what_it_promised():
    toy = shallow(3.0)
    toy.steps = 1
    list(toy.run(0.0, 0, FOREVER))
    # The model promises half of the slope's work: the gain is 2, and the damping falls to a third.
    assert toy.damping.value == pytest.approx(1e-3 / 3)
    steep = Toy(lambda state: 0.5 * 1.7 * state**2 + 1, lambda state: 1.7 * state)
    steep.steps = 1
    (told,) = steep.run(1.0, 0, FOREVER)
    step = told.state - 1.0
    gain = (0.85 - 0.85 * told.state**2) / -(1.7 * step + 0.5 * step**2)
    assert steep.damping.value == pytest.approx(1e-3 * max(1 / 3, 1 - (2 * gain - 1) ** 3))
    assert 0.2 < gain < 0.5


@pytest.mark.parametrize(("total", "tries"), [(1.0, 4), (100.0, 1)])
def test_what_is_too_little_is_a_share_of_the_energy(total: float, tries: int):
    toy = Toy(lambda state: total + abs(state), lambda state: -0.5)
    assert list(toy.run(0.0, 0, FOREVER)) == [] and len(toy.evaluated) == 1 + tries


def test_the_last_step_is_where_all_lead():
    steps = list(shallow(3.0).run(0.0, 0, FOREVER))
    assert shallow(3.0).last(0.0, 0) == steps[-1]
    assert uphill(1.0).last(0.0, 0) is None
    assert shallow(3.0).last(0.0, 0, time.monotonic() - 1.0) == steps[0]

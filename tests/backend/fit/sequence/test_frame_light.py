"""Light of single frames: eliminated as in one large system, and followed from frame to frame."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from facestage.fit.sequence.frame_light import MOVED_SIGMA, OWN_SIGMA, WALK_SIGMA, LightEquations

FRAMES, LIGHTS, UNKNOWNS, MEAN = 6, 4, 5, 0.7


def pictures(light: np.ndarray, strength: float = 30.0) -> tuple[LightEquations, np.ndarray]:
    """Of frames whose residuals are r - A l - B x, their light away from where it is by ``light``
    (frames, lights); and the Hessians by x alone.
    """
    random = np.random.default_rng(3)
    by_light = strength * random.uniform(size=(len(light), 40, LIGHTS))
    by_pose = strength * random.normal(size=(len(light), 40, UNKNOWNS))
    residual = np.einsum("frl,fl->fr", by_light, light) + random.normal(size=(len(light), 40))
    said = LightEquations(
        np.einsum("fri,frj->fij", by_light, by_light),
        -np.einsum("fri,fr->fi", by_light, residual),
        np.einsum("fri,frj->fij", by_light, by_pose),
        0.5 * (residual**2).sum(axis=1),
    )
    return said, np.einsum("fri,frj->fij", by_pose, by_pose)


def test_eliminated_light_is_light_that_was_solved_for():
    said, hessian = pictures(np.full((FRAMES, LIGHTS), 0.1))
    gradient = np.random.default_rng(4).normal(size=(FRAMES, UNKNOWNS)) * 50
    alone = said.eliminated(hessian, gradient, MEAN)
    for index in range(FRAMES):
        kept = 1.0 - said.explained(MEAN)[index]
        own = said.hessian[index] + kept * np.eye(LIGHTS) / (OWN_SIGMA * MEAN) ** 2
        cross = said.cross[index]
        whole = np.block([[own, cross], [cross.T, hessian[index]]])
        right = -np.concatenate([said.gradient[index], gradient[index]])
        wanted = np.linalg.solve(whole, right)[LIGHTS:]
        found = np.linalg.solve(alone[0][index], -alone[1][index])
        np.testing.assert_allclose(found, wanted, rtol=1e-8)


def test_a_frame_without_a_picture_and_light_that_is_held_say_nothing_of_it():
    hessian, gradient = np.ones((2, 3, 3)), np.ones((2, 3))
    for lights in (0, LIGHTS):
        found = LightEquations.none(2, lights, 3).eliminated(hessian, gradient, MEAN)
        np.testing.assert_array_equal(found[0], hessian)
        np.testing.assert_array_equal(found[1], gradient)


@pytest.mark.parametrize("moved", [0.0, 0.4])
def test_lights_are_the_least_of_the_whole_film(moved: float):
    light = 0.5 + moved * np.linspace(-1, 1, FRAMES)[:, None] * np.ones(LIGHTS)
    light[FRAMES // 2 :] += 1.0  # at the cut
    said, _ = pictures(light, 0.6)
    common = np.full(LIGHTS, 0.2)
    present = np.tile([0.1, 0.2, 0.3, 0.0], (FRAMES, 1))
    step = 0.02 * np.random.default_rng(5).normal(size=(FRAMES, UNKNOWNS))
    shots = np.array([1, 1, 1, 2, 2, 2])
    found = said.followed(present, common, step, shots, MEAN)
    sharper = (1.0 / (1.0 - said.explained(MEAN)))[:, None]

    def energy(values: np.ndarray) -> float:
        lights = values.reshape(FRAMES, LIGHTS)
        change = lights - present
        total = np.einsum("fl,fl->", sharper * said.gradient, change)
        total += np.einsum("fl,flx,fx->", sharper * change, said.cross, step)
        total += 0.5 * np.einsum("fi,fij,fj->", sharper * change, said.hessian, change)
        total += 0.5 * (((lights - common) / (MOVED_SIGMA * MEAN)) ** 2).sum()
        walked = np.diff(lights, axis=0)[np.diff(shots) == 0]
        return float(total + 0.5 * ((walked / (WALK_SIGMA * MEAN)) ** 2).sum())

    bounds = [(0.0, None)] * (FRAMES * LIGHTS)
    best = minimize(energy, present.ravel(), bounds=bounds, options={"maxfun": 200000})
    assert energy(found.ravel()) <= best.fun + 1e-5 * abs(best.fun)
    assert (found >= 0).all()


def test_what_light_explains_tells_light_that_moves_from_light_that_does_not():
    shares = [
        pictures(np.full((FRAMES, LIGHTS), size))[0].explained(MEAN).mean() for size in (0.0, 0.3)
    ]
    assert shares[0] < 0.2 and shares[1] > 0.95

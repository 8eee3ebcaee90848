"""Pins: residuals, Jacobian, and a fit that keeps them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.pins import Pins
from facestage.fit.energy.pin_term import PinTerm, surface_points
from facestage.fit.face.layout import Layout
from facestage.fit.given.problem import read_problem
from facestage.fit.result.run import fit_job
from reference.small_fit import QUICK, SMALL
from reference.synthetic_case import Case
from reference.synthetic_scene import Scene

DEVIATION = 0.05


def pins_of(scene: Scene, moved: float = 0.0) -> Pins:
    """Five points of the face; the first is ``moved`` pixels down from where it shows."""
    triangles = scene.model.triangles
    skin = np.flatnonzero(scene.geometry.new_index[triangles].min(axis=1) >= 0)
    corners = triangles[skin[(np.linspace(0.2, 0.8, 5) * len(skin)).astype(int)]]
    weights = np.tile([0.5, 0.3, 0.2], (5, 1))
    blank = Pins(corners, weights, np.zeros((5, 2)), np.full(5, DEVIATION))
    points = surface_points(scene.geometry, blank).project(scene.state)
    points[0] += [0.0, moved]
    return replace(blank, points=points)


def term_of(scene: Scene, moved: float = 0.0) -> PinTerm:
    pins = pins_of(scene, moved)
    return PinTerm(surface_points(scene.geometry, pins), pins)


@pytest.mark.parametrize("block", ["pose", "focal", "identity", "expression"])
def test_jacobian_equals_finite_differences(scene: Scene, block: str):
    term, layout = term_of(scene, 3.0), Layout(scene.state)
    jacobian, step = term.jacobian(scene.state, layout), 1e-5
    for column in range(layout.slices[block].start, layout.slices[block].stop):
        increment = np.zeros(layout.size)
        increment[column] = step
        plus, minus = (
            term.residuals(layout.apply(scene.state, sign * increment)) for sign in (1, -1)
        )
        wanted = (plus - minus) / (2 * step)
        assert np.abs(jacobian[:, column] - wanted).max() < 1e-5 * np.abs(wanted).max()


def test_residuals_are_standard_deviations_and_weigh_the_same_however_far(scene: Scene):
    term = term_of(scene, 3.0)
    residuals = term.residuals(scene.state)
    assert residuals[1] == pytest.approx(-3.0 / DEVIATION)
    assert np.abs(np.delete(residuals, 1)).max() < 1e-6
    assert (term.robust_weights(residuals) == 1).all()
    assert term.robust_energy(residuals) == pytest.approx(0.5 * (3.0 / DEVIATION) ** 2)


def test_a_fit_keeps_its_pins(scene: Scene, case: Case, tmp_path: Path):
    """Also one that neither landmarks nor photo would have put there."""
    pins = pins_of(scene, 2.0)
    away = {}
    for name, given in (("free", None), ("pinned", pins)):
        result = fit_job(replace(case.job(), pins=given), tmp_path / name, fineness=QUICK)
        points = np.einsum("pi,pix->px", pins.weights, result.vertices[pins.corners].astype(float))
        away[name] = np.linalg.norm(result.camera.project(points) - pins.points, axis=1)
    print(away)
    assert away["free"][0] > 1.0
    assert away["pinned"].max() < 0.25
    assert "pins" in result.energy


def test_pins_are_of_the_window_and_of_what_is_rendered(scene: Scene, case: Case):
    pins = pins_of(scene)
    job = replace(case.job(), pins=pins)
    half = read_problem(job, fineness=SMALL).pins_at(0.5)
    assert half is not None
    np.testing.assert_allclose(half.points, 0.5 * pins.points)
    np.testing.assert_allclose(half.deviation, 0.5 * pins.deviation)
    beyond = replace(pins, corners=pins.corners + len(scene.model.vertices))
    with pytest.raises(InputError, match="Pin 0 is on vertex"):
        read_problem(replace(job, pins=beyond), fineness=SMALL)


def test_a_job_with_other_pins_is_another_job(scene: Scene, case: Case):
    prints = {
        read_problem(replace(case.job(), pins=pins), fineness=SMALL).fingerprint
        for pins in (None, pins_of(scene), pins_of(scene, 1.0))
    }
    assert len(prints) == 3

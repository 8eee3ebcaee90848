"""Units, exposures and models that a fit must refuse, or say the truth about."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.job import Job
from facestage.contract.landmarks import Landmarks
from facestage.fit.geometry import FaceGeometry
from facestage.fit.landmark_term import LandmarkTerm
from facestage.fit.metrics import psnr, white_level
from facestage.fit.priors import Priors
from facestage.fit.problem import read_problem
from reference.synthetic_case import Case
from reference.synthetic_face import synthetic_face
from reference.synthetic_scene import Scene


@pytest.mark.parametrize("unit", [1e-6, 1e6])
def test_psnr_does_not_depend_on_the_unit_of_radiance(unit: float) -> None:
    random = np.random.default_rng(1)
    truth, mask = random.uniform(0, 1, (20, 20, 3)), np.ones((20, 20), bool)
    found = truth + 0.05
    white = white_level(unit * truth, mask)
    bright = float(np.percentile(truth, 99))
    assert white == pytest.approx(unit * bright)
    assert psnr(unit * found, unit * truth, mask, white) == pytest.approx(psnr(found, truth, mask, bright))
    assert psnr(0 * truth, unit * truth, mask, white) < 10, "darkness explains nothing"


@pytest.mark.parametrize("bright", [0.0, 0.05, 1.0, 3.0])
def test_white_is_1_for_a_photo_exposed_for_a_display(bright: float) -> None:
    assert white_level(np.full((4, 4, 3), bright), np.ones((4, 4), bool)) == 1.0
    assert white_level(np.full((4, 4, 3), 1e6), np.zeros((4, 4), bool)) == 1.0


def test_a_model_without_modes_has_an_empty_basis() -> None:
    model = synthetic_face()
    model = replace(
        model, identity_names=(), identity_basis=model.identity_basis[:0], expression_names=(),
        expression_basis=model.expression_basis[:0],
    )  # fmt: skip
    geometry = FaceGeometry(model)
    assert geometry.basis.shape == (3 * len(model.vertices), 0)
    np.testing.assert_allclose(geometry.vertices(np.zeros(0), np.zeros(0)), model.vertices)
    points = np.zeros((68, 2))
    term = LandmarkTerm(geometry, Landmarks("ibug68", points, np.ones(68, bool)), 1.0)
    assert term.basis.shape == (68, 3, 0)


def test_priors_of_empty_blocks_warn_of_nothing(scene: Scene) -> None:
    from facestage.contract.job import Weights
    from facestage.fit.parameters import Layout

    state = replace(scene.state, identity=np.zeros(0), expression=np.zeros(0), albedo=np.zeros(0))
    layout = Layout(state)
    quadratic = Priors(layout, state, True, Weights()).quadratic(state, scene.lights)
    assert np.isfinite(quadratic.hessian).all()
    assert quadratic.energy["identity"] == quadratic.energy["albedo"] == 0.0


def test_a_model_in_millimetres_is_refused(case: Case, tmp_path: Path) -> None:
    model = synthetic_face()
    replace(model, vertices=1e3 * model.vertices).save(tmp_path / "large.npz")
    job = Job(image=case.photo, landmarks=Landmarks.read(case.landmarks), model=f"npz:{tmp_path / 'large.npz'}")
    with pytest.raises(InputError, match="metres large, expected about"):
        read_problem(job)


def test_landmarks_on_a_line_are_refused() -> None:
    along = np.linspace(20, 80, 68)
    line = Landmarks("ibug68", np.stack([along, 10 + 0.7 * along], axis=1), np.ones(68, bool))
    with pytest.raises(InputError, match="lie on one line"):
        line.check_inside(100, 100)
    narrow = np.stack([50 + 4 * np.cos(along), along], axis=1)
    replace(line, points=narrow).check_inside(100, 100)

"""Units, exposures and models that a fit must refuse, or say the truth about."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.camera import Camera
from facestage.contract.errors import InputError
from facestage.contract.face_model import OTHER, TEETH, FaceModel
from facestage.contract.job import Job, Weights
from facestage.contract.landmarks import Landmarks
from facestage.contract.light_stage import fibonacci_stage
from facestage.fit.energy.energy import Energy
from facestage.fit.energy.landmark_term import LandmarkTerm
from facestage.fit.energy.priors import Priors
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.layout import Layout
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.metrics import psnr, white_level
from facestage.fit.given.problem import read_problem
from facestage.fit.runs.driver import FitRun
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
    assert psnr(unit * found, unit * truth, mask, white) == pytest.approx(
        psnr(found, truth, mask, bright)
    )
    assert psnr(0 * truth, unit * truth, mask, white) < 10, "darkness explains nothing"


@pytest.mark.parametrize("bright", [0.0, 0.05, 1.0, 3.0])
def test_white_is_1_for_a_photo_exposed_for_a_display(bright: float) -> None:
    assert white_level(np.full((4, 4, 3), bright), np.ones((4, 4), bool)) == 1.0
    assert white_level(np.full((4, 4, 3), 1e6), np.zeros((4, 4), bool)) == 1.0


def test_a_model_without_modes_has_an_empty_basis(scene: Scene) -> None:
    model = synthetic_face()
    model = replace(
        model,
        identity_names=(),
        identity_basis=model.identity_basis[:0],
        expression_names=(),
        expression_basis=model.expression_basis[:0],
    )
    geometry = FaceGeometry(model)
    assert geometry.basis.shape == (3 * len(model.vertices), 0)
    np.testing.assert_allclose(geometry.vertices(np.zeros(0), np.zeros(0)), model.vertices)
    points = np.zeros((68, 2))
    term = LandmarkTerm(geometry, Landmarks("ibug68", points, np.ones(68, bool)), 1.0)
    state = replace(scene.state, identity=np.zeros(0), expression=np.zeros(0), relief=np.zeros(0))
    assert term.at(state).jacobian(state, Layout(state)).shape == (2 * 68, Layout(state).size)


def test_priors_of_empty_blocks_warn_of_nothing(scene: Scene) -> None:
    state = replace(scene.state, identity=np.zeros(0), expression=np.zeros(0), albedo=np.zeros(0))
    layout = Layout(state)
    priors = Priors(layout, scene.known(expression_box=True), Weights())
    system = Energy(layout, (priors,)).at(state).system(state)
    assert np.isfinite(system.hessian).all()
    assert system.energies["identity"] == system.energies["albedo"] == 0.0


def test_a_model_in_millimetres_is_refused(case: Case, tmp_path: Path) -> None:
    model = synthetic_face()
    assert "metres large, expected about 0.3" in _refused(
        case, tmp_path, replace(model, vertices=1e3 * model.vertices)
    )


def _refused(case: Case, folder: Path, model: FaceModel) -> str:
    model.save(folder / "model.npz")
    job = Job(
        image=case.photo,
        landmarks=Landmarks.read(case.landmarks),
        model=f"npz:{folder / 'model.npz'}",
    )
    with pytest.raises(InputError) as caught:
        read_problem(job)
    return str(caught.value)


def test_models_that_cannot_be_fitted_are_refused_in_a_sentence(case: Case, tmp_path: Path) -> None:
    model = synthetic_face()
    no_skin = replace(model, polygon_part=np.full_like(model.polygon_part, TEETH))
    assert "no skin polygon" in _refused(case, tmp_path, no_skin)
    polygons = model.polygons.copy()
    polygons[polygons[:, 3] >= 0] = polygons[polygons[:, 3] >= 0][:, ::-1]
    assert "face inward" in _refused(case, tmp_path, replace(model, polygons=polygons))
    assert "texture coordinates" in _refused(case, tmp_path, replace(model, uvs=0 * model.uvs))
    shell = model.polygon_part.copy()
    shell[(model.polygons == model.landmarks["ibug68"][20, 0]).any(axis=1)] = OTHER
    message = _refused(case, tmp_path, replace(model, polygon_part=shell))
    assert "landmark 20 of 'ibug68' on a vertex that is not rendered" in message


@pytest.mark.parametrize(
    ("side", "anchored", "factor"),
    [(0.2, False, 1), (0.2, True, 1), (1.2, False, 3), (9.0, True, 8)],
)
def test_wide_lights_get_more_samples(
    case: Case, renderer: str, tmp_path: Path, side: float, anchored: bool, factor: int
) -> None:
    matrix = np.eye(4)
    matrix[2, 3] = 0.6
    job = Job(
        image=case.photo,
        landmarks=Landmarks.read(case.landmarks),
        model=case.model_option,
        camera=Camera.read(case.camera),
        stage=fibonacci_stage(6, side=side),
        camera_to_stage=matrix if anchored else None,
    )
    problem = read_problem(job)
    run = FitRun(problem, ForwardModel(problem.geometry, problem.lights), tmp_path)
    assert run.view.samples_factor == factor


def test_landmarks_on_a_line_are_refused() -> None:
    along = np.linspace(20, 80, 68)
    line = Landmarks("ibug68", np.stack([along, 10 + 0.7 * along], axis=1), np.ones(68, bool))
    with pytest.raises(InputError, match="lie on one line"):
        line.check_inside(100, 100)
    narrow = np.stack([50 + 4 * np.cos(along), along], axis=1)
    replace(line, points=narrow).check_inside(100, 100)

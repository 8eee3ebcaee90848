"""Standard deviations against hand-computed ones, and what counts as unobserved."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.camera import Camera
from facestage.contract.face_model import FaceModel
from facestage.contract.job import Job
from facestage.contract.landmarks import Landmarks
from facestage.contract.light_stage import fibonacci_stage
from facestage.contract.result import Result
from facestage.fit.face.layout import Layout
from facestage.fit.result.run import fit_job
from facestage.fit.solve.covariance import Posterior
from facestage.fit.trust.certainty import NAMED_MAX, describe, deviations
from reference.small_fit import SMALL
from reference.synthetic_case import Case
from reference.synthetic_scene import Scene


def test_independent_parameters_have_the_inverse_root_of_their_information() -> None:
    found = deviations(
        Posterior(
            np.diag([4.0, 25.0, 1.0]), np.diag([1.0, 1.0, 1.0]), np.array([True, True, False])
        )
    )
    np.testing.assert_allclose(found.after[:2], [0.5, 0.2], rtol=1e-6)
    np.testing.assert_allclose(found.before[:2], 1.0, rtol=1e-6)
    assert np.isnan(found.after[2]) and not found.unobserved.any()


def test_a_null_direction_of_the_data_leaves_twins_at_their_prior() -> None:
    data = 1e4 * np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    prior = np.eye(3)
    found = deviations(Posterior(data + prior, prior, np.ones(3, bool)))
    # The twins' sum is known, their difference is not: half of its prior variance stays with each.
    np.testing.assert_allclose(found.after[:2], np.sqrt(0.5), rtol=1e-3)
    assert found.unobserved.tolist() == [False, False, True]


def test_without_a_prior_nothing_is_compared() -> None:
    found = deviations(Posterior(np.diag([4.0, 0.0]), np.zeros((2, 2)), np.ones(2, bool)))
    assert found.after[0] == pytest.approx(0.5) and np.isinf(found.after[1])
    assert np.isinf(found.before).all() and not found.unobserved.any()


def test_singular_systems_give_large_numbers_not_errors() -> None:
    found = deviations(Posterior(np.ones((40, 40)), np.eye(40), np.ones(40, bool)))
    assert np.isfinite(found.after).all() and (found.after > 1e3).all()


def test_unobserved_entries_are_named_by_block(scene: Scene) -> None:
    layout = Layout(scene.state)
    hessian = np.diag(np.full(layout.size, 100.0))
    start = layout.slices["identity"].start
    hessian[start + 1, start + 1] = 1.0
    light = layout.slices["lights"].start
    hessian[light, light] = 1.0
    texels = layout.slices["specular"]
    hessian[texels, texels] = np.eye(texels.stop - texels.start)
    active = np.ones(layout.size, bool)
    active[layout.slices["pose"]] = False
    certainty = describe(
        deviations(Posterior(hessian, np.eye(layout.size), active)),
        layout,
        {"identity": ["wide", "long"]},
    )
    assert certainty.unobserved["identity"] == ["long"]
    assert certainty.unobserved["lights"] == ["0"]
    count = texels.stop - texels.start
    assert certainty.unobserved["specular"] == (
        [f"{count} of {count}"] if count > NAMED_MAX else [str(i) for i in range(count)]
    )
    assert (certainty.deviations["pose"] == 0).all(), "frozen"
    np.testing.assert_allclose(certainty.deviations["identity"], [0.1, 1.0, 0.1, 0.1], rtol=1e-5)


@pytest.mark.usefixtures("renderer")
def test_a_fit_names_the_mode_that_moves_nothing(case: Case, tmp_path: Path) -> None:
    model = FaceModel.load(case.model)
    basis = model.expression_basis.copy()
    basis[1] = 0.0
    replace(model, expression_basis=basis).save(tmp_path / "model.npz")
    job = Job(
        image=case.photo,
        landmarks=Landmarks.read(case.landmarks),
        camera=Camera.read(case.camera),
        model=f"npz:{tmp_path / 'model.npz'}",
        stage=fibonacci_stage(6),
        freeze=("identity",),
        device="cpu",
    )
    fit_job(job, tmp_path / "result", fineness=SMALL)
    result = Result.load(tmp_path / "result")
    assert result.unobserved["expression"] == [model.expression_names[1]]
    assert "identity" not in result.unobserved and "pose" not in result.unobserved
    assert (result.arrays["deviation/identity"] == 0).all(), "frozen"
    deviation = result.arrays["deviation/expression"]
    assert deviation.argmax() == 1 and (deviation > 0).all()

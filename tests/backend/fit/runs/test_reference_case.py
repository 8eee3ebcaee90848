"""A photo rendered by Cycles, with textured skin that the model does not match exactly, against its
truth.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from facestage.contract.camera import Camera
from facestage.contract.face_model import FaceModel
from facestage.contract.job import Job
from facestage.contract.landmarks import Landmarks
from facestage.contract.result import Result
from facestage.fit.result.run import fit_job
from facestage.images.image_io import read_exr
from reference.made_once import made_once


@pytest.fixture(scope="module")
def result(
    shared_data: Path, ict_facekit: FaceModel, tmp_path_factory: pytest.TempPathFactory
) -> Result:
    """The case ``soft``, fitted within a minute as a user would."""
    case = shared_data / "cases" / "soft"
    if not case.is_dir():
        pytest.skip(f"needs the reference case, which is not at {case}")

    def fit(folder: Path) -> None:
        ict_facekit.save(folder / "ict.npz")
        job = Job(
            case / "photo.png",
            f"npz:{folder / 'ict.npz'}",
            Landmarks.read(case / "landmarks.json"),
            Camera.read(case / "camera.json"),
            budget_seconds=60.0,
            truth=case / "truth.npz",
        )
        fit_job(job, folder / "out")

    return Result.load(made_once(tmp_path_factory, "soft", fit) / "out")


@pytest.mark.slow
def test_geometry_is_better_than_its_landmark_stage(result: Result):
    start, end = result.errors["landmark_stage_similarity_mm"], result.errors["similarity_mm"]
    print(
        f"soft: landmarks {start:.2f} mm, fit {end:.2f} mm (allowed 1.9), rigid "
        f"{result.errors['rigid_mm']:.2f} mm"
    )
    assert end <= start
    assert end <= 1.9


@pytest.mark.slow
def test_the_render_explains_the_skin(result: Result):
    errors = [result.errors[name] for name in ("psnr", "light", "albedo")]
    print(f"soft: {errors[0]:.1f} dB, light {errors[1]:.3f}, albedo {errors[2]:.3f}")
    assert result.errors["psnr"] >= 28.0
    assert np.isfinite([result.errors["light"], result.errors["albedo"]]).all()


@pytest.mark.slow
def test_the_result_is_a_plausible_face(result: Result):
    assert (result.expression >= 0).all() and (result.expression <= 1).all()
    assert np.abs(result.identity).max() < 5 and (result.stage.radiance >= 0).all()
    assert result.folder is not None
    albedo = read_exr(result.folder / "albedo.exr")
    assert albedo.min() > 0 and albedo.max() < 1

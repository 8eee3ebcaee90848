"""When the photo is not believed about the shape, and when a lens is not believed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from facestage.contract.errors import InputError
from facestage.contract.files.partial import partial_folder
from facestage.contract.job import Job, Weights
from facestage.contract.landmarks import Landmarks
from facestage.contract.result import CONVERGED, STOPPED
from facestage.fit.energy.landmark_term import LandmarkTerm
from facestage.fit.energy.photo_term import PhotoTerm
from facestage.fit.energy.priors import Priors
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import SHAPE
from facestage.fit.result.run import fit_job
from facestage.fit.stages.photo_descent import PhotoDescent
from facestage.fit.trust.guard import doubt, landmark_statistic, statistic_limit
from facestage.fit.trust.lens_check import DOUBTFUL, check_lens
from reference.small_fit import SMALL
from reference.synthetic_case import Case
from reference.synthetic_scene import Scene, moved


def landmark_stage(scene: Scene, state: State, landmarks: Landmarks) -> PhotoDescent:
    """The stage of landmarks and priors alone, for the camera of ``state``; its lens is held."""
    stage = scene.solver(np.zeros((96, 96, 3)), SHAPE, 30, Weights(), landmarks=landmarks)
    stage.energy = stage.energy.without(PhotoTerm)
    stage.freeze = Layout(state).mask({"focal"})
    return stage


def test_the_statistic_is_the_squared_distance_in_deviations(scene: Scene):
    stage = landmark_stage(scene, scene.state, scene.landmarks())
    start = replace(scene.state, identity=np.zeros(4), expression=np.zeros(3))
    assert landmark_statistic(stage.energy, start, start) == 0
    # With landmarks that do not count, two deviations in one mode and one in another are 4 + 1.
    unseen = replace(stage.energy.term(LandmarkTerm), weight=0.0)
    energy = replace(stage.energy, terms=(stage.energy.term(Priors), unseen))
    end = moved(start, identity=np.array([2.0, 0, 0, -1.0]))
    assert landmark_statistic(energy, start, end) == pytest.approx(5.0)
    assert landmark_statistic(stage.energy, start, end) != pytest.approx(5.0)


def test_a_plausible_shape_is_believed():
    assert statistic_limit(1) == pytest.approx(10.828, abs=1e-3), "chi-squared, one in a thousand"
    assert doubt(100.0, statistic_limit(150), 30.0, 0.9) == ""
    assert doubt(100.0, statistic_limit(150), None, 0.9) == ""


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((300.0, 210.0, 30.0, 0.9), "300, at most 210"),
        ((1.0, 210.0, 9.0, 0.9), "PSNR 9.0 dB"),
        ((1.0, 210.0, 30.0, 0.05), "only 5%"),
    ],
)
def test_each_doubt_says_why(arguments: tuple[float, float, float, float], words: str):
    assert words in doubt(*arguments)


@pytest.mark.parametrize(("factor", "tried"), [(0.25, 4), (1.0, 2), (6.0, 4)])
def test_a_wrong_lens_shows_in_the_landmarks(scene: Scene, factor: float, tried: int):
    # A near face has a perspective to speak of.
    near = replace(scene.state, translation=np.array([0.0, 0.0, -0.35]))
    landmarks = scene.landmarks(near, noise_px=0.2, seed=3)
    camera = replace(near.camera, focal_px=factor * near.camera.focal_px)
    start = replace(near, camera=camera, translation=near.translation * [1, 1, factor])
    for item in landmark_stage(scene, start, landmarks).run(start, 0, np.inf):
        start = item.state
    asked = []

    def descent_of(state: State) -> PhotoDescent:
        asked.append(state)
        return landmark_stage(scene, state, landmarks)

    found = check_lens(descent_of, start, 0)
    print(f"lens {factor} times too long: F = {found.statistic:.1f}, best at {found.ratio:g} times")
    assert found.doubtful == (factor != 1.0) == (found.statistic > DOUBTFUL)
    if found.doubtful:
        assert 0.4 < found.ratio * factor < 2.5
    assert len(asked) <= 1 + tried, "a way ends where it leads to nothing better"


@pytest.fixture
def job(case: Case) -> Job:
    return case.job(lights=6)


@pytest.mark.usefixtures("renderer")
def test_what_no_face_explains_keeps_the_landmarks_shape(job: Job, tmp_path: Path):
    noise = np.random.default_rng(5).integers(0, 255, (96, 96, 3), np.uint8)
    Image.fromarray(noise).save(tmp_path / "noise.png")
    result = fit_job(replace(job, image=tmp_path / "noise.png"), tmp_path / "out", fineness=SMALL)
    assert result.status == STOPPED and "landmarks' own" in result.advice
    assert result.errors["similarity_mm"] == pytest.approx(
        result.errors["landmark_stage_similarity_mm"], abs=1e-9
    )
    plain = fit_job(job, tmp_path / "plain", fineness=SMALL)
    assert plain.status == CONVERGED and plain.advice.startswith("Converged:")
    assert plain.errors["similarity_mm"] < plain.errors["landmark_stage_similarity_mm"]


@pytest.mark.usefixtures("renderer")
def test_a_refusal_leaves_nothing_behind(job: Job, tmp_path: Path):
    alpha = np.zeros((96, 96), np.uint8)
    alpha[:4, :4] = 255
    Image.fromarray(np.dstack([np.asarray(Image.open(job.image)), alpha])).save(
        tmp_path / "masked.png"
    )
    with pytest.raises(InputError, match="shows the face"):
        fit_job(replace(job, image=tmp_path / "masked.png"), tmp_path / "out", fineness=SMALL)
    assert not partial_folder(tmp_path / "out").exists() and not (tmp_path / "out").exists()

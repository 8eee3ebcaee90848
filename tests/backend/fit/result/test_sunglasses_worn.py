"""A whole fit of a face that wears sunglasses: they do not color its eyes, and it says so."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import binary_dilation

from facestage.contract.job import Job
from facestage.contract.quality import DRAFT
from facestage.contract.texture_maps import EYE_MAP
from facestage.fit.given.face_areas import opening_share
from facestage.fit.given.spectacles import Eyes, disc
from facestage.fit.result.person import fit_person
from facestage.fit.result.run import fit_job
from facestage.images.image_io import read_exr
from facestage.models.registry import load_model
from facestage.stress.scene import exposed, plain_scene, render, write_job
from reference.small_fit import QUICK

SIDE, GLASS = 192, np.array([0.0, 0.0, 0.02])


@pytest.fixture(scope="module")
def jobs(renderer: str, tmp_path_factory: pytest.TempPathFactory) -> list[Job]:
    """The built-in head behind glass that is nearly black, and blue; and without it, its irises
    blue.
    """
    scene = exposed(plain_scene(load_model("default"), seed=5, side_px=SIDE))
    bare, folder = render(scene), tmp_path_factory.mktemp("worn")
    marks = write_job(folder, scene, bare).landmarks
    assert marks is not None
    eyes = Eyes.of(marks)
    assert eyes is not None
    lids = opening_share((SIDE, SIDE), marks) > 0.5
    lids[SIDE * 3 // 5 :] = False  # the mouth
    glass = binary_dilation(lids, disc(0.6 * eyes.width))
    light = bare.mean(axis=2)
    dark = lids & (light < np.median(light[lids]))
    blue = np.where(dark[..., None], bare[..., ::-1], bare)
    worn = write_job(folder, scene, np.where(glass[..., None], bare.max() * GLASS, bare))
    shown = write_job(tmp_path_factory.mktemp("bare"), scene, blue)
    # What is told of eyes comes after the steps.
    return [replace(each, model=worn.model, quality=DRAFT) for each in (worn, shown)]


def iris(folder: Path) -> np.ndarray:
    """Linear RGB of what is dark in the picture of the eyes, not the pupil."""
    picture = read_exr(folder / EYE_MAP.file)
    lightness = picture.mean(axis=2)
    return np.asarray(picture[(lightness > 0.03) & (lightness < 0.15)].mean(axis=0))


def test_eyes_stay_the_models_and_the_advice_says_so(jobs: list[Job], tmp_path: Path):
    result = fit_job(jobs[0], tmp_path, fineness=QUICK)
    assert "because sunglasses hide them" in result.advice
    assert read_exr(tmp_path / EYE_MAP.file).mean() > 0.3  # 0.1 where the glass colors them


def test_eyes_are_another_photo_s_and_the_advice_says_nothing_else(jobs: list[Job], tmp_path: Path):
    person = fit_person(jobs, tmp_path, fineness=QUICK)
    assert not any("sunglasses" in photo.advice for photo in person.photos)
    found = iris(tmp_path / person.photos[0].folder)
    print("iris by both photos", found.round(3))
    assert found[2] > 1.4 * found[0]

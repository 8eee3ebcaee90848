"""Photographs without hue, and photographs that only nearly have none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from facestage.contract.files.color import REC709
from facestage.contract.landmarks import Landmarks
from facestage.fit.given.black_and_white import SKIN_HUE, as_seen_in_color, is_black_and_white
from facestage.fit.given.face_areas import opening_share
from facestage.fit.given.problem import read_problem
from facestage.fit.sequence.frames import Cut
from facestage.images.image_io import Photograph
from facestage.models.anatomy.landmark_schemes import scheme_of
from reference.synthetic_case import Case
from reference.synthetic_scene import Scene

SIZE = 120
RED = np.array([0.3, 0.0, 0.0])


def photo(color: np.ndarray) -> Photograph:
    return Photograph(
        color.astype(np.float32), np.ones(color.shape[:2], bool), np.zeros(color.shape, bool)
    )


def grey(seed: int = 0) -> np.ndarray:
    """(h, w, 3) random grey."""
    light = np.random.default_rng(seed).uniform(0.0, 0.9, (SIZE, SIZE, 1))
    return np.repeat(light, 3, axis=2)


def open_mouth() -> Landmarks:
    """Lips apart in the middle, all other points in a corner."""
    points = np.full((478, 2), 5.0)
    ring = scheme_of("mediapipe478").openings[0]
    angle = 2 * np.pi * np.arange(len(ring)) / len(ring)
    points[ring] = SIZE / 2 + 20 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return Landmarks("mediapipe478", points, np.ones(478, bool))


def test_the_hue_keeps_the_luminance():
    assert pytest.approx(1.0, abs=1e-3) == SKIN_HUE @ np.array(REC709)


@pytest.mark.parametrize(
    ("color", "expected"),
    [
        (grey(), True),
        (grey() * [1.0, 1.0, 0.85], True),  # toned paper
        (grey() * [1.35, 1.0, 0.8], False),  # sepia, and skin
        (grey() + RED, False),
        (np.zeros((SIZE, SIZE, 3)), False),
    ],
)
def test_what_has_no_hue_is_black_and_white(color: np.ndarray, expected: bool):
    assert is_black_and_white(photo(color)) is expected


def test_a_face_in_a_grey_picture_is_color():
    color = grey()
    color[40:60, 40:60] *= [1.4, 0.95, 0.7]
    assert not is_black_and_white(photo(color))


def test_skin_gets_its_hue_and_teeth_none():
    before = photo(grey())
    found = as_seen_in_color(before, open_mouth())
    assert found.tinted and not before.tinted and "black and white" in found.color_space
    inside = opening_share((SIZE, SIZE), open_mouth()) > 0.999
    skin = opening_share((SIZE, SIZE), open_mouth()) == 0
    assert inside.sum() > 500
    np.testing.assert_allclose(found.color[inside], before.color[inside], rtol=1e-5)
    np.testing.assert_allclose(found.color[skin], before.color[skin] * SKIN_HUE, rtol=1e-5)
    np.testing.assert_allclose(
        found.color @ np.array(REC709), before.color[..., 0], rtol=1e-3, atol=1e-6
    )


def test_a_photo_in_color_stays_as_it_is():
    color = photo(grey() + RED)
    assert as_seen_in_color(color, open_mouth()) is color


def test_a_job_s_photo_is_seen_in_color_unless_its_grey_is_known(case: Case, tmp_path: Path):
    path = tmp_path / "grey.png"
    Image.open(case.photo).convert("L").save(path)
    job = case.job(image=path)
    problem = read_problem(job)
    assert problem.photograph.tinted
    assert "usual hue" in problem.read_from_photo()["color"]
    known = read_problem(replace(job, white_balance=(1.0, 1.0, 1.0)))
    assert not known.photograph.tinted


def test_frames_of_a_black_and_white_film_are_seen_in_color_too(scene: Scene):
    height, width = 96, 96
    light = np.random.default_rng(1).uniform(0.1, 0.9, (height, width, 1)).repeat(3, axis=2)
    cut = Cut.of(photo(light), scene.landmarks())
    assert cut.photograph.tinted
    assert not Cut.of(photo(light + RED), scene.landmarks()).photograph.tinted

"""The picture of the eyes: its colors, its fineness, its place in the atlas."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.face_model import EYES
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.textures.atlas import Atlas, shown_at, uv_tracer
from facestage.fit.textures.eyes.eye_picture import (
    EyeColors,
    EyePlane,
    eye_box,
    eye_picture,
    eyes_painted,
)
from facestage.models.anatomy.regions import IRIS_RADIUS, PUPIL_RADIUS
from facestage.models.registry import load_model

BLUE, PALE = np.array([0.05, 0.09, 0.14]), np.array([0.7, 0.66, 0.6])


@pytest.fixture(scope="module")
def geometry(renderer: str) -> FaceGeometry:
    return FaceGeometry(load_model("default"))


@pytest.fixture(scope="module")
def colored(geometry: FaceGeometry) -> np.ndarray:
    """Log albedo of blue irises and pale whites."""
    luminance = np.exp(geometry.log_albedo).mean(axis=1)
    logs = geometry.log_albedo.copy()
    eyes = np.unique(geometry.triangles[geometry.triangle_part == EYES])
    white = eyes[luminance[eyes] > 0.3]
    iris = eyes[luminance[eyes] < 0.3]
    logs[iris], logs[white] = np.log(BLUE), np.log(PALE)
    return logs


@pytest.fixture(scope="module")
def picture(geometry: FaceGeometry, colored: np.ndarray) -> np.ndarray:
    found = eye_picture(geometry, colored)
    assert found is not None
    return found


@pytest.fixture(scope="module")
def radius(geometry: FaceGeometry, picture: np.ndarray) -> np.ndarray:
    """(h, w) metres from the eye's axis of what each texel shows; NaN: nothing."""
    plane = EyePlane.of(geometry)
    assert plane is not None
    left, bottom, right, top = eye_box(geometry.model)
    height, width = picture.shape[:2]
    v, u = np.mgrid[:height, :width]
    hits = shown_at(
        uv_tracer(geometry),
        left + (u + 0.5) / width * (right - left),
        top - (v + 0.5) / height * (top - bottom),
    )
    shown = hits.triangle >= 0
    shown[shown] = geometry.triangle_part[hits.triangle[shown]] == EYES
    result = np.full(height * width, np.nan)
    corners = geometry.triangles[hits.triangle[shown]]
    across = np.einsum("ti,tix->tx", hits.barycentric[shown], plane.across[corners])
    result[shown] = np.hypot(*across.T)
    return result.reshape(height, width)


def test_the_iris_has_the_color_that_was_found(picture: np.ndarray, radius: np.ndarray):
    span = IRIS_RADIUS - PUPIL_RADIUS
    iris = picture[(radius > PUPIL_RADIUS + 0.1 * span) & (radius < PUPIL_RADIUS + 0.8 * span)]
    error = np.abs(np.log(np.median(iris, axis=0) / BLUE))
    print("log error of the iris' color", error.round(3))
    assert error.max() < 0.1
    assert np.log(iris).std(axis=0).min() > 0.1  # it has a pattern
    white = picture[(radius > 0.0066) & (radius < 0.008)]
    assert np.abs(np.log(np.median(white, axis=0) / PALE)).max() < 0.1
    assert picture[radius < 0.0015].max() < 0.02
    rim = picture[(radius > 0.0052) & (radius < 0.0055)]
    assert np.median(rim) < 0.7 * np.median(iris)


def test_an_iris_is_a_hundred_texels_across(radius: np.ndarray):
    one = (radius < IRIS_RADIUS)[:, : radius.shape[1] // 2]
    assert np.ptp(np.nonzero(one)[1]) > 100
    assert np.ptp(np.nonzero(one)[0]) > 100


def test_the_limbus_is_round(picture: np.ndarray, radius: np.ndarray):
    """No stairs: where the iris ends does not depend on the angle."""
    brightness = picture.mean(axis=2)
    middle = 0.5 * (BLUE.mean() + PALE.mean())
    assert (brightness[(radius > 0.0065) & (radius < 0.009)] > middle).mean() > 0.99
    assert (brightness[radius < 0.0052] < middle).all()


def test_beyond_the_islands_texels_repeat_the_nearest(picture: np.ndarray, radius: np.ndarray):
    away = np.isnan(radius)
    assert away.any()
    # Between two islands either may be nearest.
    beside = away[1:-1, 1:-1] & ~away[1:-1, :-2] & away[1:-1, 2:] & away[:-2, 1:-1] & away[2:, 1:-1]
    row, column = np.nonzero(beside)
    row = row + 1
    difference = np.abs(picture[row, column + 1] - picture[row, column]).max(axis=1)
    assert np.median(difference) == 0
    assert difference.max() < 0.1


def test_the_albedo_shows_the_same_coarser(geometry: FaceGeometry, picture: np.ndarray):
    atlas = Atlas.build(geometry, 256)
    before = atlas.bake(np.full((len(geometry.mean), 3), 0.3))
    after = eyes_painted(before, atlas, geometry, picture)
    np.testing.assert_array_equal(after[atlas.skin], before[atlas.skin])
    eyes = np.zeros(atlas.covered.shape, bool)
    eyes[atlas.covered] = geometry.triangle_part[atlas.triangle] == EYES
    ours, theirs = after[eyes].mean(axis=0), picture.mean(axis=(0, 1))
    assert np.abs(ours / theirs - 1).max() < 0.1
    assert after[eyes].min() < 0.04  # the pupils


def test_models_without_painted_eyes_have_none(geometry: FaceGeometry):
    model = geometry.model
    blind = FaceGeometry(replace(model, regions={}))
    assert eye_picture(blind, blind.log_albedo) is None
    white = model.albedo_mean.copy()
    white[np.concatenate([model.regions["eye_left"], model.regions["eye_right"]])] = 0.6
    plain = FaceGeometry(replace(model, albedo_mean=white))
    assert eye_picture(plain, plain.log_albedo) is None


def test_colors_are_those_of_the_model(geometry: FaceGeometry):
    colors = EyeColors.of(geometry, geometry.log_albedo)
    assert (colors.iris < 0.2).all()
    assert (colors.white > 0.5).all()

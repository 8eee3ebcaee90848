"""The line of the lashes: read off painted pictures, and drawn on the built-in head."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from facestage.contract.face_model import EYES
from facestage.contract.landmarks import Landmarks
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.textures.atlas import Atlas
from facestage.fit.textures.eyes.lash_line import (
    DARKEST,
    HALF_WIDTH,
    LID_SKIN,
    RIM,
    SHADE,
    draw_lash_line,
    lash_depth,
    upper_borders,
)
from facestage.models.anatomy.landmark_schemes import scheme_of
from facestage.models.registry import load_model

SIZE = 200


def eyes(width: float = 60.0) -> Landmarks:
    """Two level eyes, open by a quarter of their ``width`` in pixels."""
    points = np.full((478, 2), 5.0)
    for eye, left in zip(scheme_of("mediapipe478").eyes, (30.0, 110.0), strict=True):
        points[list(eye.corners)] = [[left, 100.0], [left + width, 100.0]]
        for n, (upper, lower) in enumerate(eye.lids, 1):
            x = left + width * n / (len(eye.lids) + 1)
            points[upper], points[lower] = (x, 100 - width / 8), (x, 100 + width / 8)
    return Landmarks("mediapipe478", points, np.ones(478, bool))


def picture(darker: float, width: float = 60.0) -> np.ndarray:
    """Skin with a line over all of its breadth, on the upper lids' border, ``darker`` by so much of
    the logarithm.
    """
    color = np.full((SIZE, SIZE, 3), [0.5, 0.35, 0.28])
    border = round(100 - width / 8)
    color[border - max(1, round(width / 20)) : border] *= np.exp(-darker)
    return color


@pytest.mark.parametrize(("darker", "expected"), [(0.0, 0.0), (0.2, 0.0), (0.9, 0.65)])
def test_the_line_is_as_dark_as_the_photo_has_it(darker: float, expected: float):
    assert pytest.approx(expected, abs=0.05) == lash_depth(picture(darker), eyes())
    assert lash_depth(4.0 * picture(darker), eyes()) == pytest.approx(
        lash_depth(picture(darker), eyes()), abs=1e-6
    )


def test_no_line_is_darker_than_lashes_are():
    assert lash_depth(picture(5.0), eyes()) == DARKEST
    assert SHADE > 0


def test_nothing_is_said_of_eyes_that_are_small_or_hidden():
    assert lash_depth(picture(3.0, 14.0), eyes(14.0)) > 0.3
    assert lash_depth(picture(3.0, 8.0), eyes(8.0)) == 0.0
    hidden = eyes()
    assert lash_depth(picture(0.9), replace(hidden, visible=np.zeros(478, bool))) == 0.0
    assert lash_depth(np.zeros((SIZE, SIZE, 3)), eyes()) == 0.0


@pytest.fixture(scope="module")
def geometry(renderer: str) -> FaceGeometry:
    return FaceGeometry(load_model("default"))


def test_the_borders_run_from_the_inner_corners(geometry: FaceGeometry):
    borders = upper_borders(geometry.model)
    assert len(borders) == 2
    for line, share in borders:
        assert abs(line[0, 0]) < abs(line[-1, 0]) and share[0] == 0.0 and share[-1] == 1.0
        length = np.linalg.norm(np.diff(line, axis=0), axis=1).sum()
        assert 0.025 < length < 0.05
    nameless = replace(geometry.model, landmarks={})
    assert upper_borders(nameless) == []
    # Landmarks carried over from another mesh lie millimetres off.
    skin = geometry.model.triangle_part != EYES
    vertices = geometry.model.vertices.copy()
    vertices[np.unique(geometry.model.triangles[~skin])] += [0.0, 0.0, -0.005]
    assert upper_borders(replace(geometry.model, vertices=vertices)) == []


def test_the_line_is_drawn_where_the_lashes_grow_and_once(geometry: FaceGeometry):
    atlas = Atlas.build(geometry, 1024)
    plain = np.zeros((1024, 1024, 3), np.float32)
    drawn = plain.copy()
    draw_lash_line(drawn, atlas, geometry.model, geometry.mean, 0.8)
    place = atlas.bake(geometry.mean)
    row, column = np.nonzero(drawn.any(axis=2))
    points = np.concatenate([line for line, _ in upper_borders(geometry.model)])
    away, nearest = cKDTree(points).query(place[row, column])
    above = place[row, column][:, 1] > points[nearest, 1]
    print(f"{len(row)} texels, as dark as {drawn.min():.2f}, up to {1e3 * away.max():.1f} mm away")
    assert atlas.skin[row, column].all() and away.max() <= LID_SKIN[1] + 1e-6
    dark = drawn[row, column].mean(axis=1)
    assert dark.min() == pytest.approx(-0.8, abs=0.05) and (drawn <= 0).all()
    # Narrow on the lid; the rim below it is hidden by lashes.
    assert dark[above & (away > 1.4 * HALF_WIDTH)].min() > -0.1
    assert dark[away > 1.2 * RIM].min() > -0.2
    # Both eyes, and a photo that shows the line already is not darkened further.
    assert (column < 512).any() and (column >= 512).any()
    again = drawn.copy()
    draw_lash_line(again, atlas, geometry.model, geometry.mean, 0.8)
    assert np.abs(again - drawn).max() < 0.05
    draw_lash_line(plain, atlas, geometry.model, geometry.mean, 0.0)
    assert not plain.any()

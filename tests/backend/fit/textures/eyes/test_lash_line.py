"""The line of the lashes, drawn on the built-in head."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from facestage.contract.face_model import EYES
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.textures.atlas import Atlas
from facestage.fit.textures.eyes.lash_line import (
    HALF_WIDTH,
    LID_SKIN,
    RIM,
    draw_lash_line,
    upper_borders,
)
from facestage.models.registry import load_model


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

"""Matches of two photos of a textured face whose true shape and poses are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.fit.face.state import State
from facestage.fit.stereo.matches import compare
from facestage.fit.stereo.overlap import overlap
from reference.speckled_face import pair, photo, sight, speckles, turned, wrong
from reference.synthetic_scene import Scene

REACH = 8


def errors(scene: Scene, first: State, second: State, pixels: np.ndarray, targets: np.ndarray):
    """(m,) pixels between ``targets`` and where the second photo truly shows what ``pixels`` of the
    first do.
    """
    surface = scene.forward.surface(first, pixels)
    assert len(surface.pixels) == len(pixels)
    there = scene.forward.pose(second)[1][surface.corners]
    true = second.camera.project(np.einsum("pi,pix->px", surface.weights, there))
    return np.linalg.norm(targets - true, axis=1)


@pytest.mark.parametrize("guess", [lambda state: state, wrong], ids=["truth", "wrong"])
@pytest.mark.parametrize("side", [200, 260], ids=["same size", "larger"])
def test_matches_are_where_the_skin_is(scene: Scene, guess, side: int):
    first, second = turned(scene, 15), turned(scene, -15, side)
    photos = pair(scene, first, second)
    # One shape, two poses; what is wrong with the shape is wrong in both.
    begun = guess(first), replace(guess(second), rotation=second.rotation)
    sights = [sight(scene, *one) for one in zip(photos, begun, strict=True)]
    compared = compare(sights[0], sights[1], REACH)
    found = compared.matches
    assert compared.likeness > 0.6 and found is not None
    off = errors(scene, first, second, found.pixels, found.targets)
    print(f"{len(off)} matches, {np.median(off):.2f} px median, {(off > 1).mean():.1%} beyond 1 px")
    assert np.median(off) < 0.2 * side / 200 and (off > 1.0).mean() < 0.05


def test_another_person_has_other_freckles(scene: Scene):
    first, second = turned(scene, 15), turned(scene, -15)
    one, _ = pair(scene, first, second)
    other = photo(scene, second, speckles(2), (-0.8, 0.3, 0.5))
    found = compare(sight(scene, one, first), sight(scene, other, second), REACH)
    assert found.matches is None
    assert found.textured > 200 and found.likeness < 0.1


def test_smooth_skin_is_silent(scene: Scene):
    first, second = turned(scene, 15), turned(scene, -15)
    smooth = speckles(1, contrast=0.0)
    photos = (
        photo(scene, first, smooth, (0.5, 0.5, 0.7)),
        photo(scene, second, smooth, (-0.8, 0.3, 0.5)),
    )
    sights = [sight(scene, *one) for one in zip(photos, (first, second), strict=True)]
    assert compare(sights[0], sights[1], REACH).matches is None


def test_two_profiles_show_nothing_in_common(scene: Scene):
    first, second = turned(scene, 80), turned(scene, -80)
    photos = pair(scene, first, second)
    sights = [sight(scene, *one) for one in zip(photos, (first, second), strict=True)]
    assert compare(sights[0], sights[1], REACH).matches is None


def test_what_is_hidden_is_not_compared(scene: Scene):
    first, second = turned(scene, 10), turned(scene, -10)
    photos = pair(scene, first, second)
    sights = [sight(scene, *one) for one in zip(photos, (first, second), strict=True)]
    half = sights[1].usable.copy()
    half[:100] = False
    both = overlap(sights[0], replace(sights[1], usable=half))
    assert both is not None
    assert both.common.any() and (both.shown[both.common][:, 1] > 100).all()


def test_what_the_nose_covers_is_not_compared(scene: Scene):
    first, second = turned(scene, 50), turned(scene, -20)
    photos = pair(scene, first, second)
    both = overlap(sight(scene, photos[0], first), sight(scene, photos[1], second))
    assert both is not None
    y, x = np.nonzero(both.common)
    pixels = np.stack([x, y], axis=1) + both.corner + 0.5
    surface = scene.forward.surface(first, pixels)
    points = np.einsum(
        "pi,pix->px", surface.weights, scene.forward.pose(second)[1][surface.corners]
    )
    # Traced towards the very places, without a depth map.
    hits = scene.forward.hits(second, second.camera.project(points))
    corners = scene.forward.pose(second)[1][scene.geometry.triangles[hits.triangle]]
    met = np.einsum("pi,pix->px", hits.barycentric, corners)
    assert (np.linalg.norm(met - points, axis=1) < 0.006).mean() > 0.99


def test_what_something_covers_in_the_other_photo_is_not_compared(scene: Scene):
    first, second = turned(scene, 10), turned(scene, -10)
    sights = [
        sight(scene, *one) for one in zip(pair(scene, first, second), (first, second), strict=True)
    ]
    free = overlap(*sights)
    # Something a centimetre before the left half of the second photo's face.
    vars(sights[1])["distance"] = sights[1].distance - np.where(np.arange(200) < 100, 0.01, 0.0)
    both = overlap(*sights)
    assert free is not None and both is not None
    assert (free.shown[free.common][:, 0] < 100).any()
    assert both.common.any() and (both.shown[both.common][:, 0] >= 100).all()


def test_a_piece_that_moves_alone_is_no_skin(scene: Scene):
    first, second = turned(scene, 10), turned(scene, -10)
    photos = pair(scene, first, second)
    # A crumb that shows what truly is five pixels beside it.
    crumb = np.s_[88:108, 92:112]
    photos[1][crumb] = photos[1][88:108, 97:117]
    sights = [sight(scene, *one) for one in zip(photos, (first, second), strict=True)]
    found = compare(sights[0], sights[1], REACH).matches
    assert found is not None
    assert errors(scene, first, second, found.pixels, found.targets).max() < 3.0

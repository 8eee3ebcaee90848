"""Where the photo shows an edge and where it does not: profiles made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.fit.energy.silhouette import Silhouette, SilhouetteTerm, _mesh_edges
from facestage.fit.face.surface_points import SurfacePoints
from facestage.fit.given.photo import Photo
from reference.synthetic_scene import Scene

SIDE, FACE_PX = 120, 100.0
FACE = np.array([0.5, 0.4, 0.3])


def strip(
    edge: float, back: np.ndarray = 0.1 * FACE, skin: float = 1.0, face: np.ndarray = FACE
) -> Photo:
    """The face left of x = ``edge``, to a part of a pixel."""
    coverage = np.clip(edge - np.arange(SIDE), 0, 1)
    color = coverage[:, None] * face + (1 - coverage[:, None]) * back
    picture = np.broadcast_to(color, (SIDE, SIDE, 3)).copy()
    everywhere = np.ones((SIDE, SIDE), bool)
    return Photo(picture, everywhere, np.full((SIDE, SIDE), skin), np.zeros(picture.shape, bool))


def offsets(
    scene: Scene, photo: Photo, middle: list[float], face_px: float = FACE_PX
) -> np.ndarray:
    """Of points at these x, in the picture's middle, looking right."""
    points = np.stack([np.array(middle), np.full(len(middle), SIDE / 2)], axis=1)
    normal = np.broadcast_to([1.0, 0.0], points.shape)
    return SilhouetteTerm(scene.forward, photo, face_px)._edge_offset(points, normal)


@pytest.mark.parametrize("edge", [60.0, 60.3, 60.5, 60.9])
def test_the_edge_is_found_to_a_part_of_a_pixel(scene: Scene, edge: float):
    for middle in (59.75, 60.0, 61.0):
        assert offsets(scene, strip(edge), [middle])[0] == pytest.approx(edge - middle, abs=0.06)


def test_the_edge_is_looked_for_within_a_fortieth_of_the_face(scene: Scene):
    # 2.5 pixels of a face of 100; five of one of 200.
    found = offsets(scene, strip(60.0), [54.5, 65.5, 56.5])
    assert np.isnan(found[:2]).all() and not found[2] > 2.75
    found = offsets(scene, strip(60.0), [56.5, 63.5], 200.0)
    np.testing.assert_allclose(found, [3.5, -3.5], atol=0.06)
    # At least two pixels, however small the face.
    assert np.isfinite(offsets(scene, strip(60.0), [58.5, 61.5], 10.0)).all()


def test_face_and_background_must_differ_by_a_third_of_the_brighter(scene: Scene):
    """|face - back| over the brighter of them plus a tenth of the photo's mean; which is the
    brighter is one.
    """
    # of the face's norm, for a photo of the face's mean
    half = 0.1 * FACE.mean() / np.linalg.norm(FACE)
    for share, seen in ((0.60, True), (0.66, False)):
        photo = strip(60.0, share * FACE)
        contrast = (1 - share) / (1 + half * (1 + share) / 2)
        assert (contrast > 0.35) == seen
        assert np.isfinite(offsets(scene, photo, [60.0]))[0] == seen
        assert np.isfinite(offsets(scene, strip(60.0, FACE, face=share * FACE), [60.0]))[0] == seen


def test_the_contrast_of_a_dark_face_is_doubtful(scene: Scene):
    """A tenth of the photo's mean is added to what the difference is compared with."""
    for bright, seen in ((0.0, True), (8.0, True), (20.0, False)):
        photo = strip(60.0, 0.5 * FACE)
        photo.color[:20] = bright if bright else 0.5 * FACE
        assert np.isfinite(offsets(scene, photo, [60.0]))[0] == seen


def test_only_the_face_s_own_color_has_an_outline(scene: Scene):
    assert np.isfinite(offsets(scene, strip(60.0, skin=0.65), [60.0])).all()
    assert np.isnan(offsets(scene, strip(60.0, skin=0.55), [60.0])).all()


def test_a_ramp_is_no_edge_and_masked_pixels_tell_nothing(scene: Scene):
    ramp = strip(60.0)
    share = np.clip((66 - np.arange(SIDE)) / 12, 0, 1)[:, None]
    ramp.color[:] = share * FACE + (1 - share) * 0.1 * FACE
    assert np.isnan(offsets(scene, ramp, [60.0])).all()
    masked = strip(60.0)
    masked.usable[:, 64] = False
    assert np.isnan(offsets(scene, masked, [60.0])).all()
    masked.usable[:, 64], masked.usable[:, 70] = True, False
    assert np.isfinite(offsets(scene, masked, [60.0])).all()


def test_a_point_counts_for_its_stretch_of_outline_and_less_when_far(scene: Scene):
    points = SurfacePoints(scene.geometry, np.zeros((1, 3), int), np.ones((1, 3)) / 3)
    outline = Silhouette(points, np.zeros((1, 2)), np.zeros((1, 2)), 0.6, 0.25)
    np.testing.assert_allclose(
        outline.robust_weights(np.array([0.0, 3.0, -3.0, 9.0])), [0.25, 0.125, 0.125, 0.025]
    )
    wanted = 4.5 * 0.25 * np.log([2, 2, 10]).sum()
    assert outline.robust_energy(np.array([0.0, 3.0, -3.0, 9.0])) == pytest.approx(wanted)


def test_edges_are_those_that_two_triangles_share():
    """A strip of three triangles has two; of those, the ones with a fitted side count."""
    triangles = np.array([[0, 1, 2], [2, 1, 3], [2, 3, 4]])
    edges, sides = _mesh_edges(triangles, np.array([True, True, True]))
    assert {
        (*edge, *sorted(side)) for edge, side in zip(edges.tolist(), sides.tolist(), strict=True)
    } == {(1, 2, 0, 1), (2, 3, 1, 2)}
    edges, _ = _mesh_edges(triangles, np.array([True, False, False]))
    assert edges.tolist() == [[1, 2]]
    assert not len(_mesh_edges(triangles, np.zeros(3, bool))[0])

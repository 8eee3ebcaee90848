"""What a point of the outline counts for, and which edges of the photo are believed."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.fit.energy.silhouette import Silhouette, SilhouetteTerm
from facestage.fit.face.surface_points import SurfacePoints
from reference.synthetic_scene import Scene, plain_photo


def test_a_point_counts_for_its_stretch_of_outline_and_less_when_far(scene: Scene):
    points = SurfacePoints(scene.geometry, np.zeros((1, 3), int), np.ones((1, 3)) / 3)
    outline = Silhouette(points, np.zeros((1, 2)), np.zeros((1, 2)), np.array([0.6]), 0.25)
    np.testing.assert_allclose(
        outline.robust_weights(np.array([0.0, 3.0, -3.0, 9.0])), [0.25, 0.125, 0.125, 0.025]
    )
    wanted = 4.5 * 0.25 * np.log([2, 2, 10]).sum()
    assert outline.robust_energy(np.array([0.0, 3.0, -3.0, 9.0])) == pytest.approx(wanted)


def test_an_edge_is_believed_where_those_around_it_agree(scene: Scene):
    """Within 1.5 % of the face of the median of those within 8 %."""
    term = SilhouetteTerm(scene.forward, plain_photo(np.zeros((4, 4, 3))), 100.0)
    places = np.stack([np.zeros(9), 2.0 * np.arange(9)], axis=1)
    offset = np.array([0.0, 0.2, 0.1, 6.0, 0.3, 1.7, 1.5, 0.2, 0.1])
    assert term._agreed(places, offset).tolist() == [True] * 3 + [False] + [True] * 5
    apart = np.array([[0.0, 0.0], [0.0, 50.0], [0.0, 100.0]])
    assert term._agreed(apart, np.array([0.0, 5.0, -5.0])).all(), "nobody is near"

"""What the camera sees first."""

from __future__ import annotations

import numpy as np

from addon.synthetic.people import landmarks_of
from facestage.contract.camera import Camera
from facestage.contract.face_model import FaceModel


def test_sightlines_see_what_lies_before_the_head(head: FaceModel) -> None:
    from facestage_blender.synthetic.sightlines import BACKGROUND, WORN, Sightlines

    camera = Camera.default(64, 64, 150.0)
    vertices = head.vertices + np.array([0, 0, -0.78])
    card = np.array(
        [[-0.02, -0.02, -0.5], [0.02, -0.02, -0.5], [0.02, 0.02, -0.5], [-0.02, 0.02, -0.5]]
    )
    free, hidden = (
        Sightlines(head, vertices),
        Sightlines(head, vertices, [(card, np.array([[0, 1, 2], [0, 2, 3]]))]),
    )
    left, right = camera.project(card)[:2, 0]
    labels = hidden.picture(camera)
    assert (labels == WORN).sum() == round(right - left) ** 2
    np.testing.assert_array_equal(labels[labels != WORN], free.picture(camera)[labels != WORN])
    assert labels[0, 0] == BACKGROUND
    points = landmarks_of(head, vertices)
    assert free.visible(points).all()
    behind = (np.abs(camera.project(points) - 32) < (right - left) / 2).all(axis=1)
    assert behind.any()
    np.testing.assert_array_equal(hidden.visible(points), ~behind)

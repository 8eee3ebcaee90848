"""Following a face: where it was, found anew when it is lost, and a cut noticed."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest

from facestage.images.image_io import Photograph
from facestage.landmarks.face_mesh import Mesh
from facestage.landmarks.finder import Face, FaceFinder, Search
from facestage.landmarks.tracker import FaceTracker, Sight

PICTURE = cast(Photograph, None)


def face_at(x: float, size: float = 100.0) -> Face:
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (478, 3)) * size
    points[33, :2], points[263, :2] = [-0.3 * size, 0.0], [0.3 * size, 0.0]
    return Face(Mesh(points + np.array([x, 200.0, 0.0]), 1.0), np.ones(478, bool), 0.9)


class Script:
    """A finder that sees what it is told, and counts how often it searched."""

    def __init__(self) -> None:
        self.near: Face | None = None  # where the frame before had it
        self.anywhere: list[Face] = []
        self.searches = 0

    def follow(self, photograph: Any, points: np.ndarray) -> Face | None:
        return self.near

    def find(self, photograph: Any) -> Search:
        self.searches += 1
        return Search(self.anywhere, np.zeros((0, 3)))


@pytest.fixture
def script() -> Script:
    return Script()


def tracker_of(script: Script, number: int | None = None) -> FaceTracker:
    return FaceTracker(cast(FaceFinder, script), number)


def test_a_face_is_searched_for_once_and_then_followed(script: Script):
    tracker = tracker_of(script)
    script.anywhere = [face_at(300), face_at(100)]
    assert tracker.look(PICTURE).sight == Sight.FOUND
    for x in (305.0, 310.0):
        script.near = face_at(x)
        sighting = tracker.look(PICTURE)
        assert sighting.sight == Sight.TRACKED and sighting.face is script.near
    assert script.searches == 1


def test_the_asked_face_is_the_one_that_is_followed(script: Script):
    script.anywhere = [face_at(300), face_at(100)]
    assert tracker_of(script, 2).look(PICTURE).face is script.anywhere[1]


@pytest.mark.parametrize("other", [face_at(400), face_at(300, 180)], ids=["place", "size"])
def test_a_face_that_jumps_is_on_the_other_side_of_a_cut(script: Script, other: Face):
    tracker = tracker_of(script)
    script.anywhere = [face_at(300)]
    tracker.look(PICTURE)
    script.near, script.anywhere = other, [other]
    assert tracker.look(PICTURE).sight == Sight.CUT


def test_a_lost_face_is_searched_for_where_it_was_and_is_no_cut(script: Script):
    tracker = tracker_of(script)
    script.anywhere = [face_at(300)]
    tracker.look(PICTURE)
    script.anywhere = []
    assert [tracker.look(PICTURE).sight for _ in range(2)] == [Sight.LOST] * 2
    near, far = face_at(320), face_at(700, 150)
    script.anywhere = [far, near]
    sighting = tracker.look(PICTURE)
    assert sighting.sight == Sight.FOUND and sighting.face is near


def test_it_goes_on_where_an_earlier_run_was(script: Script):
    tracker = tracker_of(script)
    tracker.resume(face_at(300).mesh.points[:, :2], 0)
    script.near = face_at(303)
    assert tracker.look(PICTURE).sight == Sight.TRACKED and script.searches == 0

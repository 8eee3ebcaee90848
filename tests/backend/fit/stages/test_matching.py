"""Which photos are compared with each other, at which size, and when."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import binary_erosion
from scipy.spatial.transform import Rotation

from facestage.fit.face.state import State
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.stages.matching import (
    ANGLE_MAX,
    CLOSEST,
    LOOKS,
    PARTNERS_MAX,
    compared_photos,
    partners,
    stereo_between,
)
from facestage.fit.stages.phases import Phase, PhaseName, Schedule
from facestage.images.image_io import resize
from reference.speckled_face import pair, turned
from reference.synthetic_scene import Scene


def heads(*degrees: float) -> list[np.ndarray]:
    return [Rotation.from_euler("y", angle, degrees=True).as_matrix() for angle in degrees]


def test_few_photos_are_all_compared():
    assert partners(heads(15, -25, 5)) == [(0, 1), (0, 2), (1, 2)]
    assert len(partners(heads(0, 20, -20, 40))) == 6


def test_profiles_of_two_sides_are_not():
    assert partners(heads(-60, 60)) == []
    assert partners(heads(-60, 0, 60)) == [(0, 1), (1, 2)]


def test_of_many_each_has_those_that_tell_most():
    angles = np.linspace(-35, 35, 8)
    found = partners(heads(*angles))
    count = np.bincount(np.ravel(found), minlength=8)
    assert count.min() >= PARTNERS_MAX and len(found) < 8 * 7 / 2
    # Two photos from one side differ by too little.
    assert (0, 1) not in found and (0, 3) in found
    assert all(abs(angles[a] - angles[b]) <= ANGLE_MAX for a, b in found)


@dataclass(frozen=True)
class FakeView:
    """What matching asks a view for; the phase looks at the photo at ``share`` of its size."""

    forward: ForwardModel
    color: np.ndarray
    face_size_px: float
    share: float
    weight: float = 1.0

    @property
    def problem(self) -> Any:
        inside = binary_erosion(self.color[..., 0] > 0, iterations=4)
        return SimpleNamespace(
            job=SimpleNamespace(weights=SimpleNamespace(photo=self.weight)),
            face_size_px=self.face_size_px,
            scale=lambda face_px: min(1.0, face_px / self.face_size_px),
            paintable=inside.astype(np.float32),
        )

    @property
    def visible(self) -> Any:
        def at(factor: float) -> Any:
            side = round(len(self.color) * factor)
            color = resize(self.color, side, side).astype(np.float64)
            return SimpleNamespace(
                color=color, usable=np.ones((side, side), bool), skin=np.zeros((side, side))
            )

        return SimpleNamespace(
            at=at, hidden_at=lambda height, width: np.zeros((height, width), bool)
        )

    def factor(self, phase: Phase) -> float:
        return self.share


SIDES = (200, 300)
Photos = list[tuple[ForwardModel, State, np.ndarray]]


@pytest.fixture(scope="module")
def photos(scene: Scene) -> Photos:
    """Two, of different size, with the truth."""
    states = turned(scene, 15, SIDES[0]), turned(scene, -15, SIDES[1])
    colors = pair(scene, *states)
    return [(scene.forward, *one) for one in zip(states, colors, strict=True)]


def passages(photos: Photos, name: str, share: float = 1.0, weight: float = 1.0) -> list[Any]:
    """At the beginning of a phase."""
    return [
        SimpleNamespace(
            view=FakeView(forward, color, 0.5 * len(color), share, weight),
            state=state,
            phase=Schedule()[name],
        )
        for forward, state, color in photos
    ]


def test_the_term_is_that_of_the_photos_at_the_size_of_the_phase(photos: Photos):
    share = 0.5
    term = stereo_between(passages(photos, PhaseName.JOINT, share), CLOSEST)
    assert term is not None
    np.testing.assert_allclose(term.floors, share * CLOSEST.floor * 0.5 * np.array(SIDES))
    states = tuple(replace(state, camera=state.camera.scaled(share)) for _, state, _ in photos)
    (weighed,) = term.weighed(states).pairs
    # In deviations, at the truth.
    assert np.median(np.linalg.norm(weighed.residuals, axis=1)) < 1.5
    assert weighed.placed.targets.max() < share * SIDES[1]


def test_it_is_silent_where_the_shape_does_not_move(photos: Photos):
    assert stereo_between(passages(photos, PhaseName.LIGHT), CLOSEST) is None
    assert stereo_between(passages(photos, PhaseName.JOINT, weight=0.0), CLOSEST) is None


def test_photos_are_compared_at_the_size_of_the_smaller_face(photos: Photos):
    begun = passages(photos, PhaseName.LANDMARKS)
    views, states = [one.view for one in begun], [one.state for one in begun]
    compared = compared_photos(views, states, LOOKS[0])
    found = compared[0, 1]
    assert found.likeness > 0.6 and found.matches is not None
    # Pixels of both photos with the smaller face's size.
    assert found.matches.pixels.max() < 200 and found.matches.targets.max() < 200

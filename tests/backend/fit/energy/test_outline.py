"""The face's outline: which edges of the mesh it runs along, and where it is seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.fit.energy.outline import Outline, OutlineFinder, mesh_edges
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.face.state import State
from facestage.fit.forward.shading import ForwardModel
from facestage.models.registry import load_model
from facestage.render.variant import start_renderer
from facestage.stress.scene import plain_scene
from reference.synthetic_scene import moved


@pytest.fixture(scope="module")
def forward() -> ForwardModel:
    start_renderer("cpu")
    scene = plain_scene(load_model("default"), side_px=64)
    lights = LightParameters(np.zeros(len(scene.stage), bool), scene.stage.radiance, uniform=False)
    return ForwardModel(FaceGeometry(scene.model), lights)


def outline_of(forward: ForwardModel, side_px: int, yaw: float) -> tuple[State, Outline]:
    state = plain_scene(load_model("default"), side_px=side_px).state
    turned = moved(replace(state, rotation=np.eye(3)), pose=[0, yaw, 0, 0, 0, 0])
    return turned, OutlineFinder(forward).at(turned)


@pytest.mark.parametrize("side_px", [64, 160, 400])
@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_cheeks_are_seen_at_every_size(forward: ForwardModel, side_px: int, yaw: float):
    """Both from the front, the far one of a head that is turned: a cheek before the neck is as
    good as one before nothing, and on a small picture the skin a pixel inside of it lies far before
    it.
    """
    state, outline = outline_of(forward, side_px, yaw)
    middle = state.camera.project(state.translation[None])[0]
    left = outline.middle[:, 0] < middle[0]
    print(f"{side_px} px: {left.sum()} places left, {(~left).sum()} right")
    least = min(0.12 * side_px, 20)
    if yaw:
        assert max(left.sum(), (~left).sum()) > least
    else:
        assert min(left.sum(), (~left).sum()) > least


def test_edges_are_those_that_two_triangles_share():
    """A strip of three triangles has two; of those, the ones with a fitted side count."""
    triangles = np.array([[0, 1, 2], [2, 1, 3], [2, 3, 4]])
    edges, sides = mesh_edges(triangles, np.array([True, True, True]))
    assert {
        (*edge, *sorted(side)) for edge, side in zip(edges.tolist(), sides.tolist(), strict=True)
    } == {(1, 2, 0, 1), (2, 3, 1, 2)}
    edges, _ = mesh_edges(triangles, np.array([True, False, False]))
    assert edges.tolist() == [[1, 2]]
    assert not len(mesh_edges(triangles, np.zeros(3, bool))[0])

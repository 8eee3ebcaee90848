"""The silhouette term: the outline's place in the photo to a part of a pixel, its derivative, and
when it is silent.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from facestage.fit.energy.edge_search import EdgeSearch
from facestage.fit.energy.pair_distances import points_on
from facestage.fit.energy.silhouette import Silhouette, SilhouetteTerm
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.layout import Layout
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.face.state import State
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.photo import Photo
from facestage.models.anatomy.landmark_schemes import scheme_of
from facestage.models.registry import load_model
from facestage.render.variant import start_renderer
from facestage.stress.scene import plain_scene
from reference.synthetic_scene import moved, plain_photo

FACE_PX = 100.0
# Radiance of the face and of what is behind it: a flat face, so that only the outline is tested.
FACE, BACK = np.array([0.5, 0.4, 0.3]), np.array([0.05, 0.08, 0.1])


@dataclass(frozen=True)
class Scene:
    """A head that closes behind its outline, as the small synthetic face does not."""

    forward: ForwardModel
    state: State


@pytest.fixture(scope="module")
def scene() -> Scene:
    start_renderer("cpu")
    truth = plain_scene(load_model("default"), side_px=160)
    count = len(truth.stage)
    lights = LightParameters(np.zeros(count, bool), truth.stage.radiance, uniform=False)
    # Turned, so that a cheek is the outline.
    return Scene(
        ForwardModel(FaceGeometry(truth.model), lights),
        moved(truth.state, pose=[0, 0.7, 0, 0, 0, 0]),
    )


def flat_photo(scene: Scene, state: State, grid: int = 8) -> Photo:
    """Coverage of the face by grid x grid sub-pixels, of one color before another."""
    height, width = state.camera.height, state.camera.width
    y, x = np.mgrid[:height, :width]
    coverage = np.zeros((height, width))
    for sub in range(grid * grid):
        offset = (np.array([sub % grid, sub // grid]) + 0.5) / grid
        pixels = np.stack([x.ravel(), y.ravel()], axis=1) + offset
        coverage += (scene.forward.hits(state, pixels).triangle >= 0).reshape(
            height, width
        ) / grid**2
    return plain_photo(coverage[..., None] * FACE + (1 - coverage[..., None]) * BACK)


def find(scene: Scene, photo: Photo, state: State) -> Silhouette:
    found = SilhouetteTerm(scene.forward, photo, FACE_PX).at(state)
    assert found is not None
    return found


@pytest.fixture(scope="module")
def photo(scene: Scene) -> Photo:
    return flat_photo(scene, scene.state)


def test_the_truth_lies_on_its_own_outline(scene: Scene, photo: Photo):
    found = find(scene, photo, scene.state)
    distance = found.residuals(scene.state) * found.sigma
    print(
        f"{len(distance)} points, median |distance| {np.median(np.abs(distance)):.3f} px "
        "(allowed 0.2)"
    )
    assert len(distance) >= 10
    assert np.median(np.abs(distance)) < 0.2


def test_a_shift_is_measured_to_a_part_of_a_pixel(scene: Scene, photo: Photo):
    metres = -scene.state.translation[2] / scene.state.camera.focal_px
    aside = moved(scene.state, pose=[0, 0, 0, 1.2 * metres, 0, 0])
    found = find(scene, photo, aside)
    distance = found.residuals(aside) * found.sigma
    wanted = 1.2 * found.normals[:, 0]
    print(f"median error {np.median(np.abs(distance - wanted)):.3f} px (allowed 0.25)")
    assert np.median(np.abs(distance - wanted)) < 0.25
    assert np.abs(wanted).max() > 1


def test_jacobian_against_finite_differences(scene: Scene, photo: Photo):
    found, layout = find(scene, photo, scene.state), Layout(scene.state)
    jacobian = found.jacobian(scene.state, layout)
    for block in ("pose", "identity", "expression", "focal"):
        for column in range(layout.slices[block].start, layout.slices[block].stop):
            step = np.zeros(layout.size)
            step[column] = 1e-5
            plus, minus = (
                found.residuals(layout.apply(scene.state, sign * step)) for sign in (1, -1)
            )
            np.testing.assert_allclose(
                jacobian[:, column], (plus - minus) / 2e-5, rtol=1e-3, atol=1e-3
            )
    rest = np.setdiff1d(
        np.arange(layout.size),
        np.flatnonzero(layout.mask(("pose", "identity", "expression", "focal"))),
    )
    assert not jacobian[:, rest].any()


def test_a_face_before_its_own_color_has_no_outline(scene: Scene):
    photo = plain_photo(
        np.broadcast_to(FACE, (scene.state.camera.height, scene.state.camera.width, 3)).copy()
    )
    assert SilhouetteTerm(scene.forward, photo, FACE_PX).at(scene.state) is None


def test_masked_pixels_show_no_outline(scene: Scene, photo: Photo):
    masked = Photo(photo.color, np.zeros_like(photo.usable), photo.skin, photo.clipped)
    assert SilhouetteTerm(scene.forward, masked, FACE_PX).at(scene.state) is None


def test_a_point_far_off_counts_less_than_a_close_one(scene: Scene, photo: Photo):
    found = find(scene, photo, scene.state)
    near, far = found.robust_weights(np.array([0.1, 9.0]))
    assert far < 0.2 * near <= found.share


def test_deviation_and_share_follow_the_face_s_size(scene: Scene, photo: Photo):
    found = find(scene, photo, scene.state)
    np.testing.assert_allclose(np.linalg.norm(found.normals, axis=1), 1.0)
    assert found.sigma == pytest.approx(1.2) and found.share == pytest.approx(0.25)
    small = SilhouetteTerm(scene.forward, photo, 20.0).at(scene.state)
    assert small is not None and small.share == 1.0
    assert small.sigma == pytest.approx(1.0)


def test_normals_point_out_of_the_face(scene: Scene, photo: Photo):
    found = find(scene, photo, scene.state)
    place = found.points.project(scene.state)
    inside, outside = (
        scene.forward.hits(scene.state, place + sign * 2.0 * found.normals).triangle
        for sign in (-1, 1)
    )
    assert (inside >= 0).all() and (outside < 0).all()


def test_a_jaw_that_is_much_too_narrow_is_drawn_out_to_its_edge(scene: Scene, photo: Photo):
    """Seen from further away it is smaller by a seventh: three reaches of an edge."""
    small = moved(scene.state, pose=[0, 0, 0, 0, 0, 0.15 * scene.state.translation[2]])
    geometry = scene.forward.geometry
    mouth = points_on(geometry, "ibug68", scheme_of("ibug68").lips)
    height = mouth.project(small)[:, 1].mean()
    reach = EdgeSearch(photo, FACE_PX).reach
    for known in (mouth, None):
        found = SilhouetteTerm(scene.forward, photo, FACE_PX, mouth=known).at(small)
        assert found is not None
        off = -found.residuals(small) * found.sigma
        jaw = found.points.project(small)[:, 1] > height
        print(f"{len(off)} edges, of the jaw {jaw.sum()}, {off.max():.2f} px outward at most")
        assert (off[~jaw] < 1.05 * reach).all(), "above the mouth it may be an ear"
        assert (off[jaw].max() > 1.3 * reach) == (known is not None)
        np.testing.assert_allclose(found.sigma, np.maximum(1.2, np.abs(off) / 3))

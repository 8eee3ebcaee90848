"""How the texture lies on the skin, against what is known of planes and of flat maps."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.contract.texture_maps import NORMAL
from facestage.fit.forward.surface_frame import FrameField, Frames, turned
from facestage.fit.textures.atlas import Atlas
from reference.synthetic_scene import Scene

TEXELS = 64


@pytest.fixture(scope="module")
def frames(scene: Scene) -> Frames:
    geometry = scene.geometry
    atlas = Atlas.build(geometry, TEXELS)
    field = FrameField.of(geometry, geometry.at(scene.state))
    return field.at(atlas.triangle, atlas.weights.astype(np.float64))


def test_a_height_that_is_a_place_has_its_axis_for_slope(frames: Frames):
    """Of h = d . x over the surface, the gradient is what of d lies along it."""
    axis = np.array([0.3, -0.8, 0.5])
    slopes = frames.slopes(frames.by_u @ axis, frames.by_v @ axis)
    along = axis - frames.normals * (frames.normals @ axis)[:, None]
    error = np.linalg.norm(slopes - along, axis=1)
    print(f"slopes are off by {np.quantile(error, 0.99):.2e} at most (99 %)")
    assert np.quantile(error, 0.99) < 1e-6


def test_a_vertex_s_frame_is_that_of_its_triangles(scene: Scene, frames: Frames):
    geometry = scene.geometry
    vertices = geometry.at(scene.state)
    atlas = Atlas.build(geometry, TEXELS)
    corners = geometry.model.uvs[geometry.triangle_uvs[atlas.triangle]].astype(np.float64)
    sides = np.diff(vertices[geometry.triangles[atlas.triangle]], axis=1)
    flat = np.diff(corners, axis=1)
    # dx = by_u du + by_v dv along both sides of the triangle.
    told = np.einsum("pk,px->pkx", flat[..., 0], frames.by_u)
    told += np.einsum("pk,px->pkx", flat[..., 1], frames.by_v)
    error = np.linalg.norm(told - sides, axis=2) / np.linalg.norm(sides, axis=2)
    print(f"sides of triangles by their frames are off by {np.median(error):.3f} of them")
    assert np.median(error) < 0.2


def test_tangent_space_and_back(frames: Frames):
    rng = np.random.default_rng(0)
    bent = turned(frames.normals, 0.3 * rng.normal(size=frames.normals.shape))
    tangent, bitangent = frames.tangents
    # Where the texture is not sheared, the three axes are orthogonal; elsewhere too by making.
    assert np.abs(np.einsum("px,px->p", tangent, bitangent)).max() < 1e-9
    again = frames.from_tangent_space(frames.in_tangent_space(bent))
    np.testing.assert_allclose(again, bent, atol=1e-9)


def test_a_slope_along_u_is_red(frames: Frames):
    """OpenGL's convention: skin that rises towards u leans to the left, so red is below 0.5."""
    count = len(frames.normals)
    length = np.linalg.norm(frames.by_u, axis=1)
    bent = turned(frames.normals, frames.slopes(0.2 * length, np.zeros(count)))
    red, _, blue = frames.in_tangent_space(bent).T
    assert (red < 0).all() and (blue > 0).all()


def test_a_flat_map_changes_nothing(scene: Scene):
    y, x = np.mgrid[:96, :96]
    pixels = np.stack([x.ravel(), y.ravel()], axis=1) + 0.5
    surface = scene.forward.surface(scene.state, pixels, only_fitted=True)
    field = FrameField.of(scene.geometry, surface.model_vertices)
    flat = np.broadcast_to(NORMAL.default, (8, 8, 3)).astype(np.float64)
    mapped = field.mapped(surface, scene.forward.uvs(surface), flat, scene.state.rotation)
    np.testing.assert_allclose(mapped.normals, surface.normals, atol=1e-6)

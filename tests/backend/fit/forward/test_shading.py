"""One pixel at a time: the forward model against slow code from the camera to the color."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.brdf import ALBEDO_MAX, K_DIFFUSE, K_SPECULAR
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.forward.shading import bilinear_weights, pixel_rays, sample_bilinear
from facestage.render.light_terms import Asked, LightTerms
from reference.rendering.area_light import direct_light, tea
from reference.rendering.cook_torrance import normalize
from reference.rendering.intersect import first_hits
from reference.synthetic_scene import Scene

PIXELS = np.array([[48, 46], [40, 55], [55, 40], [60, 60], [35, 38], [48, 70]]) + 0.5


def test_pixels_look_where_they_project(scene: Scene):
    camera = scene.state.camera
    rays = pixel_rays(camera, PIXELS)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1)
    np.testing.assert_allclose(camera.project(0.37 * rays), PIXELS)


def shade_pixel(scene: Scene, pixel: np.ndarray, samples: int, seed: int) -> np.ndarray:
    """(3,) color of one pixel, every step spelled out."""
    state, model = scene.state, scene.model
    vertices = model.vertices.astype(float)
    for weight, mode in zip(
        [*state.identity, *state.expression],
        [*model.identity_basis, *model.expression_basis],
        strict=True,
    ):
        vertices = vertices + weight * mode.astype(float)
    vertices = vertices @ state.rotation.T + state.translation
    ray = normalize(
        np.array(
            [
                (pixel[0] - state.camera.principal_px[0]) / state.camera.focal_px,
                -(pixel[1] - state.camera.principal_px[1]) / state.camera.focal_px,
                -1.0,
            ]
        )
    )
    triangle, weights, distance = first_hits(np.zeros(3), ray[None], vertices, model.triangles)
    corners, weights = model.triangles[triangle[0]], weights[0]
    normals = np.zeros_like(vertices)
    for a, b, c in model.triangles:
        face = np.cross(vertices[b] - vertices[a], vertices[c] - vertices[a])
        for corner in (a, b, c):
            normals[corner] += face
    normal = normalize(weights @ normalize(normals[corners]))
    a, b, c = vertices[corners]
    facing = normalize(np.cross(b - a, c - a))
    facing = facing if facing @ ray < 0 else -facing
    point = distance[0] * ray
    key = np.array([int(pixel[1]) << 16 | int(pixel[0])], np.uint64)
    square = np.zeros((1, len(scene.stage), samples, 2))
    for light in range(len(scene.stage)):
        salt = np.array([light * 0x9E3779B1 + 2 * seed], np.uint64)
        for axis, step in enumerate((0.7548776662466927, 0.5698402909980532)):
            square[0, light, :, axis] = (
                np.arange(samples) * step + tea(key, salt + 1 + axis)
            ) % 1.0
    diffuse, specular = direct_light(
        point[None],
        normal[None],
        -ray[None],
        scene.stage,
        state.roughness,
        square,
        (point + 2e-4 * facing)[None],
        (vertices, model.triangles),
    )
    log_albedo = (
        weights
        @ (np.log(model.albedo_mean) + np.tensordot(state.albedo, model.albedo_basis, 1))[corners]
    )
    albedo = np.minimum(np.exp(log_albedo), ALBEDO_MAX)
    uv = weights @ model.uvs[corners]
    c_spec = texture_at(state.specular, uv)
    radiance = scene.lights.radiance(state.lights)
    return K_DIFFUSE * albedo / np.pi * (diffuse[0] @ radiance) + K_SPECULAR * c_spec * (
        specular[0] @ radiance
    )


def texture_at(texture: np.ndarray, uv: np.ndarray) -> float:
    """Bilinear lookup, one tent per texel; row 0 at v = 1, edges clamp."""
    size = len(texture)
    x = min(max(uv[0] * size - 0.5, 0), size - 1)
    y = min(max((1 - uv[1]) * size - 0.5, 0), size - 1)
    total = 0.0
    for row in range(size):
        for column in range(size):
            total += max(0, 1 - abs(x - column)) * max(0, 1 - abs(y - row)) * texture[row, column]
    return total


def test_one_pixel_shading(scene: Scene):
    samples, seed = 4, 9
    surface = scene.forward.surface(scene.state, PIXELS)
    terms = scene.forward.light_terms(scene.state, surface, scene.stage, samples, seed)
    colors = scene.forward.shade(scene.state, surface, terms).color
    assert len(colors) == len(PIXELS)
    for pixel, found in zip(PIXELS, colors, strict=True):
        wanted = shade_pixel(scene, pixel, samples, seed)
        error = np.abs(found - wanted).max() / wanted.max()
        print(f"pixel {pixel}: {found} against {wanted}, error {error:.1e}")
        assert error < 2e-4


@pytest.mark.parametrize("size", [1, 2, 5])
def test_bilinear_lookup(size: int):
    random = np.random.default_rng(size)
    texture, uvs = random.random((size, size)), random.uniform(-0.1, 1.1, (50, 2))
    np.testing.assert_allclose(
        sample_bilinear(texture, uvs), [texture_at(texture, uv) for uv in uvs]
    )
    np.testing.assert_allclose(bilinear_weights(uvs, size)[1].sum(1), 1)
    # The centre of the first texel lies at the top left.
    assert sample_bilinear(texture, np.array([[0.5 / size, 1 - 0.5 / size]]))[0] == pytest.approx(
        texture[0, 0]
    )


def test_geometry_moves_with_its_modes_and_normals_are_unit(scene: Scene):
    identity, expression = scene.state.identity, scene.state.expression
    vertices = scene.geometry.vertices(identity, expression)
    np.testing.assert_allclose(vertices, scene.model.shape(identity, expression), atol=1e-6)
    relief = np.array([0.6, -0.4])
    moved = scene.geometry.vertices(identity, expression, relief) - vertices
    wanted = 0.6 * scene.geometry.relief_basis[0] - 0.4 * scene.geometry.relief_basis[1]
    np.testing.assert_allclose(moved, wanted, atol=1e-8)
    assert np.linalg.norm(moved, axis=1).max() > 1e-4
    normals, length = scene.geometry.vertex_normals(vertices)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1)
    assert (length > 0).all() and (normals[:, 2] > -0.3).all()
    corner = scene.geometry.triangles[::50, 0]
    around = np.flatnonzero(np.isin(scene.geometry.triangles, corner).any(axis=1))
    some = scene.geometry.vertex_normals(vertices, around)
    np.testing.assert_array_equal(some[0][corner], normals[corner])
    np.testing.assert_array_equal(some[1][corner], length[corner])


def test_normal_operator_is_the_derivative_of_the_normals(scene: Scene):
    geometry = scene.geometry
    vertices = geometry.at(scene.state)
    operator = geometry.normal_operator(vertices, np.ones(len(vertices), bool))
    direction = np.random.default_rng(0).normal(size=vertices.shape)

    def unnormalized(points: np.ndarray) -> np.ndarray:
        normals, length = geometry.vertex_normals(points)
        return normals * length[:, None]

    wanted = (
        unnormalized(vertices + 1e-6 * direction) - unnormalized(vertices - 1e-6 * direction)
    ) / 2e-6
    found = (operator @ direction.ravel()).reshape(-1, 3)
    error = np.abs(found - wanted).max() / np.abs(wanted).max()
    print(f"normal operator: error {error:.1e}, allowed 1e-5")
    assert error < 1e-5
    some = np.arange(len(vertices)) % 3 == 1
    part = geometry.normal_operator(vertices, some)
    assert (part != operator[np.repeat(some, 3)]).nnz == 0


def test_parts_that_are_not_rendered_are_dropped(scene: Scene):
    part = scene.model.polygon_part.copy()
    part[len(part) // 2 :] = 4
    geometry = FaceGeometry(replace(scene.model, polygon_part=part))
    assert len(geometry.mean) < len(scene.model.vertices)
    np.testing.assert_array_equal(geometry.mean, scene.model.vertices[geometry.used])
    kept = scene.model.triangles[np.repeat(part, 1 + (scene.model.polygons[:, 3] >= 0)) != 4]
    np.testing.assert_array_equal(geometry.used[geometry.triangles], kept)


def test_a_face_outside_the_picture_gives_no_pixels(scene: Scene):
    away = replace(scene.state, translation=np.array([3.0, 0, -0.6]))
    surface = scene.forward.surface(away, PIXELS)
    assert len(surface.pixels) == 0
    terms = scene.forward.light_terms(away, surface, scene.stage, 2, 0, Asked(by_surface=True))
    assert scene.forward.shade(away, surface, terms).color.shape == (0, 3)
    assert scene.forward.surface(scene.state, np.zeros((0, 2))).points.shape == (0, 3)


@pytest.mark.parametrize("bounces", [0.0, 1.0])
def test_what_all_lights_send_together_lights_as_each_of_them(scene: Scene, bounces: float):
    """In blocks of pixels, and with three lights that are the channels."""
    y, x = np.mgrid[:96:5, :96:5]
    pixels = np.stack([x.ravel(), y.ravel()], axis=1) + 0.5
    state = replace(scene.state, interreflection=bounces)
    surface = scene.forward.surface(state, pixels)
    radiance = scene.forward.lights.radiance(state.lights)

    def terms(block: slice) -> LightTerms:
        return scene.forward.light_terms(
            state, surface.part(block), scene.stage, 2, 0, Asked(by_roughness=True)
        )

    half = len(surface.pixels) // 2
    parts = [terms(block).under(radiance) for block in (slice(0, half), slice(half, None))]
    together = scene.forward.shade(state, surface, LightTerms.joined(parts), radiance=np.eye(3))
    whole = terms(slice(None))
    each = scene.forward.shade(state, surface, whole)
    np.testing.assert_allclose(together.color, each.color, rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(
        together.terms.specular_by_roughness, whole.specular_by_roughness, rtol=1e-5, atol=1e-7
    )


def test_a_box_holds_all_pixels_that_see_the_mesh(scene: Scene):
    y, x = np.mgrid[: scene.state.camera.height, : scene.state.camera.width]
    pixels = np.stack([x.ravel(), y.ravel()], axis=1)
    triangle = scene.forward.hits(scene.state, pixels + 0.5).triangle
    part = np.arange(len(scene.geometry.triangles)) < len(scene.geometry.triangles) // 3
    for chosen, seen in ((None, triangle >= 0), (part, (triangle >= 0) & part[triangle])):
        rows, columns = scene.forward.box(scene.state, chosen)
        inside = (
            (pixels[:, 1] >= rows.start)
            & (pixels[:, 1] < rows.stop)
            & (pixels[:, 0] >= columns.start)
            & (pixels[:, 0] < columns.stop)
        )
        assert seen.any() and inside[seen].all() and not inside.all()
    behind = replace(scene.state, translation=np.array([0.0, 0.0, 0.0]))
    assert scene.forward.box(behind) == (
        slice(0, scene.state.camera.height),
        slice(0, scene.state.camera.width),
    )

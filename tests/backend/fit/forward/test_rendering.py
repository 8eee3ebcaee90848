"""Pictures of a fitted face, its textures, and the light as an environment map."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from facestage.contract.landmarks import Landmarks
from facestage.contract.light_stage import LightStage, fibonacci_stage
from facestage.fit.forward.one_light import NUMBERS_MAX, relight_scale
from facestage.fit.forward.rendering import Picture, Textures, light_probe, render_picture
from facestage.fit.given.face_areas import face_pixels
from facestage.fit.given.problem import select_lights
from facestage.fit.given.skin_mask import skin_weight
from facestage.fit.textures.atlas import Atlas
from reference.painted_face import painted_face
from reference.synthetic_scene import Scene


def light_at(towards: tuple[float, float, float]) -> LightStage:
    """One light of the stage, moved to a direction."""
    stage = fibonacci_stage(1, radius=1.0, side=0.3)
    outward = np.array([towards], float)
    axis = np.cross([[0.3, 0.9, 0.1]], outward)
    axis /= np.linalg.norm(axis)
    return replace(
        stage,
        position=outward,
        direction=-outward,
        axis_x=axis,
        radiance=np.array([[5.0, 3.0, 1.0]]),
    )


@pytest.mark.parametrize(
    ("towards", "row", "column"),
    [
        ((0, 0, 1), 0.5, 0.5),
        ((1, 0, 0), 0.5, 0.25),
        ((-1, 0, 0), 0.5, 0.75),
        ((0, 1, 0), 0.0, None),
        ((0, -1, 0), 1.0, None),
    ],
)
def test_each_direction_has_its_place_in_the_probe(towards, row: float, column: float | None):
    probe = light_probe(light_at(towards), height=64)
    assert probe.shape == (64, 128, 3) and probe.max() == 5.0
    y, x = np.nonzero(probe[..., 0] > 2)
    # A light at a pole covers rows next to the edge.
    assert abs(y.mean() / 63 - row) < 0.06
    if column is not None:
        assert abs(x.mean() / 127 - column) < 0.03
    np.testing.assert_allclose(probe[..., 1] * 5, probe[..., 0] * 3, rtol=1e-5)


def test_the_probe_holds_the_light_s_irradiance():
    """Sum over the sphere of radiance x solid angle is the light's own."""
    stage = light_at((0, 0, 1))
    probe = light_probe(stage, height=256)
    elevation = np.pi * (0.5 - (np.arange(256) + 0.5) / 256)
    solid_angle = (np.cos(elevation) * (np.pi / 256) ** 2)[:, None]
    # Solid angle of a square of half side a at distance 1.
    a = 0.15
    wanted = 4 * np.arcsin(a * a / (1 + a * a))
    assert (probe[..., 0] * solid_angle).sum() / 5 == pytest.approx(wanted, rel=0.02)


def test_a_light_that_looks_away_is_not_in_the_probe():
    stage = light_at((0, 0, 1))
    assert not light_probe(replace(stage, direction=-stage.direction)).any()


@pytest.fixture(scope="module")
def textures(scene: Scene) -> Textures:
    atlas = Atlas.build(scene.geometry, 128)
    return Textures(
        np.exp(atlas.bake(scene.forward.log_albedo(scene.state))),
        np.full((16, 16), 0.8, np.float32),
    )


def test_the_picture_is_the_forward_model_averaged(scene: Scene, textures: Textures):
    state = replace(scene.state, specular=np.full((6, 6), 0.8))
    picture = render_picture(scene.forward, state, scene.stage, textures, seed=1, samples=8)
    color, seen = scene.render(state, samples=32)
    assert picture.color.shape == color.shape and picture.coverage.max() == pytest.approx(
        1, abs=1e-5
    )
    inside = picture.fitted & seen
    error = np.abs(picture.color - color)[inside]
    print(
        f"anti-aliased picture against pixel centres: mean {error.mean() / color.max():.1e} of "
        "the brightest"
    )
    assert inside.sum() > 1500 and error.mean() < 0.01 * color.max()
    assert not picture.color[picture.coverage == 0].any()


@pytest.fixture(scope="module")
def grain(renderer: str) -> dict[tuple[str, str], float]:
    """Root mean square errors of a picture under its own light and relit by its darkest lamps, and
    of each lamp alone: by one ray for each light and part of a pixel, and as rays are given out.
    """
    face = painted_face(texels=64, key_side=0.3)
    box = face.forward.box(face.state)
    pixels = (box[0].stop - box[0].start) * (box[1].stop - box[1].start)
    shiny = Textures(np.full((16, 16, 3), 0.5, np.float32), np.full((16, 16), 0.5, np.float32))
    rays = 1.5 * pixels * len(face.stage)
    brightness = face.stage.radiance.mean(axis=1)
    dark = np.where(brightness < np.median(brightness), 1.0, 0.0)[:, None] * np.ones(3)

    def rendered(seed: int, samples: int | None, **more: Any) -> Picture:
        return render_picture(
            face.forward, face.state, face.stage, shiny, seed, samples, rays=rays, **more
        )

    def pictures(seed: int, samples: int | None) -> dict[str, np.ndarray]:
        picture = rendered(seed, samples, relight={"relit": dark})
        alone = rendered(seed, samples, by_light=True)
        assert picture.samples == alone.samples == (samples or 1) and alone.by_light is not None
        return {
            "own": picture.color[picture.fitted],
            "relit": picture.relit["relit"][picture.fitted],
            "alone": alone.by_light.colors,
        }

    reference = pictures(7, 64)
    return {
        (name, kind): float(np.sqrt(((values - reference[kind]) ** 2).mean()))
        for name, samples in (("budget", None), ("one ray", 1))
        for kind, values in pictures(3, samples).items()
    }


@pytest.mark.parametrize("kind", ["own", "relit", "alone"])
def test_penumbras_are_as_smooth_as_many_rays_make_them(
    grain: dict[tuple[str, str], float], kind: str
):
    """One ray for each light and part of a pixel leaves grain where a shadow ends."""
    few, many = grain["one ray", kind], grain["budget", kind]
    print(f"{kind}: {many:.5f} instead of {few:.5f}, {many / few:.2f} of it")
    assert many < 0.2 * few


def test_relit_pictures_are_linear_in_the_light(scene: Scene, textures: Textures):
    double, first = 2 * scene.stage.radiance, scene.stage.radiance * (np.arange(6) == 0)[:, None]
    rest = scene.stage.radiance - first
    picture = render_picture(
        scene.forward,
        scene.state,
        scene.stage,
        textures,
        samples=2,
        relight={"double": double, "first": first, "rest": rest},
    )
    np.testing.assert_allclose(picture.relit["double"], 2 * picture.color, rtol=1e-5, atol=1e-8)
    np.testing.assert_allclose(
        picture.relit["first"] + picture.relit["rest"], picture.color, rtol=1e-4, atol=1e-7
    )


def test_each_light_s_image_is_the_picture_under_that_light_alone(scene: Scene, textures: Textures):
    only = {str(j): scene.stage.radiance * (np.arange(6) == j)[:, None] for j in range(6)}
    picture = render_picture(
        scene.forward,
        scene.state,
        scene.stage,
        textures,
        seed=5,
        samples=2,
        relight=only,
        by_light=True,
    )
    cache = picture.relight_cache("")
    assert cache is not None and picture.samples == cache.samples == 2
    brightest = picture.color.max()
    for name, radiance in ({"": scene.stage.radiance} | only).items():
        traced = picture.relit[name] if name else picture.color
        worst = np.abs(cache.relight(radiance) - traced).max() / brightest
        print(f"light {name or 'all'}: off by {worst:.1e} of the brightest, half floats allow 5e-4")
        assert worst < 5e-4
    seen = np.flatnonzero(picture.coverage > 0)
    np.testing.assert_array_equal(cache.pixels, seen)
    np.testing.assert_allclose(cache.coverage, picture.coverage.ravel()[seen])


def test_images_by_light_of_a_head_outside_the_picture(scene: Scene, textures: Textures):
    away = replace(scene.state, translation=scene.state.translation + 5.0 * np.eye(3)[0])
    cache = render_picture(scene.forward, away, scene.stage, textures, by_light=True).relight_cache(
        ""
    )
    assert cache is not None and not len(cache.pixels) and len(cache) == 6
    assert not cache.relight(scene.stage.radiance).any()


def test_large_photos_are_relit_smaller():
    assert relight_scale(512 * 512, 20) == 1 and relight_scale(0, 20) == 1
    factor = relight_scale(3000 * 4000, 20)
    assert 3 * 20 * 3000 * 4000 * factor**2 == pytest.approx(NUMBERS_MAX)


def test_selected_lights_keep_their_rows():
    stage = fibonacci_stage(5)
    some = select_lights(stage, np.array([True, False, True, False, True]))
    np.testing.assert_array_equal(some.position, stage.position[::2])


def test_baked_values_come_back_at_the_vertices(scene: Scene):
    atlas = Atlas.build(scene.geometry, 128)
    texture = atlas.bake(scene.geometry.log_albedo)
    assert atlas.covered.mean() > 0.8 and np.isfinite(texture).all()
    uvs = scene.model.uvs[100:400]
    column, row = (uvs[:, 0] * 128).astype(int), ((1 - uvs[:, 1]) * 128).astype(int)
    assert np.abs(texture[row, column] - scene.geometry.log_albedo[100:400]).max() < 0.05
    corners = scene.geometry.triangles[atlas.triangle]
    by_hand = np.einsum("ti,tic->tc", atlas.weights, scene.geometry.log_albedo[corners])
    np.testing.assert_allclose(texture[atlas.covered], by_hand, atol=1e-5)
    away = np.argwhere(~atlas.covered)
    there = np.argwhere(atlas.covered)
    for place in away[:: max(len(away) // 20, 1)]:
        distance = ((there - place) ** 2).sum(axis=1)
        nearest = texture[tuple(there[distance == distance.min()].T)]
        assert (texture[tuple(place)] == nearest).all(axis=1).any()


def test_a_roughness_map_of_one_value_changes_nothing(scene: Scene, textures: Textures):
    plain = render_picture(scene.forward, scene.state, scene.stage, textures, seed=1, samples=2)
    mapped = replace(textures, roughness=np.full((8, 8), scene.state.roughness, np.float32))
    same = render_picture(scene.forward, scene.state, scene.stage, mapped, seed=1, samples=2)
    np.testing.assert_allclose(same.color, plain.color, rtol=1e-4, atol=1e-6)
    # Half of the map rougher: only there.
    half = np.full((8, 8), scene.state.roughness, np.float32)
    half[:, 5:] = 0.8
    changed = render_picture(
        scene.forward, scene.state, scene.stage, replace(textures, roughness=half), 1, 2
    ).color
    y, x = np.mgrid[:96, :96]
    surface = scene.forward.surface(scene.state, np.stack([x.ravel(), y.ravel()], 1) + 0.5)
    column, row = surface.pixels.astype(int).T
    u = scene.forward.uvs(surface)[:, 0]
    difference = np.abs(changed - plain.color)[row, column].max(axis=1)
    brightest = plain.color.max()
    assert (
        difference[u < 0.45].max() < 1e-5 * brightest
        and difference[u > 0.75].max() > 1e-3 * brightest
    )


def test_skin_is_told_from_cloth_and_background(scene: Scene):
    color, seen = scene.render()
    photo = np.where(seen[..., None], color, 0.05 * np.array([0.2, 0.4, 1.0]))
    weight = skin_weight(photo, scene.landmarks(), openings=False)
    assert weight.shape == (96, 96) and weight.min() >= 0 and weight.max() <= 1
    assert weight[seen].mean() > 0.8 and weight[~seen].mean() < 0.1


def test_face_pixels_and_points_that_are_no_numbers():
    points = np.full((68, 2), np.nan)
    points[:4] = [[2.5, 2.5], [12.5, 2.5], [12.5, 8.5], [2.5, 8.5]]
    inside = face_pixels((16, 20), Landmarks("ibug68", points, np.arange(68) < 4))
    assert inside[2:9, 2:13].all() and inside.sum() == 7 * 11

"""Light below the skin: against the profile that is published, over planes, steps and faces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import j0

from facestage.contract.light_stage import LightStage
from facestage.contract.scattering import DISTANCE_MM, METRES
from facestage.fit.face.state import State
from facestage.fit.forward import scattered_picture
from facestage.fit.forward.one_light import OneLightImages
from facestage.fit.forward.rendering import Textures, render_picture
from facestage.fit.forward.scattered_picture import LatticeLight
from facestage.fit.forward.scattering import Scattering, spectrum
from facestage.fit.forward.shading import Surface
from facestage.render.light_terms import LightTerms
from facestage.render.variant import start_renderer
from reference.synthetic_scene import SIDE, Scene, synthetic_scene

FINE = 0.25 * METRES  # of a pixel: a fraction of what red light wanders


@pytest.fixture(scope="module", autouse=True)
def renderer() -> None:
    start_renderer("cpu")


@pytest.fixture(scope="module")
def scene() -> Scene:
    return synthetic_scene()


def plane(
    count: int, spacing: float, slope: tuple[float, float] = (0.0, 0.0), strength: float = 1.0
) -> tuple[Scattering, np.ndarray]:
    """A plane seen from far above, and where its points are (P, 3)."""
    y, x = np.mgrid[:count, :count]
    pixels = np.stack([x.ravel(), y.ravel()], axis=1) + 0.5
    across = (pixels - count / 2) * spacing
    points = np.column_stack([across, across @ np.array(slope)])
    normal = np.array([-slope[0], -slope[1], 1.0]) / np.sqrt(1 + slope[0] ** 2 + slope[1] ** 2)
    rays, normals = np.zeros_like(points), np.broadcast_to(normal, points.shape)
    rays[:, 2] = -1.0
    skin = np.ones(len(points), bool)
    return Scattering.over(pixels, points, rays, normals, skin, strength), points


def beside_an_edge(x: float, distance: float) -> float:
    """The profile's light at ``x`` beside a half plane that is lit: of each ring around it the
    share that lies there.
    """

    def ring(r: float) -> float:
        share = np.arccos(np.clip(-x / r, -1, 1)) / np.pi
        return share * (np.exp(-r / distance) + np.exp(-r / (3 * distance))) / (4 * distance)

    far = 40 * distance
    return quad(ring, 0, far, points=[abs(x)] if abs(x) < far else None, limit=200)[0]


@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.7, 0.7)])
def test_an_edge_is_blurred_as_published(slope: tuple[float, float]):
    """Along the surface: its tilt makes pixels longer, and light wanders over fewer of them."""
    spread, points = plane(80, FINE, slope)
    along = np.array([slope[0], slope[1], slope[0] ** 2 + slope[1] ** 2]) if any(slope) else None
    along = np.array([1.0, 0, 0]) if along is None else along / np.linalg.norm(along)
    place = points @ along
    lit = np.repeat((place > 0)[:, None].astype(float), 3, axis=1)
    lit[np.abs(place) < 1e-9] = 0.5
    found = spread.channels(lit)
    middle = (np.abs(points[:, :2]) < 0.3 * 80 * FINE).all(axis=1) & (np.abs(place) > 2 * FINE)
    for channel, distance in enumerate(DISTANCE_MM):
        chosen = np.flatnonzero(middle)[::37]
        wanted = [beside_an_edge(place[each], METRES * distance) for each in chosen]
        error = np.abs(found[chosen, channel] - wanted).max()
        print(f"slope {slope}, channel {channel}: {error:.4f}, allowed 0.03")
        assert error < 0.03


def test_waves_are_left_as_the_profile_says():
    """The formula of f is the Hankel transform of the profile."""
    wave, distance = 900.0, METRES * DISTANCE_MM[0]
    size = quad(
        lambda r: (
            (np.exp(-r / distance) + np.exp(-r / (3 * distance))) / (4 * distance) * j0(wave * r)
        ),
        0,
        60 * distance,
        limit=500,
    )[0]
    value, _ = spectrum(np.array([wave**2]), 1.0)
    assert value[0, 0] == pytest.approx(size, rel=1e-5)


def test_light_is_neither_lost_nor_made():
    spread, points = plane(40, METRES, (0.3, -0.5))
    even = np.ones((len(points), 3))
    np.testing.assert_allclose(spread.channels(even), even, atol=1e-9)
    spot = np.zeros((len(points), 3))
    spot[40 * 20 + 20] = 1.0
    np.testing.assert_allclose(spread.channels(spot).sum(axis=0), 1.0, atol=2e-3)


def test_red_goes_farther_than_blue_and_nothing_without_strength():
    spread, points = plane(40, METRES)
    edge = np.repeat((points[:, :1] > 0).astype(float), 3, axis=1)
    leaked = spread.channels(edge)[points[:, 0] < 0].mean(axis=0)
    assert leaked[0] > 1.3 * leaked[1] > 1.3 * 1.3 * leaked[2] > 0
    none, _ = plane(40, METRES, strength=1e-6)
    np.testing.assert_allclose(none.channels(edge), edge, atol=1e-6)


def test_derivative_by_strength():
    values = np.random.default_rng(0).uniform(size=(900, 3))
    low, middle, high = (plane(30, METRES, strength=each)[0] for each in (0.99, 1.0, 1.01))
    wanted = (high.channels(values) - low.channels(values)) / 0.02
    found = middle.by_strength(values)
    error = np.abs(found - wanted).max() / np.abs(wanted).max()
    print(f"by strength: {error:.1e} of the largest, allowed 1e-2")
    assert error < 1e-2


def test_by_light_is_by_channel():
    spread, points = plane(30, METRES)
    lights = np.random.default_rng(1).uniform(size=(len(points), 4)).astype(np.float32)
    radiance = np.random.default_rng(2).uniform(size=(4, 3))
    wanted = spread.lit(lights, radiance)
    found = np.einsum("cpl,lc->pc", spread.by_light(lights), radiance)
    np.testing.assert_allclose(found, wanted, rtol=1e-4, atol=1e-5)


def test_light_does_not_cross_a_step_of_depth_nor_leave_the_skin():
    """A sheet a centimetre above another, and a part that is none of the skin."""
    count = 30
    y, x = np.mgrid[:count, :count]
    pixels = np.stack([x.ravel(), y.ravel()], axis=1) + 0.5
    near = pixels[:, 0] < count / 2
    points = np.column_stack([METRES * pixels, np.where(near, 0.01, 0.0)])
    rays, normals = np.zeros_like(points), np.zeros_like(points)
    rays[:, 2], normals[:, 2] = -1.0, 1.0
    eye = pixels[:, 1] < 8
    spread = Scattering.over(pixels, points, rays, normals, ~eye, 1.0)
    light = np.where(near, 1.0, 0.0)[:, None] * np.ones(3)
    np.testing.assert_allclose(spread.channels(light), light, atol=1e-6)
    light = np.where(eye, 1.0, 0.0)[:, None] * np.ones(3)
    np.testing.assert_allclose(spread.channels(light), light, atol=1e-6)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_few_pixels(count: int):
    spread, _ = plane(count, METRES)
    light = np.ones((count**2, 3))
    np.testing.assert_allclose(spread.channels(light), light, atol=1e-9)


def all_pixels(side: int) -> np.ndarray:
    return np.stack(np.meshgrid(np.arange(side), np.arange(side)), -1).reshape(-1, 2)


def half_lit(points: np.ndarray) -> np.ndarray:
    """(P, 1) a stripe of light across the face, as wide as light wanders that is far reaching."""
    return np.exp(-(((points[:, :1] + points[:, 1:2]) / (8 * METRES)) ** 2))


@pytest.mark.parametrize("size", [1.0, 4.0])
def test_a_lattice_spreads_as_the_pixels_do(
    scene: Scene, monkeypatch: pytest.MonkeyPatch, size: float
):
    """Of as many points, and of one in sixteen."""
    monkeypatch.setattr(scattered_picture, "SPACING", 3 * METRES)
    forward, camera = scene.forward, scene.state.camera.scaled(size)
    state = replace(scene.state, scattering=3.0, camera=camera)

    def striped(
        state: State, surface: Surface, stage: LightStage, *rest: object, **options: object
    ) -> LightTerms:
        light = half_lit(surface.points).astype(np.float32)
        return LightTerms(light, np.zeros_like(light))

    monkeypatch.setattr(forward, "light_terms", striped)
    pixels = all_pixels(round(size * SIDE))
    surface = forward.surface(state, pixels + 0.5)
    lattice = LatticeLight.under(forward, state, scene.stage, pixels, 0)
    assert (lattice.step > 1) == (size > 1)
    light, white = half_lit(surface.points).astype(np.float32), np.ones((1, 3))
    own = forward.scattering(surface, 3.0).lit(light, white)
    shared = lattice.at(surface).lit(light, white)
    spread, apart = (np.sqrt((each**2).mean(axis=0)) for each in (own - light, own - shared))
    print(f"step {lattice.step}: spread by {spread}, apart by {apart}")
    assert (apart < 0.01).all() and (spread > 0.008).all()  # of light that is 1 at most


def test_lights_add_up(scene: Scene):
    """The sum of the images of single lights is the picture."""
    forward, state, pixels = scene.forward, replace(scene.state, scattering=1.5), all_pixels(SIDE)
    surface = forward.surface(state, pixels + 0.5)
    terms = forward.light_terms(state, surface, scene.stage, 4, 0)
    spread = LatticeLight.under(forward, state, scene.stage, pixels, 0).at(surface)
    image = forward.shade(state, surface, terms, spread=spread)
    assert np.abs(image.color - forward.shade(scene.state, surface, terms).color).max() > 1e-3
    images = OneLightImages(state.camera, pixels, len(scene.stage))
    x, y = surface.pixels.astype(int).T
    images.add(x, y, 1.0, terms, image.skin, spread)
    for channel in range(3):
        total = images.colors[channel][SIDE * y + x] @ image.radiance[:, channel]
        np.testing.assert_allclose(total, image.color[:, channel], rtol=1e-4, atol=1e-5)


def test_a_rendered_picture_has_it(scene: Scene):
    albedo, specular = np.full((8, 8, 3), 0.4), np.full((8, 8), 0.5)
    stage = scene.stage.with_radiance(scene.lights.radiance(scene.state.lights))
    pictures = [
        render_picture(
            scene.forward,
            replace(scene.state, scattering=strength),
            stage,
            Textures(albedo, specular),
            samples=4,
            by_light=True,
        )
        for strength in (0.0, 2.0)
    ]
    plain, spread = (picture.color for picture in pictures)
    assert np.abs(spread - plain).max() > 0.02 * plain.max()
    assert spread.sum() == pytest.approx(plain.sum(), rel=0.02)
    cache = pictures[1].relight_cache("x")
    assert cache is not None
    assert np.abs(cache.relight(stage.radiance) - spread).max() < 0.02 * spread.max()

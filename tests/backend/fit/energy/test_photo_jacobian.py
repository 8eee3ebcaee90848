"""The photometric Jacobian against central finite differences, parameter by parameter."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from facestage.fit.energy.photo_jacobian import Jacobian
from facestage.fit.face.lamps import turned
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import BLOCKS
from facestage.fit.forward.lamp_derivatives import position_derivatives
from facestage.fit.forward.moving_bounces import Views, moving_bounces
from facestage.fit.forward.shading import Image
from facestage.render.light_terms import Asked, LightTerms, LitPoints
from reference.synthetic_scene import Scene

SAMPLES, SEED = 4, 6
# Steps that move the image by about a tenth of a pixel, or change the color by about a per cent.
STEPS: dict[str, ArrayLike] = {
    "pose": np.array([1e-3, 1e-3, 1e-3, 2e-4, 2e-4, 1e-3]),
    "focal": 2e-3,
    "identity": 0.05,
    "expression": 0.02,
    "relief": 0.5,
    "lights": 0.2,
    "light_position": 2e-3,
    "albedo": 0.02,
    "roughness": 4e-3,
    "specular": 0.1,
}
STEP = 1e-2  # of all others
BOUND = 0.02
PIVOT = np.array([0.02, -0.03, -0.8])  # the stage's centre, about


def picture(scene: Scene, state: State, pixels: np.ndarray) -> Image:
    surface = scene.forward.surface(state, pixels)
    assert len(surface.pixels) == len(pixels), "choose pixels inside the face"
    placed = turned(scene.stage, state.light_position, PIVOT)
    asked = Asked(by_surface=True, by_roughness=True)
    terms = scene.forward.light_terms(state, surface, placed, SAMPLES, SEED, asked)
    return scene.forward.shade(state, surface, terms)


def interior(scene: Scene) -> np.ndarray:
    """(P, 2) pixels well inside the face, seen at 70 degrees from the normal or less."""
    y, x = np.mgrid[: scene.state.camera.height, : scene.state.camera.width]
    surface = scene.forward.surface(scene.state, np.stack([x.ravel(), y.ravel()], axis=1) + 0.5)
    cosine = -(surface.normals * surface.rays).sum(1)
    chosen = surface.pixels[cosine > 0.35]
    around = [
        scene.forward.surface(scene.state, chosen + shift)
        for shift in ([2, 0], [-2, 0], [0, 2], [0, -2])
    ]
    inside = {tuple(pixel) for pixel in chosen}
    for surface, shift in zip(around, ([2, 0], [-2, 0], [0, 2], [0, -2]), strict=True):
        inside &= {tuple(pixel) for pixel in surface.pixels - shift}
    return np.array(sorted(inside))


@pytest.fixture
def unshadowed(scene: Scene, uniform_scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """Visibility is held fixed by the derivative: leave it out of the difference too."""
    for each in (scene, uniform_scene):
        tracer = each.forward.tracer
        shadowed = tracer.light_terms

        def light_terms(
            lit: LitPoints,
            samples: int,
            seed: int,
            asked: Asked,
            shadowed: Any = shadowed,
            **options: Any,
        ) -> LightTerms:
            return shadowed(lit, samples, seed, replace(asked, shadows=False), **options)

        monkeypatch.setattr(tracer, "light_terms", light_terms)


def dense_jacobian(
    scene: Scene, image: Image, layout: Layout, blocks: tuple[str, ...], at_a_time: int = 10_000
) -> np.ndarray:
    """(3 P, size), zero outside ``blocks``: row 3 * pixel + channel."""
    result = np.zeros((len(image.color), 3, layout.size))
    positions = None
    if "light_position" in blocks:
        every = np.ones(len(scene.stage), bool)
        positions = position_derivatives(
            scene.forward, scene.state, image.surface, scene.stage, PIVOT, every, SAMPLES, SEED
        )
    jacobian = Jacobian(
        scene.forward,
        scene.state,
        image,
        layout,
        layout.mask(blocks),
        positions=positions,
        bounces=moving_bounces(scene.forward, scene.state, image, scene.stage, SEED),
    )
    for block in jacobian.blocks(at_a_time):
        rows = result[block.pixels]
        rows[:, :, jacobian.dense_columns] = block.dense.transpose(1, 0, 2)
        rows[:, :, layout.slices["lights"]] = np.einsum(
            "cbn,ncp->bcp", block.lights, jacobian.light_jacobian
        )
        if block.texels is not None:
            rows[:, :, layout.slices["specular"]] = (
                block.gloss[..., None] * block.texels.toarray()[:, None]
            )
    return result.reshape(-1, layout.size)


def columns(scene: Scene, block: str) -> Iterator[tuple[str, float, float]]:
    """Name, error and share of compared pixels of each parameter in a block."""
    layout, pixels = Layout(scene.state), interior(scene)
    image = picture(scene, scene.state, pixels)
    jacobian = dense_jacobian(scene, image, layout, (block,))
    where = layout.slices[block]
    steps = np.broadcast_to(STEPS.get(block, STEP), where.stop - where.start)
    for offset, step in enumerate(steps):
        increment = np.zeros(layout.size)
        increment[where.start + offset] = step
        plus = picture(scene, layout.apply(scene.state, increment), pixels)
        minus = picture(scene, layout.apply(scene.state, -increment), pixels)
        same = (plus.surface.triangle == image.surface.triangle) & (
            minus.surface.triangle == image.surface.triangle
        )
        wanted = (plus.color - minus.color)[same] / (2 * step)
        found = jacobian[:, where.start + offset].reshape(-1, 3)[same]
        size = np.sqrt((wanted**2).mean())
        error = (
            float(np.percentile(np.abs(found - wanted), 95) / size)
            if size > 0
            else float(np.abs(found).max())
        )
        yield f"{block}[{offset}]", error, float(same.mean())


def check(scene: Scene, block: str, bound: float = BOUND) -> None:
    worst = 0.0
    for name, error, share in columns(scene, block):
        print(
            f"{name:14s} error {error:.1e} of the derivative's size over {100 * share:.0f} % of "
            f"the pixels, allowed {bound:.0e}, margin {bound / max(error, 1e-12):.0f}x"
        )
        worst = max(worst, error)
        assert share > 0.6
    assert worst < bound


# Light from skin to skin and below the skin is zero in the scene, and no unknown then.
INDIRECT = ("interreflection", "scattering")


@pytest.mark.parametrize("block", [name for name in BLOCKS if name not in INDIRECT])
def test_every_parameter(scene: Scene, unshadowed: None, block: str):
    # A longer lens also turns the view and shifts the lit point sideways; the derivative leaves
    # both out. The derivative by a light's place is itself a difference, over a turn ten times as
    # large.
    check(scene, block, {"focal": 0.15, "light_position": 0.06}.get(block, BOUND))


def test_light_from_skin_to_skin(scene: Scene, unshadowed: None):
    """By its strength, and by the lights, both of which it is proportional to."""
    state = replace(scene.state, interreflection=0.7)
    assert picture(scene, state, interior(scene)).terms.indirect.max() > 1e-4
    for block in ("interreflection", "lights"):
        check(replace(scene, state=state), block)


@pytest.fixture
def held_form_factors(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """What points see of the patches stays what it is at the scene's state."""
    bounces = scene.forward.bounces
    picture(scene, replace(scene.state, interreflection=1.0), interior(scene))  # poses the tracer
    lit = bounces.lit_points(
        scene.forward.pose(scene.state)[1] - scene.state.translation, scene.stage, np.arange(6)
    )
    hits = bounces.hits(scene.forward.tracer, lit.points, lit.normals)
    monkeypatch.setattr(bounces, "hits", lambda *_: hits)
    # Then the rays' shares do not change either.
    monkeypatch.setattr(
        Views,
        "changes",
        lambda _, basis, __: np.zeros_like(basis, shape=(len(hits.point), basis.shape[1])),
    )


@pytest.mark.parametrize("block", ["pose", "identity", "expression", "albedo"])
def test_light_from_moving_skin(
    scene: Scene, unshadowed: None, held_form_factors: None, block: str
):
    """All that changes what falls on the skin that sends, and what it sends of that.

    How direct light changes as a point moves along the skin is left out.
    """
    lit = replace(scene, state=replace(scene.state, interreflection=20.0))
    check(lit, block, 0.05 if block == "pose" else BOUND)


BELOW_THE_SKIN = ("scattering", "lights", "light_position", "albedo", "roughness", "specular")


@pytest.mark.parametrize("block", BELOW_THE_SKIN)
def test_light_below_the_skin(scene: Scene, unshadowed: None, block: str):
    """By how far it wanders, and by all that does not move the surface."""
    state = replace(scene.state, scattering=4.0)
    below = replace(scene, state=state)
    pixels = interior(scene)
    change = picture(below, state, pixels).color - picture(scene, scene.state, pixels).color
    assert np.abs(change).max() > 5e-3
    check(below, block, {"light_position": 0.06}.get(block, BOUND))


@pytest.mark.parametrize("block", ["pose", "identity", "expression"])
def test_light_below_moving_skin(scene: Scene, unshadowed: None, block: str):
    """What the surface's motion changes is not spread: off by little of it where light is soft."""
    check(replace(scene, state=replace(scene.state, scattering=1.0)), block, 0.12)


@pytest.mark.parametrize("block", [name for name in BLOCKS if name not in INDIRECT])
def test_light_that_comes_out_unevenly(scene: Scene, unshadowed: None, block: str):
    """By its strength, and by all that changes how the surface slants and bulges."""
    state = replace(scene.state, translucency=0.8)
    uneven, pixels = replace(scene, state=state), interior(scene)
    change = picture(uneven, state, pixels).color - picture(scene, scene.state, pixels).color
    assert np.abs(change).max() > 5e-3
    check(uneven, block, {"focal": 0.15, "light_position": 0.06}.get(block, BOUND))


def test_lights_of_one_color(uniform_scene: Scene, unshadowed: None):
    check(uniform_scene, "lights")


@pytest.mark.parametrize("block", ["pose", "identity"])
def test_with_shadows_most_pixels_agree(scene: Scene, block: str):
    """With shadow rays on, only pixels whose shadow moves may differ: the middle half must still
    agree.
    """
    layout, pixels = Layout(scene.state), interior(scene)
    image = picture(scene, scene.state, pixels)
    jacobian = dense_jacobian(scene, image, layout, (block,))
    column = layout.slices[block].start
    step = float(np.ravel(STEPS[block])[0])
    increment = np.zeros(layout.size)
    increment[column] = step
    plus, minus = (
        picture(scene, layout.apply(scene.state, sign * increment), pixels) for sign in (1, -1)
    )
    wanted = ((plus.color - minus.color) / (2 * step)).ravel()
    error = np.median(np.abs(jacobian[:, column] - wanted)) / np.sqrt(
        (jacobian[:, column] ** 2).mean()
    )
    print(f"{block} with shadows: median error {error:.1e}")
    assert error < BOUND


# Identity, expression and relief share one sparse product.
SHAPE = ("identity", "expression", "relief")


@pytest.mark.parametrize("blocks", [SHAPE, *((name,) for name in BLOCKS if name not in SHAPE)])
def test_inactive_blocks_stay_zero(scene: Scene, blocks: tuple[str, ...]):
    layout, pixels = Layout(scene.state), interior(scene)[::7]
    image = picture(scene, scene.state, pixels)
    everything = dense_jacobian(scene, image, layout, BLOCKS)
    only = dense_jacobian(scene, image, layout, blocks)
    inside = layout.mask(blocks)
    np.testing.assert_allclose(only[:, inside], everything[:, inside], rtol=1e-6, atol=1e-9)
    assert not only[:, ~inside].any()


def test_blocks_of_pixels_join_without_a_seam(scene: Scene):
    layout, pixels = Layout(scene.state), interior(scene)
    image = picture(scene, scene.state, pixels)
    whole = dense_jacobian(scene, image, layout, BLOCKS)
    parts = dense_jacobian(scene, image, layout, BLOCKS, at_a_time=97)
    assert len(pixels) > 3 * 97
    np.testing.assert_allclose(parts, whole, rtol=1e-5, atol=1e-7)

"""The photometric Jacobian's columns: which there are, and what is in them, by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract import brdf
from facestage.fit.energy.photo_jacobian import Jacobian, _inverse3, _texture_gradient
from facestage.fit.face.layout import Layout
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.forward.lamp_derivatives import PositionDerivatives
from facestage.fit.forward.shading import ForwardModel, Image, sample_bilinear
from facestage.render.light_terms import Asked
from reference.synthetic_scene import Scene


@pytest.fixture(scope="module")
def image(scene: Scene) -> Image:
    """Every third pixel of the scene, with all derivatives."""
    y, x = np.mgrid[:96:3, :96:3]
    surface = scene.forward.surface(scene.state, np.stack([x.ravel(), y.ravel()], axis=1) + 0.5)
    asked = Asked(by_surface=True, by_roughness=True)
    terms = scene.forward.light_terms(scene.state, surface, scene.stage, 2, 3, asked)
    return scene.forward.shade(scene.state, surface, terms)


def jacobian_of(scene: Scene, image: Image, *blocks: str) -> Jacobian:
    layout = Layout(scene.state)
    return Jacobian(scene.forward, scene.state, image, layout, layout.mask(blocks))


def test_inverses_of_three_by_three():
    matrices = np.random.default_rng(0).normal(size=(20, 3, 3)) + 2 * np.eye(3)
    np.testing.assert_allclose(_inverse3(matrices), np.linalg.inv(matrices), rtol=1e-9)


@pytest.mark.parametrize(("height", "safe"), [(0.0011, True), (0.0009, False), (0.0, False)])
def test_a_ray_that_grazes_its_triangle_moves_nothing(height: float, safe: bool):
    # Two long edges in a plane, and a ray that leaves it by a thousandth.
    matrix = np.array([[5.0, 0, 1], [0, 3, 0], [0, 0, height]])
    for sign in (1, -1):
        found = _inverse3(sign * matrix[None])[0]
        wanted = np.linalg.inv(sign * matrix) if safe else np.zeros((3, 3))
        np.testing.assert_allclose(found, wanted, rtol=1e-9)
    assert not _inverse3(np.zeros((1, 3, 3))).any()


def test_the_slope_of_a_texture_of_four_texels():
    texture = np.array([[1.0, 2.0], [3.0, 5.0]])  # the first row is at the top, v = 1
    uvs = np.array(
        [[0.5, 0.5], [0.3, 0.5], [0.5, 0.7], [0.2, 0.5], [0.8, 0.5], [0.5, 0.2], [0.5, 0.8]]
    )
    # A texel is half a unit wide: twice the difference, and none beyond the outer texels' middles.
    wanted = np.array([[3, -5], [3, -4.2], [2.2, -5], [0, -4], [0, -6], [4, 0], [2, 0]])
    np.testing.assert_allclose(_texture_gradient(texture, uvs), wanted, atol=1e-12)
    assert not _texture_gradient(np.ones((1, 1)), uvs).any()


def test_the_slope_of_a_texture_is_that_of_its_lookup():
    random = np.random.default_rng(1)
    texture = random.normal(size=(5, 5))
    # A hundredth of a texel from the lines where the slope jumps, at least.
    uvs = (np.floor(random.uniform(0, 5, (200, 2))) + random.uniform(0.01, 0.49, (200, 2))) / 5
    step = 1e-5
    for axis in (0, 1):
        shift = step * np.eye(2)[axis]
        slope = (sample_bilinear(texture, uvs + shift) - sample_bilinear(texture, uvs - shift)) / (
            2 * step
        )
        np.testing.assert_allclose(_texture_gradient(texture, uvs)[:, axis], slope, atol=1e-8)


def test_only_what_is_asked_for_has_a_column(scene: Scene, image: Image):
    layout = Layout(scene.state)
    for blocks in (("pose", "albedo", "lights"), ("specular",), ("roughness", "light_position")):
        found = jacobian_of(scene, image, *blocks)
        assert {name for name, active in found.active.items() if active} == set(blocks)
        # Lights and texels are kept apart; places of lights need their derivatives.
        dense = set(blocks) - {"lights", "specular", "light_position"}
        np.testing.assert_array_equal(found.dense_columns, np.flatnonzero(layout.mask(dense)))
        assert len(found.light_index) == (6 if "lights" in blocks else 0) and found.unseen == 0


def test_a_single_entry_of_a_block_is_its_column(scene: Scene, image: Image):
    layout = Layout(scene.state)
    names = ("pose", "identity", "expression", "albedo")
    whole = jacobian_of(scene, image, *names)
    (every,) = whole.blocks()
    for name in names:
        entry = layout.slices[name].start + 2
        active = np.zeros(layout.size, bool)
        active[entry] = True
        (found,) = Jacobian(scene.forward, scene.state, image, layout, active).blocks()
        wanted = every.dense[:, :, whole.dense_columns == entry]
        assert found.dense.shape == wanted.shape == (3, len(image.color), 1)
        np.testing.assert_allclose(found.dense, wanted, rtol=1e-5, atol=1e-7)


def test_a_light_that_reaches_nothing_and_a_mode_that_moves_nothing_seen_are_counted(
    scene: Scene, image: Image
):
    layout = Layout(scene.state)
    diffuse, specular = image.terms.diffuse.copy(), image.terms.specular.copy()
    diffuse[:, [1, 4]], specular[:, 4] = 0, 0  # of light 1 there is a highlight left
    terms = replace(image.terms, diffuse=diffuse, specular=specular)
    dark = replace(image, terms=terms)
    active = layout.mask(("lights", "roughness"))
    found = Jacobian(scene.forward, scene.state, dark, layout, active)
    np.testing.assert_array_equal(found.light_index, [0, 1, 2, 3, 5])
    assert found.unseen == 1
    every = Jacobian(scene.forward, scene.state, dark, layout, active, all_columns=True)
    assert len(every.light_index) == 6 and every.unseen == 0
    assert jacobian_of(scene, dark, "roughness").unseen == 0, "no light was asked for"


def test_lights_that_are_not_fitted_have_no_column(uniform_scene: Scene, image: Image):
    fitted = np.array([False, True, True, False, True, True])
    lights = LightParameters(fitted, np.zeros((6, 3)), uniform=True)
    forward = ForwardModel(uniform_scene.geometry, lights)
    state = replace(uniform_scene.state, lights=np.array([3.0, 5, 7, 11, 0.5, 1, 2]))
    diffuse, specular = image.terms.diffuse.copy(), image.terms.specular.copy()
    diffuse[:, 1], specular[:, 1] = 0, 0
    dark = replace(image, terms=replace(image.terms, diffuse=diffuse, specular=specular))
    layout = Layout(state)
    found = Jacobian(forward, state, dark, layout, layout.mask(("lights",)))
    np.testing.assert_array_equal(found.light_index, [2, 4, 5])
    assert found.unseen == 1
    # The second of the fitted lights, in red: its intensity times 0.5, the color times 5.
    np.testing.assert_array_equal(found.light_jacobian[0, 0], [0, 0.5, 0, 0, 5, 0, 0])
    np.testing.assert_array_equal(found.light_jacobian[2, 2], [0, 0, 0, 2, 0, 0, 11])


def test_columns_of_light_skin_and_roughness_are_the_factors_of_the_color(
    scene: Scene, image: Image
):
    found = jacobian_of(scene, image, "lights", "roughness", "albedo", "specular")
    (block,) = found.blocks()
    assert block.pixels == slice(0, len(image.color))
    diffuse = brdf.K_DIFFUSE / np.pi * image.albedo
    gloss = brdf.K_SPECULAR * image.c_spec[:, None]
    for channel in range(3):
        wanted = diffuse[:, channel, None] * image.terms.diffuse + gloss * image.terms.specular
        np.testing.assert_allclose(block.lights[channel], wanted, rtol=1e-5)
        # All lights at their radiance are the picture.
        lit = block.lights[channel] @ image.radiance[:, channel]
        np.testing.assert_allclose(lit, image.color[:, channel], rtol=1e-4)
    np.testing.assert_allclose(block.gloss, brdf.K_SPECULAR * image.specular)
    np.testing.assert_allclose(
        block.dense[..., -1].T, gloss * image.terms.specular_by_roughness, rtol=1e-5
    )
    assert block.texels is not None
    looked_up = block.texels @ scene.state.specular.ravel()
    np.testing.assert_allclose(looked_up, image.c_spec, rtol=1e-5)
    # The first mode of the albedo brightens everything by a fifth.
    np.testing.assert_allclose(block.dense[..., 0].T, 0.2 * diffuse * image.diffuse, rtol=1e-4)


def test_an_albedo_at_its_limit_does_not_move(scene: Scene, image: Image):
    white = image.albedo.copy()
    white[::2, 1] = brdf.ALBEDO_MAX
    (before,) = jacobian_of(scene, image, "albedo").blocks()
    (block,) = jacobian_of(scene, replace(image, albedo=white), "albedo").blocks()
    assert not block.dense[1, ::2].any()
    np.testing.assert_array_equal(block.dense[:, 1::2], before.dense[:, 1::2])
    np.testing.assert_array_equal(block.dense[0], before.dense[0])


def test_pixels_come_in_blocks_of_a_size(scene: Scene, image: Image):
    found = jacobian_of(scene, image, "roughness")
    count = len(image.color)
    sizes = [block.pixels for block in found.blocks(100)]
    assert sizes == [slice(at, min(at + 100, count)) for at in range(0, count, 100)]
    assert count % 100 and all(
        block.dense.shape == (3, block.pixels.stop - block.pixels.start, 1)
        and block.texels is None
        and block.lights.shape[2] == 0
        for block in found.blocks(100)
    )


def test_a_mode_that_moves_nothing_seen_or_beside_it_has_no_column(scene: Scene, image: Image):
    """Of the mouth alone, the brows are not seen."""
    layout, state = Layout(scene.state), scene.state
    mouth = image.surface.part(np.flatnonzero(image.surface.pixels[:, 1] > 66))
    terms = scene.forward.light_terms(
        state, mouth, scene.stage, 2, 3, Asked(by_surface=True, by_roughness=True)
    )
    part = scene.forward.shade(state, mouth, terms)
    active = layout.mask(("identity", "expression"))
    found = Jacobian(scene.forward, state, part, layout, active)
    every = Jacobian(scene.forward, state, part, layout, active, all_columns=True)
    brows = layout.slices["expression"].start + 2
    assert set(every.dense_columns) - set(found.dense_columns) == {brows}
    assert found.unseen == 1 and every.unseen == 0
    (one,), (other,) = found.blocks(), every.blocks()
    place = int(np.flatnonzero(every.dense_columns == brows)[0])
    assert np.abs(other.dense[..., place]).max() < 1e-6 * np.abs(other.dense).max()
    np.testing.assert_allclose(one.dense, np.delete(other.dense, place, axis=2), rtol=1e-6)


def test_a_light_that_turns_changes_its_own_part_of_the_color(scene: Scene, image: Image):
    layout, random = Layout(scene.state), np.random.default_rng(2)
    shape = (len(image.color), 2, 2)
    positions = PositionDerivatives(
        np.array([1, 4]), random.normal(size=shape), random.normal(size=shape)
    )
    active = layout.mask(("light_position",))
    active[layout.slices["light_position"]] = [0, 0, 1, 0, 0, 0, 0, 0, 1, 1, 0, 0]
    found = Jacobian(scene.forward, scene.state, image, layout, active, positions=positions)
    assert len(found.dense_columns) == 3
    (block,) = found.blocks()
    # The first angle of light 1, then both of light 4.
    for column, (light, which, axis) in enumerate([(1, 0, 0), (4, 1, 0), (4, 1, 1)]):
        diffuse = brdf.K_DIFFUSE / np.pi * image.albedo * positions.diffuse[:, which, axis, None]
        gloss = brdf.K_SPECULAR * image.c_spec * positions.specular[:, which, axis]
        wanted = image.radiance[light] * (diffuse + gloss[:, None])
        bound = 1e-6 * np.abs(wanted).max()
        np.testing.assert_allclose(block.dense[..., column].T, wanted, rtol=1e-5, atol=bound)

"""The color of the hair above a face: told from a wall behind it, a hat and a bald head."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.camera import Camera
from facestage.fit.textures.albedo_detail import albedo_detail
from facestage.fit.textures.hair_color import DARKEST, hair_over_skin, in_color_of_hair
from facestage.fit.textures.hair_shade import bared, hair_shade
from reference.painted_face import FOCAL, SIDE, PaintedFace, painted_face

SKIN = np.array([0.40, 0.25, 0.17])
BROWN, BLOND, BLACK = (0.09, 0.055, 0.035), (0.25, 0.15, 0.07), (0.012, 0.011, 0.011)
LIGHT = np.array([0.8, 0.7, 0.5])  # warm, and not as strong on hair


@pytest.fixture(scope="module")
def face(renderer: str) -> PaintedFace:
    """Farther away, so that all of the head is seen."""
    near = painted_face(texels=128)
    camera = Camera(SIDE, SIDE, 0.6 * FOCAL, (SIDE / 2, SIDE / 2))
    return replace(near, state=replace(near.state, camera=camera))


@pytest.fixture(scope="module")
def shade(face: PaintedFace) -> np.ndarray:
    return hair_shade(face.forward.geometry)


@pytest.fixture(scope="module")
def above(face: PaintedFace, shade: np.ndarray) -> np.ndarray:
    """(h, w) bool, where the head has hair, and above it."""
    y, x = np.mgrid[:SIDE, :SIDE]
    pixels = np.stack([x.ravel(), y.ravel()], axis=1) + 0.5
    surface = face.forward.surface(face.state, pixels)
    hairy = np.ones((SIDE, SIDE), bool)
    column, row = np.floor(surface.pixels).astype(int).T
    hairy[row, column] = surface.of_vertices(shade).mean(axis=1) < -0.1
    return hairy


def found(
    face: PaintedFace,
    shade: np.ndarray,
    above: np.ndarray,
    hair: tuple[float, float, float] | np.ndarray,
    bald: bool = False,
    skin: np.ndarray = SKIN,
    exposure: float = 1.0,
) -> np.ndarray | None:
    """Of a photo with skin below, and ``hair`` (3,) or of each pixel ``above``."""
    color = np.where(above[..., None], np.array(hair), skin) * LIGHT * exposure
    return hair_over_skin(
        face.forward.geometry,
        face.state,
        shade,
        color,
        np.where(above & (not bald), 0.0, 1.0),
        np.ones((SIDE, SIDE), bool),
        SKIN,
    )


def test_redder_cheeks_do_not_color_the_hair(
    face: PaintedFace, shade: np.ndarray, above: np.ndarray
):
    skin = np.broadcast_to(SKIN, (SIDE, SIDE, 3)).copy()
    skin[SIDE * 7 // 16 :] *= [1.3, 0.8, 0.8]
    over_skin = found(face, shade, above, BROWN, skin=skin)
    assert over_skin is not None
    np.testing.assert_allclose(SKIN * np.exp(over_skin), BROWN, rtol=1e-6)


@pytest.mark.parametrize("hair", [BROWN, BLOND])
def test_hair_has_its_own_color(
    face: PaintedFace, shade: np.ndarray, above: np.ndarray, hair: tuple[float, float, float]
):
    over_skin = found(face, shade, above, hair)
    assert over_skin is not None
    np.testing.assert_allclose(SKIN * np.exp(over_skin), hair, rtol=1e-6)


def test_hair_is_no_darker_and_no_bluer_than_hair_on_a_scalp(
    face: PaintedFace, shade: np.ndarray, above: np.ndarray
):
    over_skin = found(face, shade, above, (0.009, 0.011, 0.014))
    assert over_skin is not None
    red, green, blue = SKIN * np.exp(over_skin)
    assert red > green > blue
    assert np.log((red + green + blue) / SKIN.sum()) == pytest.approx(DARKEST)


@pytest.mark.parametrize("exposure", [1.0, 1e-6])
def test_black_in_one_channel_is_no_hue(
    face: PaintedFace, shade: np.ndarray, above: np.ndarray, exposure: float
):
    """Brown hair in warm light, whose blue a photo has clipped; and whatever the unit of light."""
    over_skin = found(face, shade, above, (0.13, 0.08, 0.0), exposure=exposure)
    assert over_skin is not None
    red, green, blue = SKIN * np.exp(over_skin)
    assert red > green > blue > green / 4
    assert red + green + blue == pytest.approx(0.21)


def test_in_no_channel_it_is_lighter_than_skin(
    face: PaintedFace, shade: np.ndarray, above: np.ndarray
):
    over_skin = found(face, shade, above, (0.19, 0.19, 0.19))  # grey
    assert over_skin is not None
    assert over_skin.max() == 0.0 and over_skin[0] < -0.5


@pytest.mark.parametrize(
    "hat", [(0.6, 0.55, 0.5), (0.05, 0.08, 0.25), (0.3, 0.02, 0.02), (0.05, 0.15, 0.05)]
)
def test_a_hat_is_no_hair(
    face: PaintedFace, shade: np.ndarray, above: np.ndarray, hat: tuple[float, float, float]
):
    assert found(face, shade, above, hat) is None


def test_a_bald_head_and_one_that_the_photo_cuts_off_have_none(
    face: PaintedFace, shade: np.ndarray, above: np.ndarray
):
    assert found(face, shade, above, BROWN, bald=True) is None
    cut = replace(face.state, camera=replace(face.state.camera, principal_px=(SIDE / 2, -SIDE / 4)))
    assert found(replace(face, state=cut), shade, above, BROWN) is None


@pytest.mark.parametrize("wall", [(0.3, 0.9), (0.001, 0.003)])
def test_a_wall_behind_the_hair_is_none_of_it(
    face: PaintedFace, shade: np.ndarray, above: np.ndarray, wall: tuple[float, float]
):
    colors = np.broadcast_to(BROWN, (SIDE, SIDE, 3)).copy()
    colors[:, : SIDE * 45 // 100] = np.random.default_rng(0).uniform(*wall, (SIDE, 72, 3))
    over_skin = found(face, shade, above, colors)
    assert over_skin is not None
    np.testing.assert_allclose(SKIN * np.exp(over_skin), BROWN, rtol=1e-6)


def test_on_the_head_hair_is_dense_where_the_models_is(face: PaintedFace, shade: np.ndarray):
    over_skin = np.log(np.array(BLACK) / SKIN)
    colored = in_color_of_hair(shade, over_skin)
    densest = shade.mean(axis=1).argmin()
    np.testing.assert_allclose(colored[densest], over_skin)
    assert not colored[shade.mean(axis=1) == 0].any()


def test_where_skin_is_seen_none_grows_and_all_else_has_its_color(shade: np.ndarray):
    """A photo of the model, bare where its hair begins, as tests of its shade have it."""
    face = painted_face(texels=128)
    geometry, atlas = face.forward.geometry, face.atlas
    bare = bared(geometry, face.surface, np.ones(len(face.surface.pixels)), shade)
    shown = face.shown(face.photo(atlas.bake(bare))[0])
    plain = albedo_detail(atlas, shown, None, geometry=geometry)
    colored = albedo_detail(atlas, shown, None, geometry=geometry, hair_seen=lambda own: 2.0 * own)
    assert plain.hair is not None and colored.hair is not None
    assert plain.tone is not None and colored.tone is not None
    np.testing.assert_allclose(colored.hair, 2.0 * plain.hair, atol=1e-9)
    back = geometry.mean[:, 2] < np.percentile(geometry.mean[:, 2], 20)
    assert shade[back].min() < -0.5
    np.testing.assert_allclose((colored.tone - plain.tone)[back], shade[back], atol=0.1)

"""Creases: dark lines of a photo are found, moles, brows' edges and plain shading are none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.fit.forward.shading import sample_bilinear
from facestage.fit.textures.albedo_detail import CREASE_PAINTED, albedo_detail
from facestage.fit.textures.creases import crease_depth
from reference.painted_face import PaintedFace, painted_face

DEPTH = 0.5


def pictured(side: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels of a square; distance from a slanted line of 0.3 of its side, and from a point, as
    shares of the side.
    """
    y, x = np.mgrid[:side, :side] + 0.5
    pixels = np.stack([x.ravel(), y.ravel()], axis=1)
    u, v = (pixels / side - [0.35, 0.4]).T
    along, across = 0.8 * u + 0.6 * v, -0.6 * u + 0.8 * v
    line = np.hypot(np.maximum(np.abs(along) - 0.15, 0), across)
    return pixels, line, np.hypot(u - 0.35, v - 0.3)


@pytest.mark.parametrize("side", [100, 400])
def test_a_dark_line_is_a_crease_and_a_mole_is_none(side: int):
    pixels, line, mole = pictured(side)
    light = np.exp(0.3 * pixels[:, :1] / side) * np.array([0.6, 0.4, 0.3])
    photo = light * np.exp(-DEPTH * ((line < 0.015) | (mole < 0.02)))[:, None]
    found = crease_depth(pixels, photo, light.mean(axis=0) * np.ones_like(light), float(side))
    on, spot = np.median(found[line < 0.005]), found[mole < 0.02].max()
    plain = found[(line > 0.05) & (mole > 0.05)].max()
    print(f"side {side}: on the line {on:.3f} (true {DEPTH}), mole {spot:.3f}, plain {plain:.3f}")
    assert on == pytest.approx(DEPTH, abs=0.12)
    assert spot < 0.1 and plain < 0.03


@pytest.fixture(scope="module")
def face(renderer: str) -> PaintedFace:
    return painted_face(texels=512)


def test_a_crease_is_painted_in_part_and_in_the_skins_hue(face: PaintedFace):
    """A brown line over a cheek: what is left in the albedo is paler, and not brown."""
    brown = DEPTH * np.array([-0.6, -1.0, -1.4])
    points = [(0.032 - 0.0045 * k, -0.02 + 0.003 * k, 0.01) for k in range(-3, 4)]
    spots = [face.uv_blob(face.atlas.size, point, 0.0025) for point in points]
    line = np.max(spots, axis=0)
    photo, _ = face.photo(line[..., None] * brown.astype(np.float32))
    shown = face.shown(photo)
    depth = crease_depth(face.surface.pixels, photo, shown.image.color, 110.0)
    there = sample_bilinear(line, shown.uvs) > 0.8
    left = {}
    for name, crease in (("as pigment", np.zeros(len(photo))), ("as a crease", depth)):
        found = albedo_detail(face.atlas, replace(shown, crease=crease), None).log_albedo
        left[name] = sample_bilinear(found, shown.uvs)[there].mean(axis=0)
        print(name, left[name].round(3), "depth", np.median(depth[there]).round(3))
    pigment, crease = left["as pigment"], left["as a crease"]
    assert crease.mean() / pigment.mean() == pytest.approx(CREASE_PAINTED, abs=0.2)
    assert np.ptp(crease) < 0.4 * np.ptp(pigment)


def test_hue_at_the_rim_is_that_of_the_skin(face: PaintedFace):
    """Green light of a wall tints the skin that it grazes, and no other skin."""
    surface = face.surface
    cosine = -np.einsum("px,px->p", surface.normals, surface.rays)
    plain, _ = face.photo()
    rim = np.clip(1 - cosine / 0.5, 0, 1)[:, None]
    shown = face.shown(plain * np.exp(0.3 * rim * np.array([-1.0, 1.0, 0.0])))
    found = sample_bilinear(albedo_detail(face.atlas, shown, None).log_albedo, shown.uvs)
    grazed = (cosine > 0.1) & (cosine < 0.3)
    green = found[grazed, 1].mean() - found[grazed, 0].mean()
    told = 0.6 * rim[grazed].mean()
    print(f"green at the rim {green:.3f} of {told:.3f}")
    assert green < 0.15 * told

"""What is finer than light could paint, on a painted face whose light is not believed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.fit.forward.shading import sample_bilinear
from facestage.fit.textures.albedo_detail import albedo_detail
from facestage.fit.textures.fine_detail import departures, fine_detail
from reference.painted_face import PaintedFace, painted_face

WRINKLES = 0.8  # depth of log albedo


@pytest.fixture(scope="module")
def face(renderer: str) -> PaintedFace:
    return painted_face(texels=512, key_side=0.3)


def wrinkles(face: PaintedFace) -> np.ndarray:
    """(S, S) log albedo of dark lines 16 mm apart, across the face."""
    place = face.atlas.bake(face.forward.geometry.mean.astype(np.float32))
    return np.where(
        face.atlas.skin, -WRINKLES * np.maximum(np.cos(2 * np.pi * place[..., 1] / 0.016), 0.0), 0.0
    ).astype(np.float32)


def test_wrinkles_show_where_nothing_is_believed_of_the_light(face: PaintedFace):
    """A photo darker by half than the fit thinks, all of it in doubt."""
    lines = wrinkles(face)
    photo, _ = face.photo(np.repeat(lines[..., None], 3, axis=2))
    shown = replace(face.shown(0.5 * photo), doubt=np.full(len(photo), 300.0))
    found = albedo_detail(face.atlas, shown, None, geometry=face.forward.geometry)
    uvs = face.forward.uvs(face.surface)
    there, true = (
        departures(face.surface.pixels, each[:, None], np.ones(len(uvs)), shown.face_px)[:, 0]
        for each in (
            sample_bilinear(found.log_albedo.mean(axis=2), uvs),
            sample_bilinear(lines, uvs),
        )
    )
    facing = -np.einsum("px,px->p", face.surface.normals, face.surface.rays) > 0.8
    alike = float(np.corrcoef(there[facing], true[facing])[0, 1])
    strength = float(there[facing] @ true[facing] / (true[facing] @ true[facing]))
    print(f"lines: correlation {alike:.2f}, {strength:.2f} of their depth")
    assert alike > 0.75 and 0.2 < strength < 1.1
    # Its tone is not known for all that: several photos are not averaged by it.
    assert found.seen.mean() < 0.01
    sure = albedo_detail(face.atlas, face.shown(photo), None, geometry=face.forward.geometry)
    assert sure.seen.mean() > 0.1


@pytest.mark.parametrize("clipped", [1, 2, 3])
def test_channels_that_are_not_clipped_show_them(face: PaintedFace, clipped: int):
    lines = wrinkles(face)
    photo, _ = face.photo(np.repeat(lines[..., None], 3, axis=2))
    photo[:, :clipped] = photo[:, :clipped].max()
    shown = replace(
        face.shown(0.5 * photo),
        doubt=np.full(len(photo), 300.0),
        clipped=np.repeat((np.arange(3) < clipped)[None], len(photo), axis=0),
    )
    fine, clear = fine_detail(shown, None)
    true = sample_bilinear(lines, shown.uvs)
    there = shown.clear > 0.8
    if clipped == 3:
        assert not clear.any()
        return
    alike = float(np.corrcoef(fine[there].mean(axis=1), true[there])[0, 1])
    print(f"correlation {alike:.2f}, {clear[there].mean():.2f} clear")
    assert alike > 0.75 and clear[there].mean() > 0.3
    assert np.abs(fine[there] - fine[there].mean(axis=1, keepdims=True)).max() < 0.151


def test_even_gloss_hides_none(face: PaintedFace):
    """As on dark skin, which shines as much as any other."""
    lines = wrinkles(face)
    photo, _ = face.photo(np.repeat(lines[..., None], 3, axis=2))
    plain = face.shown(photo)
    gloss = 0.5 * float((plain.diffuse * plain.albedo).mean())
    strength = []
    for added in (0.0, gloss):
        matte = replace(plain.image, specular=np.full_like(photo, added))
        image = replace(matte, color=matte.skin.radiance(matte.diffuse, matte.specular))
        shine = image.skin.gloss(image.specular)
        shown = replace(plain, image=image, photo=photo + shine, doubt=np.full(len(photo), 300.0))
        fine, _ = fine_detail(shown, None)
        strength.append(float(np.std(fine[shown.clear > 0.8].mean(axis=1))))
    print(strength)
    assert strength[1] > 0.85 * strength[0]


def test_a_wrong_light_is_not_painted(face: PaintedFace):
    photo, _ = face.photo()
    y = face.surface.pixels[:, 1]
    shade = 1.0 - 0.6 * (y - y.min()) / np.ptp(y)
    shown = replace(face.shown(shade[:, None] * photo), doubt=np.full(len(photo), 300.0))
    found = albedo_detail(face.atlas, shown, None)
    there = sample_bilinear(found.log_albedo.mean(axis=2), face.forward.uvs(face.surface))
    slope = np.polyfit(np.log(shade), there, 1)[0]
    print(f"{slope:.3f} of a shade over the whole face is painted")
    assert abs(slope) < 0.1


def test_a_shadow_in_another_place_is_no_wrinkle():
    """The sharp shadow of the nose, three pixels beside where the fit has it."""
    face = painted_face(texels=256)
    photo, _ = face.photo()
    column, row = (face.surface.pixels - face.surface.pixels.min(axis=0)).astype(int).T
    picture = np.full((row.max() + 1, column.max() + 4, 3), np.nan)
    picture[row, column] = photo
    moved = picture[row, column + 3]
    moved = np.where(np.isfinite(moved), moved, photo)
    shown = replace(face.shown(moved), doubt=np.full(len(photo), 300.0), shift_px=3)
    found = albedo_detail(face.atlas, shown, None)
    there = sample_bilinear(found.log_albedo.mean(axis=2), face.forward.uvs(face.surface))
    wrong = np.log(np.maximum(moved, 1e-4) / np.maximum(photo, 1e-4)).mean(axis=1)
    edge = np.abs(wrong) > 0.3
    print(
        f"{edge.sum()} pixels are off by {np.abs(wrong[edge]).mean():.2f}, painted: "
        f"{np.abs(there[edge]).mean():.3f}"
    )
    assert edge.sum() > 100 and np.abs(there[edge]).mean() < 0.12 * np.abs(wrong[edge]).mean()


def test_departures_are_what_is_left_of_the_mean_of_clear_neighbors():
    y, x = np.mgrid[:60, :80]
    pixels = np.stack([x.ravel(), y.ravel()], axis=1) + 0.5
    clear = (pixels[:, 0] < 60).astype(float)
    spot = np.where((x == 20) & (y == 30), 1.0, 0.0).ravel()
    values = np.stack([np.full(len(spot), 3.0), 3.0 + spot, np.where(clear > 0, 3.0, 99.0)], axis=1)
    found = departures(pixels, values, clear, 100.0)[clear > 0]
    np.testing.assert_allclose(found[:, 0], 0.0, atol=1e-5)
    np.testing.assert_allclose(found[:, 2], 0.0, atol=1e-5)
    assert found[spot[clear > 0] > 0, 1] > 0.95
    # Of a large photo every second pixel is looked at: the same millimetres count.
    coarse = departures(2 * pixels, values, clear, 200.0)[clear > 0]
    np.testing.assert_allclose(coarse, found, atol=1e-6)

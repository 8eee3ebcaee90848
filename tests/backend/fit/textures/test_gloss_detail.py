"""Specular and roughness maps of a face with known patches."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.contract import brdf
from facestage.fit.forward.reflectance import by_c_spec
from facestage.fit.forward.shading import sample_bilinear
from facestage.fit.textures.atlas import Atlas
from facestage.fit.textures.gloss_detail import GlossStep, gloss_beyond, gloss_seen, gloss_step
from facestage.fit.textures.shown import Shown
from reference.painted_face import C_SPEC, ROUGHNESS, PaintedFace, painted_face

TEXELS = 64
FOREHEAD = 0.05  # metres above the centre of the face


@pytest.fixture(scope="module")
def face(renderer: str) -> PaintedFace:
    return painted_face(texels=128, key_side=0.15)


def highlight(face: PaintedFace) -> tuple[float, float, float]:
    """The middle of what the key light makes shine on the forehead, metres."""
    _, plain = face.photo()
    at = face.surface.points - face.state.translation
    gloss = np.where(at[:, 1] > FOREHEAD, plain.specular.reshape(len(at), -1).mean(axis=1), 0.0)
    x, y, z = np.median(at[np.argsort(-gloss)[:40]], axis=0)
    return float(x), float(y), float(z)


def step(face: PaintedFace, shown: Shown, held: str = "") -> GlossStep:
    image = shown.image
    by_specular = brdf.K_SPECULAR * image.specular * (held != "specular")
    by_roughness = (
        brdf.K_SPECULAR
        * image.c_spec[:, None]
        * image.terms.specular_by_roughness
        * (held != "roughness")
    )
    return gloss_step(
        Atlas.build(face.forward.geometry, TEXELS).skin, shown, by_specular, by_roughness
    )


def test_a_shiny_patch_is_found(face: PaintedFace):
    patch = face.uv_blob(TEXELS, highlight(face), 0.02)
    photo, _ = face.photo(specular=0.4 * patch)
    found = step(face, face.shown(photo))
    inside, known = found.specular[patch > 0.9].mean(), found.specular_known[patch > 0.9].mean()
    outside = np.abs(found.specular[patch == 0]).mean()
    print(
        f"c_spec + {inside:.2f} in the patch (true 0.4), {outside:.3f} outside; known to "
        f"{known:.2f}"
    )
    # What is not known of it stays plain.
    assert inside == pytest.approx(0.4 * known, abs=0.1) and outside < 0.03
    assert known > 0.75
    assert np.abs(found.roughness).max() < 0.06


def test_a_rough_patch_is_found_under_a_strong_light(face: PaintedFace):
    patch = face.uv_blob(TEXELS, highlight(face), 0.025)
    photo, _ = face.photo(roughness=0.08 * patch)
    found = step(face, face.shown(photo))
    inside, known = found.roughness[patch > 0.9].mean(), found.roughness_known[patch > 0.9].mean()
    outside = np.abs(found.roughness[patch == 0]).mean()
    print(
        f"roughness + {inside:.3f} in the patch (true 0.08), {outside:.4f} outside; known to "
        f"{known:.2f}"
    )
    assert 0.03 < inside < 0.11 and outside < 0.01
    assert ROUGHNESS + found.roughness.min() > 0.3


def test_nothing_new_is_found_in_the_model_s_own_picture(face: PaintedFace):
    photo, _ = face.photo()
    found = step(face, face.shown(photo))
    assert np.abs(found.specular).max() < 1e-3 and np.abs(found.roughness).max() < 1e-3
    assert found.specular_known.min() >= 0 and found.specular_known.max() <= 1


@pytest.mark.parametrize("held", ["specular", "roughness"])
def test_a_held_map_stays_exactly(face: PaintedFace, held: str):
    patch = face.uv_blob(TEXELS, highlight(face), 0.02)
    photo, _ = face.photo(specular=0.4 * patch, roughness=0.05 * patch)
    found = step(face, face.shown(photo), held)
    kept, other = (
        (found.specular, found.roughness)
        if held == "specular"
        else (found.roughness, found.specular)
    )
    assert not kept.any() and np.abs(other).max() > 0.01


@pytest.mark.parametrize("level", [0.0, 1e4])
def test_black_and_white_photos_give_numbers(face: PaintedFace, level: float):
    found = step(face, face.shown(np.full((len(face.surface.pixels), 3), level)))
    assert np.isfinite(found.specular).all() and np.isfinite(found.roughness).all()


def test_changed_gloss_is_the_picture_that_is_traced_again(face: PaintedFace):
    patch = face.uv_blob(TEXELS, highlight(face), 0.02)
    traced, plain = face.photo(specular=0.3 * patch, roughness=0.02 * patch)
    shown = face.shown(plain.color)
    at = sample_bilinear(patch, shown.uvs)
    changed = shown.with_gloss(0.3 * at, 0.02 * at)
    error, change = np.abs(changed.image.color - traced), np.abs(traced - plain.color)
    print(f"to first order, {error.sum() / change.sum():.3f} of the change is missed; 0.1 allowed")
    assert error.sum() < 0.1 * change.sum()
    np.testing.assert_allclose(
        changed.diffuse * changed.albedo + changed.specular, changed.image.color, rtol=1e-6
    )


def test_gloss_ends_where_what_is_seen_ends(face: PaintedFace):
    """A highlight at the border of the seen half is not drawn out over the other."""
    place = face.surface.of_vertices(face.forward.geometry.mean)
    there = face.uv_blob(TEXELS, highlight(face), 0.02)
    photo, plain = face.photo(specular=0.5 * there)
    border = place[np.argmax(plain.specular.sum(axis=1)), 0]
    clear = (place[:, 0] > border).astype(float)
    shown = face.shown(photo, clear=clear)
    texels = Atlas.build(face.forward.geometry, TEXELS)
    found = gloss_step(texels.skin, shown, by_c_spec(shown.image.specular), 0 * photo)
    seen = gloss_seen(texels.skin, shown)
    x = texels.bake(face.forward.geometry.mean)[..., 0]
    for side, least, most in ((clear > 0, 0.95, 1.0), (place[:, 0] < border - 0.015, 0.0, 0.2)):
        at = sample_bilinear(seen, shown.uvs[side])
        print(f"seen {at.mean():.2f} on {side.mean():.2f} of the face")
        assert least <= at.mean() <= most
    unseen = texels.skin & (x < border - 0.015)
    before, after = (np.abs(step.specular[unseen]).sum() for step in (found, found.within(seen)))
    print(f"drawn out over the unseen: {before:.2f}, then {after:.2f}")
    assert after < 0.4 * before


def test_gloss_that_outshines_the_photo_goes(face: PaintedFace):
    """Of a black brow, which is of hair and not of skin; and of nothing else."""
    patch = face.uv_blob(TEXELS, highlight(face), 0.02)
    dark = face.uv_blob(face.atlas.size, highlight(face), 0.02)
    black, plain = face.photo(-4.0 * dark[..., None] * np.ones(3), -C_SPEC * patch)
    texels = Atlas.build(face.forward.geometry, TEXELS).skin
    found = gloss_beyond(texels, face.shown(black))
    inside, outside = found[patch > 0.99].mean(), found[patch == 0]
    print(f"{inside:.2f} of the gloss goes in the patch, at most {outside.max():.2f} outside")
    assert inside > 0.7 and np.abs(outside).mean() < 0.01
    assert gloss_beyond(texels, face.shown(plain.color)).max() < 0.01

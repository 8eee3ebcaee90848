"""Albedo detail of a painted face: moles, hidden halves, misplaced shadows and highlights."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.fit.forward.shading import sample_bilinear
from facestage.fit.textures.albedo_detail import HUE_VARIES, albedo_detail
from facestage.fit.textures.atlas import Atlas
from facestage.fit.textures.doubts import Doubts, pigment_share
from facestage.fit.textures.symmetry import mirrored_texels
from reference.painted_face import PaintedFace, moved_by_a_pixel, painted_face

MOLE = (0.042, -0.015, -0.01)


@pytest.fixture(scope="module")
def face(renderer: str) -> PaintedFace:
    return painted_face(texels=512)


@pytest.fixture(scope="module")
def half_mirror(face: PaintedFace) -> np.ndarray:
    half = Atlas.build(face.forward.geometry, face.atlas.size // 2)
    return mirrored_texels(half, face.forward.geometry)


def brows(face: PaintedFace) -> np.ndarray:
    """(S, S, 3) log albedo: two dark stripes above the eyes and a rosy mouth, the same on both
    sides.
    """
    size = face.atlas.size
    dark = sum(
        face.uv_blob(size, (sign * x, 0.082, 0.0), 0.006)
        for x in (0.02, 0.03, 0.04)
        for sign in (-1, 1)
    )
    rosy = face.uv_blob(size, (0.0, -0.034, 0.01), 0.02)
    return -0.5 * np.minimum(dark, 1)[..., None] * np.ones(3) - 0.25 * rosy[..., None] * np.array(
        [0.2, 1.0, 0.8]
    )


def hues(face: PaintedFace) -> np.ndarray:
    """(S, S, 3) log albedo: waves from red to blue."""
    place = face.atlas.bake(face.forward.geometry.mean.astype(np.float32))
    wave = np.sin(place[..., 0] / 0.012) * np.cos(place[..., 1] / 0.012)
    return wave[..., None] * np.array([1.0, -0.2, -0.8])


def test_a_mole_stays_on_its_side(face: PaintedFace, half_mirror: np.ndarray):
    spot = face.uv_blob(face.atlas.size, MOLE, 0.008)
    photo, _ = face.photo(-0.4 * spot[..., None] * np.ones(3))
    found = albedo_detail(face.atlas, face.shown(photo), half_mirror)
    there = found.log_albedo[spot > 0.99].mean()
    twin = face.uv_blob(face.atlas.size, (-MOLE[0], *MOLE[1:]), 0.008)
    mirrored = found.log_albedo[(twin > 0.99) & found.seen]
    print(f"mole {there:.3f} (true -0.4), on the other side {mirrored.mean():.3f}")
    assert there == pytest.approx(-0.4, abs=0.1) and abs(mirrored.mean()) < 0.04
    alone = albedo_detail(face.atlas, face.shown(photo), None)
    assert not alone.mirrored.any()
    change = np.abs(found.log_albedo - alone.log_albedo)[found.seen]
    assert change.mean() < 0.005


# Of the logarithm, beside the model's lips: as photographed, of which one has next to no green.
LIPSTICKS = [(-0.5, -2.2, -1.4), (0.1, -1.2, -0.5), (-0.5, -3.0, -1.6)]


def lips_found(
    face: PaintedFace,
    change: tuple[float, ...],
    light: tuple[float, ...] = (0, 0, 0),
    skin: np.ndarray | float = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """(3,) log albedo that a photo of lips whose log albedo is changed, in light that is another by
    so much, adds to them, with landmarks that know them, and without. ``skin``: log albedo of the
    rest.
    """
    lips = np.minimum(face.uv_blob(face.atlas.size, (0.0, -0.034, 0.01), 0.012), 1.0)
    photo, _ = face.photo(lips[..., None] * np.array(change) + (1 - lips[..., None]) * skin)
    shown = face.shown(photo * np.exp(light))
    there = sample_bilinear(lips, shown.uvs)
    results = []
    for known in (there, np.zeros_like(there)):
        # As a model says whose lips are painted.
        shown = replace(shown, lips=known, feature=0.4 * there)
        found = albedo_detail(face.atlas, shown, None).log_albedo
        results.append(found[lips == 1].mean(axis=0))
    return results[0], results[1]


@pytest.mark.parametrize("change", LIPSTICKS)
def test_lips_are_as_red_as_they_are_made_up(face: PaintedFace, change: tuple[float, ...]):
    painted = np.array(change) / np.square(change).sum()
    found, without = lips_found(face, change)
    print(f"lipstick {change}: {found.round(2)}, without landmarks {without.round(2)}")
    assert 0.7 < found @ painted < 1.1 and without @ painted < min(0.75, 0.85 * found @ painted)
    assert found[0] == pytest.approx(change[0], abs=0.2)


def test_lips_may_have_colors_that_skin_has_not(face: PaintedFace):
    found, _ = lips_found(face, LIPSTICKS[1])
    mottled, without = lips_found(face, LIPSTICKS[1], skin=0.5 * hues(face))
    print(f"lipstick {found.round(2)}, beside mottled skin {mottled.round(2)}, {without.round(2)}")
    assert mottled[0] - mottled[1] > 0.9 * (found[0] - found[1]) > 2 * (without[0] - without[1])


def test_lips_that_are_not_made_up_are_as_the_rest_of_the_face(face: PaintedFace):
    found, without = lips_found(face, (-0.1, -0.35, -0.2))
    assert found == pytest.approx(without, abs=1e-9)


def test_red_light_is_no_lipstick(face: PaintedFace):
    """Which the fit lacks: it is on the skin, too."""
    found, without = lips_found(face, (0, 0, 0), (0.4, -0.6, -0.6))
    assert found == pytest.approx(without, abs=1e-9)


def test_nothing_makes_lips_blue(face: PaintedFace):
    found, without = lips_found(face, (-1.6, -1.0, 0.4))
    assert found == pytest.approx(without, abs=1e-9)
    assert found[2] - found.mean() < 0.6


def test_the_hidden_half_is_completed_from_the_other(face: PaintedFace, half_mirror: np.ndarray):
    truth = brows(face)
    photo, _ = face.photo(truth)
    place = face.atlas.bake(face.forward.geometry.mean.astype(np.float32))
    clear = (face.surface.points[:, 0] > 0).astype(float)
    shown = face.shown(photo, clear)
    hidden = face.atlas.skin & (place[..., 0] < -0.012) & (np.abs(truth).max(axis=2) > 0.05)
    errors = {}
    for name, mirror in (("without", None), ("with", half_mirror)):
        detail = albedo_detail(face.atlas, shown, mirror)
        errors[name] = np.sqrt(((detail.log_albedo - truth)[hidden] ** 2).mean())
    print(
        f"log albedo of the hidden half, RMS: {errors['with']:.3f} with symmetry, "
        f"{errors['without']:.3f} without"
    )
    assert errors["with"] < 0.7 * errors["without"]
    # The labels say which is which.
    assert detail.mirrored[hidden].mean() > 0.9 and detail.seen[hidden].mean() < 0.03
    shows = face.atlas.skin & (place[..., 0] > 0.012) & (np.abs(truth).max(axis=2) > 0.05)
    assert detail.seen[shows].mean() > 0.9 and not (detail.seen & detail.mirrored).any()
    behind = face.atlas.skin & (place[..., 2] < -0.12)
    assert (
        np.abs(detail.log_albedo[behind]).max() < 1e-3
        and not (detail.seen | detail.mirrored)[behind].any()
    )


def test_misplaced_shadows_and_highlights_are_not_painted(face: PaintedFace):
    """A fit that is off by a pixel: what it paints must not look like the edges of the shadow or
    the highlights.
    """
    shifted = moved_by_a_pixel(face)
    common = replace(
        face, surface=face.forward.surface(shifted, face.surface.pixels, only_fitted=True)
    )
    common = replace(
        common, surface=face.forward.surface(face.state, common.surface.pixels, only_fitted=True)
    )
    photo, _ = common.photo()
    pixels = {tuple(p): n for n, p in enumerate(common.surface.pixels)}
    surface = face.forward.surface(shifted, common.surface.pixels, only_fitted=True)
    rows = np.array([pixels[tuple(p)] for p in surface.pixels])
    off = replace(face, state=shifted, surface=surface)
    photo = photo[rows]
    shown = off.shown(photo)
    gloss = shown.specular.mean(axis=1)
    strong = gloss > 0.3 * (shown.diffuse * shown.albedo).mean(axis=1)
    edge = shown.change_over_shift(shown.diffuse.mean(axis=1)) > 0.5 * np.median(shown.diffuse)

    def painted(doubts: Doubts) -> tuple[float, float, float]:
        detail = albedo_detail(face.atlas, shown, None, doubts).log_albedo.mean(axis=2)
        amount = sample_bilinear(detail, shown.uvs)
        return (
            float(np.abs(amount).mean()),
            float(np.corrcoef(np.abs(amount), edge)[0, 1]),
            float(np.corrcoef(amount, strong)[0, 1]),
        )

    found, naive = painted(Doubts()), painted(Doubts(0.0, 0.0, 0.0))
    print(
        f"painted {found[0]:.4f} (without doubt {naive[0]:.4f}); correlation with the shadow's "
        f"edge {found[1]:.2f} ({naive[1]:.2f}), with the highlights {found[2]:.2f} ({naive[2]:.2f})"
    )
    assert strong.sum() > 20 and edge.sum() > 50
    assert found[0] < 0.6 * naive[0] and found[1] < min(naive[1], 0.3) and abs(found[2]) < 0.2


def test_skin_is_of_no_more_hues_than_skin_has(face: PaintedFace):
    """In a photo whose colors were made stronger, or whose light is of another color in each
    place.
    """
    pattern = hues(face)
    shares, spreads = {}, {}
    for strength in (0.06, 0.5):
        photo, _ = face.photo(strength * pattern)
        found = albedo_detail(face.atlas, face.shown(photo), None)
        hue = (found.log_albedo - found.log_albedo.mean(axis=2, keepdims=True))[found.seen]
        true = strength * pattern[found.seen]
        shares[strength] = float((hue * true).sum() / (true**2).sum())
        spreads[strength] = float(np.sqrt((hue**2).sum(axis=1).mean()))
    print(f"shares of the hue that are painted {shares}, which varies by {spreads}")
    assert shares[0.06] > 0.2 and shares[0.5] < 0.5 * shares[0.06]
    assert spreads[0.5] < 1.1 * HUE_VARIES


def test_what_light_a_shadow_has_does_not_color_the_skin(face: PaintedFace):
    """A patch that was lifted out of it is bluer than the rest."""
    patch = face.uv_blob(face.atlas.size, (0.0, 0.05, 0.0), 0.02)
    photo, _ = face.photo(0.1 * patch[..., None] * np.array([-1.0, 0.0, 1.0]))
    bluer = {}
    for depth in (0.0, 1.0):
        shown = face.shown(photo)
        shown = replace(shown, lifted=np.full_like(shown.lifted, depth))
        found = albedo_detail(face.atlas, shown, None).log_albedo[(patch > 0.99)].mean(axis=0)
        bluer[depth] = found[2] - found[0]
    print(f"bluer by {bluer} (0.2 in the photo)")
    assert bluer[0.0] > 0.04 and bluer[1.0] < 0.3 * bluer[0.0]


@pytest.mark.parametrize("level", [0.0, 1.0, 1e4])
def test_black_and_white_photos_give_numbers(
    face: PaintedFace, half_mirror: np.ndarray, level: float
):
    shown = face.shown(np.full((len(face.surface.pixels), 3), level))
    if level:
        shown = replace(shown, clipped=np.ones(shown.photo.shape, bool))
    found = albedo_detail(face.atlas, shown, half_mirror)
    assert np.isfinite(found.log_albedo).all()
    if level:
        assert not found.log_albedo.any() and not found.seen.any() and not found.mirrored.any()


def test_what_may_be_shading_is_not_painted_unless_it_is_too_large_for_that():
    small, large, none = np.full(3, 0.05), np.full(3, 1.0), np.zeros(3)
    sure, doubtful = np.full(3, 0.005), np.full(3, 0.2)
    assert (pigment_share(small, sure, none) > 0.9).all()
    assert (pigment_share(small, doubtful, none) < 0.2).all()
    assert (pigment_share(large, doubtful, none) > 0.8).all()
    # Beside a highlight, darker is pigment sooner than brighter.
    half = np.full(3, 0.3)
    assert (pigment_share(half, none, doubtful) < pigment_share(-half, none, doubtful) - 0.2).all()

"""The tone of unseen skin on a painted face: it is that of the skin seen, without its features."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.fit.textures.albedo_detail import albedo_detail
from facestage.fit.textures.unseen_tone import unseen_tone
from reference.painted_face import PaintedFace, painted_face

OLIVE = np.array([-0.1, 0.02, -0.08])  # log albedo


@pytest.fixture(scope="module")
def face(renderer: str) -> PaintedFace:
    return painted_face(texels=512)


def tone_of(face: PaintedFace, target: np.ndarray, feature: np.ndarray | None = None) -> np.ndarray:
    count = len(face.surface.pixels)
    plain = np.zeros(count)
    return unseen_tone(
        face.forward.geometry,
        face.surface,
        target,
        np.ones(count),
        plain if feature is None else feature,
    )


def test_one_tone_is_that_of_the_whole_skin_and_of_nothing_else(face: PaintedFace):
    geometry = face.forward.geometry
    tone = tone_of(face, np.tile(OLIVE, (len(face.surface.pixels), 1)))
    skin = np.zeros(len(geometry.mean), bool)
    skin[geometry.triangles[geometry.triangle_part == 0]] = True
    np.testing.assert_allclose(tone[skin], np.tile(OLIVE, (skin.sum(), 1)), atol=1e-9)
    assert (tone[~skin] == 0).all() and (~skin).any()


def test_the_unseen_follows_what_is_next_to_it(face: PaintedFace):
    """An olive right cheek: so is the right ear, the left one is not, the back is between."""
    geometry = face.forward.geometry
    place = np.einsum("pi,pix->px", face.surface.weights, geometry.mean[face.surface.corners])
    tone = tone_of(face, np.where(place[:, :1] < 0, OLIVE, 0.0))[:, 0] / OLIVE[0]
    beside = np.abs(geometry.mean[:, 1] - np.median(place[:, 1])) < 0.03
    x, z = geometry.mean[:, 0], geometry.mean[:, 2]
    reached = np.abs(x).max()
    right, left = (tone[beside & (side * x > 0.9 * reached)].mean() for side in (-1, 1))
    back = tone[beside & (z < np.percentile(z, 3))].mean()
    print(f"share of olive: right ear {right:.2f}, left ear {left:.2f}, back {back:.2f}")
    assert right > 0.6 and left < 0.4
    assert left < back < right


def test_brows_and_lips_give_no_tone(face: PaintedFace):
    dark = face.surface.pixels[:, 1] < np.percentile(face.surface.pixels[:, 1], 20)
    target = np.where(dark[:, None], -1.0, 0.0) * np.ones(3)
    plain, told = (
        np.abs(tone_of(face, target, feature)).max() for feature in (None, np.where(dark, 1.0, 0.0))
    )
    print(f"darkest tone: {told:.3f}, of the same as plain skin {plain:.3f}")
    assert plain > 0.5 and told < 0.3 * plain


def test_the_border_of_what_is_seen_does_not_show(face: PaintedFace):
    """The photo's skin differs from the model's: without a tone the albedo steps where the photo
    ends.
    """
    photo, _ = face.photo(np.tile(OLIVE.astype(np.float32), (*face.atlas.skin.shape, 1)))
    shown = face.shown(photo)
    geometry = face.forward.geometry
    steps = {}
    for name, surface in (("without", None), ("with", geometry)):
        found = albedo_detail(face.atlas, shown, None, geometry=surface)
        unseen = face.atlas.skin & ~found.seen
        steps[name] = np.abs(found.log_albedo[unseen] - OLIVE).mean()
    print(f"unseen from the photo's tone: {steps['with']:.4f}, without {steps['without']:.4f}")
    assert steps["with"] < 0.02 < 0.05 < steps["without"]
    # What is seen stays as it is.
    found, before = (albedo_detail(face.atlas, shown, None, geometry=g) for g in (geometry, None))
    change = np.abs(found.log_albedo - before.log_albedo)[found.seen]
    print(f"seen: changed by {change.mean():.4f}")
    assert change.mean() < 0.01


def test_nothing_seen_is_no_tone(face: PaintedFace):
    nothing = replace(face.surface, pixels=face.surface.pixels)
    tone = unseen_tone(
        face.forward.geometry,
        nothing,
        np.ones((len(nothing.pixels), 3)),
        np.zeros(len(nothing.pixels)),
        np.zeros(len(nothing.pixels)),
    )
    assert not tone.any()

"""Pale patches of light that the fit lacks leave the albedo; spots and beards do not."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.fit.textures.albedo_detail import albedo_detail
from facestage.fit.textures.light_rest import LIGHTER, light_rest
from reference.painted_face import PaintedFace, painted_face

FOREHEAD = (0.0, 0.05, 0.0)


@pytest.fixture(scope="module")
def face(renderer: str) -> PaintedFace:
    return painted_face(texels=512)


def blob(face: PaintedFace, radius: float) -> np.ndarray:
    """(P,) 0..1 within ``radius`` metres of a place on the forehead."""
    place = face.surface.of_vertices(face.forward.geometry.mean)
    middle = place[np.linalg.norm(place - FOREHEAD, axis=1).argmin()]
    return np.clip(1.5 - np.linalg.norm(place - middle, axis=1) / radius, 0.0, 1.0)


def rest(face: PaintedFace, target: np.ndarray) -> np.ndarray:
    count = len(target)
    gray = np.repeat(target[:, None], 3, axis=1)
    return light_rest(face.forward.geometry, face.surface, gray, np.ones(count), np.zeros(count))


def test_a_wide_pale_patch_is_light_and_a_spot_is_skin(face: PaintedFace):
    wide, spot = blob(face, 0.02), blob(face, 0.0025)
    left = {
        name: (0.4 - rest(face, 0.4 * there)[there > 0.99]).mean()
        for name, there in (("patch", wide), ("spot", spot))
    }
    print(f"left of 0.4 lighter: {left}")
    assert left["patch"] < 0.25 < 0.35 < left["spot"]


def test_what_varies_as_skin_does_stays(face: PaintedFace):
    there = blob(face, 0.02)
    assert rest(face, 0.5 * LIGHTER * there).max() < 0.1 * LIGHTER
    np.testing.assert_allclose(rest(face, np.full(len(there), 0.3)), 0.0, atol=1e-9)


def test_what_is_dark_stays(face: PaintedFace):
    """A beard on a fifth of the face; bare skin beside it hardly counts as light."""
    dark = face.surface.pixels[:, 1] > np.percentile(face.surface.pixels[:, 1], 80)
    found = rest(face, np.where(dark, -0.5, 0.0))
    assert found[dark].max() < 1e-3 and found.max() < 0.06


def test_without_seen_skin_there_is_none(face: PaintedFace):
    target = np.ones((len(face.surface.pixels), 3))
    nothing = np.zeros(len(target))
    assert not light_rest(face.forward.geometry, face.surface, target, nothing, nothing).any()


def test_the_albedo_has_less_of_it(face: PaintedFace):
    there = face.uv_blob(face.atlas.size, FOREHEAD, 0.02)
    photo, _ = face.photo(0.35 * there[..., None] * np.ones(3, np.float32))
    found = albedo_detail(face.atlas, face.shown(photo), None, geometry=face.forward.geometry)
    left = found.log_albedo[(there > 0.99) & found.seen].mean()
    print(f"left of 0.35: {left:.3f}")
    assert 0.05 < left < 0.2

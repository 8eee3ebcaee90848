"""The maps of several photos: eyes and teeth are as those photos have them that show them."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.contract.face_model import EYES, SKIN, TEETH
from facestage.fit.forward.rendering import Textures
from facestage.fit.textures.merged_maps import MergedMaps
from facestage.fit.textures.refine import Refined
from reference.painted_face import PaintedFace, painted_face

SIZE = 128


@pytest.fixture(scope="module")
def face(renderer: str) -> PaintedFace:
    return painted_face(texels=SIZE, key_side=0.3)


def maps(value: float, told: frozenset[int]) -> Refined:
    """Of one lightness."""
    albedo = np.full((SIZE, SIZE, 3), value, np.float32)
    flat = np.full((SIZE // 2, SIZE // 2), 0.5, np.float32)
    coverage = np.zeros((SIZE, SIZE, 3), np.uint8)
    return Refined(Textures(albedo, flat, flat), coverage, albedo[:8, :8].copy(), told=told)


def merged(face: PaintedFace, told: list[frozenset[int]]) -> tuple[float, float, float]:
    """Albedo of eyes, of their picture and of teeth, where the first photo has 0.1 and the second,
    which is four times as large, 0.4.
    """
    geometry = face.forward.geometry
    together = MergedMaps(geometry, SIZE, geometry.log_albedo)
    for value, weight, own in zip((0.1, 0.4), (0.25, 1.0), told, strict=True):
        together.add(maps(value, own), face.state, weight)
    found = together.maps()
    assert found.told == told[0] | told[1] and found.eyes is not None
    assert found.textures.albedo.dtype == np.float32
    shown = np.full((SIZE, SIZE), SKIN)
    shown[face.atlas.covered] = geometry.triangle_part[face.atlas.triangle]
    eyes, teeth = (found.textures.albedo[shown == part] for part in (EYES, TEETH))
    for each in (eyes, teeth, found.eyes):
        assert each.size and each.std() < 1e-4
    return eyes.mean(), found.eyes.mean(), teeth.mean()


def test_those_that_show_them_decide(face: PaintedFace):
    nothing, eyes, both = frozenset[int](), frozenset({EYES}), frozenset({EYES, TEETH})
    mean = 0.1**0.2 * 0.4**0.8
    for told, wanted in (
        ([both, both], (mean, mean, mean)),
        ([nothing, nothing], (mean, mean, mean)),
        ([both, nothing], (0.1, 0.1, 0.1)),
        ([eyes, both], (mean, mean, 0.4)),
    ):
        np.testing.assert_allclose(merged(face, told), wanted, rtol=1e-3)

"""The model's shade of hair: off where the photo shows skin, as it is elsewhere, soft between."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.face_model import SKIN
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.textures.albedo_detail import albedo_detail, albedo_observations
from facestage.fit.textures.hair_shade import bared, hair_shade
from reference.painted_face import PaintedFace, painted_face


@pytest.fixture(scope="module")
def face(renderer: str) -> PaintedFace:
    return painted_face(texels=512)


@pytest.fixture(scope="module")
def scalp(face: PaintedFace) -> np.ndarray:
    geometry = face.forward.geometry
    return geometry.new_index[geometry.model.regions["scalp"]]


def off(face: PaintedFace, seen: np.ndarray | None = None) -> np.ndarray:
    """(vertices,) by how much skin is lighter where ``seen`` pixels show it; None: all."""
    weight = np.ones(len(face.surface.pixels)) if seen is None else seen.astype(float)
    geometry = face.forward.geometry
    return bared(geometry, face.surface, weight, hair_shade(geometry)).mean(axis=1)


def test_hair_goes_from_seen_temples_and_stays_on_the_back(face: PaintedFace, scalp: np.ndarray):
    geometry, lighter = face.forward.geometry, off(face)
    logs = geometry.log_albedo.mean(axis=1)
    skin = np.median(logs[geometry.fitted_vertices])
    seen = np.intersect1d(scalp, face.surface.corners[face.surface.normals[:, 2] > 0.4])
    back = scalp[geometry.mean[scalp, 2] < np.percentile(geometry.mean[scalp, 2], 30)]
    print(
        f"darker than skin: temples {skin - logs[seen].mean():.2f}, then "
        f"{skin - (logs + lighter)[seen].mean():.2f}; back {skin - logs[back].mean():.2f}"
    )
    assert len(seen) > 5 and skin - logs[seen].mean() > 0.3
    assert skin - (logs + lighter)[seen].mean() < 0.2
    np.testing.assert_allclose(lighter[back], 0.0, atol=1e-2)


def test_brows_cheeks_and_ears_stay_as_they_are(face: PaintedFace, scalp: np.ndarray):
    geometry, lighter = face.forward.geometry, off(face)
    assert (lighter >= 0).all()
    for name in ("brows", "lips", "narrow_face"):
        index = geometry.new_index[geometry.model.regions[name]]
        far = index[geometry.mean[index, 1] < geometry.mean[scalp, 1].min()]
        assert not lighter[far].any(), name


def test_a_side_that_no_photo_shows_keeps_its_hairline(face: PaintedFace, scalp: np.ndarray):
    geometry = face.forward.geometry
    x = face.surface.of_vertices(geometry.mean)[:, 0]
    lighter = off(face, x > 0)
    side = geometry.mean[scalp, 0]
    assert lighter[scalp[side > 0.02]].max() > 0.3
    np.testing.assert_allclose(lighter[scalp[side < -0.03]], 0.0, atol=0.02)


def test_the_hairline_is_soft(face: PaintedFace, scalp: np.ndarray):
    """No edge of the mesh steps by more than those of the model's own hairline."""
    geometry, lighter = face.forward.geometry, off(face)
    edges = geometry.triangles[geometry.triangle_part == SKIN][:, :2]
    on_scalp = edges[np.isin(edges, scalp).all(axis=1)]
    step = np.abs(np.diff(lighter[edges], axis=1)).max()
    own = np.abs(np.diff(geometry.log_albedo.mean(axis=1)[on_scalp], axis=1)).max()
    print(f"step {step:.3f}, the model's own {own:.3f}")
    assert step < own


def test_without_a_scalp_or_seen_skin_nothing_changes(face: PaintedFace):
    geometry = face.forward.geometry
    regions = {name: each for name, each in geometry.model.regions.items() if name != "scalp"}
    plain = FaceGeometry(replace(geometry.model, regions=regions))
    shade = hair_shade(plain)
    assert not shade.any()
    assert not bared(plain, face.surface, np.ones(len(face.surface.pixels)), shade).any()
    assert not off(face, np.zeros(len(face.surface.pixels), bool)).any()


def test_beyond_bare_skin_hair_begins_with_no_pale_rim(face: PaintedFace):
    """A photo of the model, bare where its hair begins: nothing but hair is taken off."""
    geometry, atlas = face.forward.geometry, face.atlas
    shade = hair_shade(geometry)
    bare = bared(geometry, face.surface, np.ones(len(face.surface.pixels)), shade)
    photo, _ = face.photo(atlas.bake(bare))
    shown = face.shown(photo)
    found = albedo_detail(atlas, shown, None, geometry=geometry)
    off_there = bared(geometry, face.surface, albedo_observations(shown)[0], shade)
    tone = found.tone - off_there
    print(f"tone that goes on, at most {np.abs(tone).max():.3f}, bared by {bare.max():.2f}")
    assert np.abs(tone).max() < 0.1 < 0.3 < bare.max()
    assert found.hair is not None
    np.testing.assert_allclose(found.hair, shade + off_there)

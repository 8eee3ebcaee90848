"""The paint of the face model: what is one, and how the photo's own skin takes its place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.face_model import SKIN
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.textures.albedo_detail import albedo_detail
from facestage.fit.textures.painted_features import Paint, painted_features
from reference.painted_face import PaintedFace, painted_face


@pytest.fixture(scope="module")
def face(renderer: str) -> PaintedFace:
    return painted_face(texels=512)


@pytest.fixture(scope="module")
def paint(face: PaintedFace) -> Paint:
    found = painted_features(face.forward.geometry)
    assert found is not None
    return found


def test_brows_are_paint_and_cheeks_are_not(face: PaintedFace, paint: Paint):
    geometry = face.forward.geometry
    skin = np.zeros(len(paint.features), bool)
    skin[geometry.triangles[geometry.triangle_part == SKIN]] = True
    assert not paint.features[~skin].any()
    dark = paint.features.mean(axis=1)
    brow = skin & (np.abs(geometry.mean[:, 1] - 0.045) < 0.025) & (dark < -0.5)
    assert brow.sum() > 30
    assert np.median(np.abs(dark[skin])) < 0.06
    plain = FaceGeometry(
        replace(geometry.model, albedo_mean=np.full_like(geometry.model.albedo_mean, 0.3))
    )
    assert painted_features(plain) is None


def test_a_photo_without_the_models_brows_takes_them_off(face: PaintedFace, paint: Paint):
    """Without stairs or hatching: pixels are coarser than the brow's edge is sharp."""
    atlas = face.atlas
    drawn = atlas.bake(paint.features)
    photo, _ = face.photo(-drawn)
    surface = face.surface
    feature = np.abs(
        np.einsum("pi,pic->pc", surface.weights, paint.features[surface.corners])
    ).mean(axis=1)
    shown = replace(face.shown(photo), feature=feature)
    left = {}
    for name, given in (("model", None), ("bare", paint)):
        found = albedo_detail(atlas, shown, None, paint=given)
        brow = found.seen & (drawn.mean(axis=2) < -0.3)
        logs = (atlas.bake(face.forward.log_albedo(face.state)) + found.log_albedo)[..., 1]
        rough = np.abs(4 * logs - sum(np.roll(logs, k, a) for k in (-1, 1) for a in (0, 1)))
        left[name] = float(rough[brow].mean())
    print("roughness where the brow was", left)
    assert left["bare"] < 0.4 * left["model"]


def test_what_the_photo_does_not_show_keeps_the_models_paint(face: PaintedFace, paint: Paint):
    photo, _ = face.photo()
    shown = face.shown(photo, clear=np.zeros(len(photo)))
    found = albedo_detail(face.atlas, shown, None, paint=paint)
    assert not found.log_albedo.any()


def test_brows_that_are_the_models_stay_as_sharp(face: PaintedFace, paint: Paint):
    photo, _ = face.photo()
    found = albedo_detail(face.atlas, face.shown(photo), None, paint=paint)
    drawn = face.atlas.bake(paint.features).mean(axis=2)
    brow = found.seen & (drawn < -0.3)
    assert brow.sum() > 100
    changed = np.abs(found.log_albedo.mean(axis=2))[brow]
    print(f"changed by {changed.mean():.3f}, at most {changed.max():.3f}")
    assert changed.mean() < 0.05


def test_what_is_taken_off_is_what_the_photo_lacks_there(face: PaintedFace, paint: Paint):
    """The brow of one side is lighter by half, the other is as it is drawn."""
    surface, left = face.surface, face.forward.geometry.mean[:, 0] > 0
    half = paint.features * np.where(left, 0.5, 0.0)[:, None]
    residual = -np.einsum("pi,pic->pc", surface.weights, half[surface.corners])
    taken = paint.contradicted(surface, residual, np.ones(len(residual)))
    strong = np.flatnonzero(paint.features.mean(axis=1) < -0.5)
    far = np.abs(face.forward.geometry.mean[strong, 0]) > 0.03
    share = taken[strong[far]].mean(axis=1) / paint.features[strong[far]].mean(axis=1)
    np.testing.assert_allclose(share, np.where(left[strong[far]], 0.5, 0.0), atol=0.05)

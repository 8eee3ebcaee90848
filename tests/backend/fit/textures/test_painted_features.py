"""The paint of the face model: what is one, and how the photo's own skin takes its place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.face_model import SKIN
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.textures.albedo_detail import albedo_detail
from facestage.fit.textures.painted_features import painted_features
from reference.painted_face import PaintedFace, painted_face


@pytest.fixture(scope="module")
def face(renderer: str) -> PaintedFace:
    return painted_face(texels=512)


@pytest.fixture(scope="module")
def paint(face: PaintedFace) -> np.ndarray:
    found = painted_features(face.forward.geometry)
    assert found is not None
    return found


def test_brows_are_paint_and_cheeks_are_not(face: PaintedFace, paint: np.ndarray):
    geometry = face.forward.geometry
    skin = np.zeros(len(paint), bool)
    skin[geometry.triangles[geometry.triangle_part == SKIN]] = True
    assert not paint[~skin].any()
    dark = paint.mean(axis=1)
    brow = skin & (np.abs(geometry.mean[:, 1] - 0.045) < 0.025) & (dark < -0.5)
    assert brow.sum() > 30
    assert np.median(np.abs(dark[skin])) < 0.06
    plain = FaceGeometry(
        replace(geometry.model, albedo_mean=np.full_like(geometry.model.albedo_mean, 0.3))
    )
    assert painted_features(plain) is None


def test_a_photo_without_the_models_brows_takes_them_off(face: PaintedFace, paint: np.ndarray):
    """Without stairs or hatching: pixels are coarser than the brow's edge is sharp."""
    atlas = face.atlas
    drawn = atlas.bake(paint)
    photo, _ = face.photo(-drawn)
    surface = face.surface
    feature = np.abs(np.einsum("pi,pic->pc", surface.weights, paint[surface.corners])).mean(axis=1)
    shown = replace(face.shown(photo), feature=feature)
    left = {}
    for name, given in (("model", None), ("bare", paint)):
        found = albedo_detail(atlas, shown, None, painted=given)
        brow = found.seen & (drawn.mean(axis=2) < -0.3)
        logs = (atlas.bake(face.forward.log_albedo(face.state)) + found.log_albedo)[..., 1]
        rough = np.abs(4 * logs - sum(np.roll(logs, k, a) for k in (-1, 1) for a in (0, 1)))
        left[name] = float(rough[brow].mean())
    print("roughness where the brow was", left)
    assert left["bare"] < 0.4 * left["model"]


def test_what_the_photo_does_not_show_keeps_the_models_paint(face: PaintedFace, paint: np.ndarray):
    photo, _ = face.photo()
    shown = face.shown(photo, clear=np.zeros(len(photo)))
    found = albedo_detail(face.atlas, shown, None, painted=paint)
    assert not found.log_albedo.any()

"""Stubble on a scalp that a model shades: about as dark as the shade, nowhere else, without seams,
without gloss.
"""

from __future__ import annotations

import numpy as np
import pytest

from facestage.fit.textures.hair_shade import hair_shade
from facestage.fit.textures.merged_maps import MergedMaps
from facestage.fit.textures.stubble import MATTE, grow_stubble, matted, noise_at
from reference.painted_face import PaintedFace, painted_face

SEAM_MM = 0.25  # texels that show places so near to each other show nearly one place


@pytest.fixture(scope="module")
def face(renderer: str) -> PaintedFace:
    return painted_face(texels=512)


@pytest.fixture(scope="module")
def shade(face: PaintedFace) -> np.ndarray:
    return hair_shade(face.forward.geometry)


def grown(face: PaintedFace, shade: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(S, S, 3) log albedo before and after stubble."""
    even = face.atlas.bake(face.forward.geometry.log_albedo)
    stubbled = even.copy()
    grow_stubble(stubbled, face.atlas, face.forward.geometry, shade)
    return even, stubbled


def test_it_is_as_dark_as_the_shade_and_only_where_it_is(face: PaintedFace, shade: np.ndarray):
    even, stubbled = grown(face, shade)
    there = face.atlas.bake(shade).min(axis=2)
    dense = face.atlas.covered & (there < 0.8 * there.min())
    mean = np.exp(stubbled[dense]).mean(axis=0) / np.exp(even[dense]).mean(axis=0)
    spread = (stubbled - even)[dense].std(axis=0)
    print(f"{dense.sum()} texels, mean {mean}, spread of log albedo {spread}")
    assert dense.sum() > 10000
    np.testing.assert_allclose(mean, 1.0, atol=0.02)
    assert (spread > 0.1).all() and np.isfinite(stubbled).all()
    none = face.atlas.covered & (there > -1e-4)
    np.testing.assert_array_equal(stubbled[none], even[none])


def test_both_sides_of_a_seam_show_the_same(face: PaintedFace, shade: np.ndarray):
    """One place of the scalp that two charts of the atlas show has one darkness."""
    from scipy.spatial import cKDTree

    even, stubbled = grown(face, shade)
    places = face.atlas.bake(face.forward.geometry.mean)
    hairy = face.atlas.covered & (face.atlas.bake(shade).min(axis=2) < -0.3)
    column = np.nonzero(hairy)[1]
    pairs = cKDTree(places[hairy]).query_pairs(SEAM_MM / 1000, output_type="ndarray")
    apart = np.abs(column[pairs[:, 0]] - column[pairs[:, 1]]) > 20
    change = (stubbled - even)[hairy].mean(axis=1)
    one, other = change[pairs[apart]].T
    print(f"{apart.sum()} pairs, {np.abs(one - other).max():.3f} of {change.std():.3f}")
    assert apart.sum() > 20
    assert np.corrcoef(one, other)[0, 1] > 0.75


def test_without_hair_nothing_changes(face: PaintedFace, shade: np.ndarray):
    even, stubbled = grown(face, np.zeros_like(shade))
    np.testing.assert_array_equal(stubbled, even)
    assert not matted(np.zeros_like(shade)).any()


def test_dense_stubble_is_matt_and_skin_is_not(shade: np.ndarray):
    share = matted(shade)
    assert share.max() == pytest.approx(MATTE)
    assert not share[(shade == 0).all(axis=1)].any()


def test_noise_is_bounded_and_continuous_and_neighbours_tell_nothing():
    rng = np.random.default_rng(3)
    places = rng.uniform(-150, 150, (20000, 3))
    noise = noise_at(places)
    assert np.abs(noise).max() <= 1 and abs(noise.mean()) < 0.02 and 0.2 < noise.std() < 0.5
    assert np.abs(noise_at(places + 0.01) - noise).max() < 0.1
    lattice = np.rint(places)
    for along in np.eye(3):
        assert abs(np.corrcoef(noise_at(lattice), noise_at(lattice + along))[0, 1]) < 0.03


def test_several_photos_show_it_too(face: PaintedFace, shade: np.ndarray):
    from dataclasses import replace

    from facestage.fit.forward.rendering import Textures
    from facestage.fit.textures.refine import Refined

    geometry = face.forward.geometry
    flat = np.full((256, 256), 0.5, np.float32)
    albedo = np.exp(face.atlas.bake(geometry.log_albedo)).astype(np.float32)
    coverage = np.zeros((512, 512, 3), np.uint8)
    given = Refined(Textures(albedo, flat, flat), coverage, hair=shade)
    found = []
    for maps in (given, replace(given, hair=None)):
        merged = MergedMaps(geometry, 512, geometry.log_albedo)
        merged.add(maps, face.state, 1.0)
        found.append(merged.maps().textures.albedo)
    dense = face.atlas.covered & (face.atlas.bake(shade).min(axis=2) < -0.3)
    assert np.log(found[0] / found[1])[dense].std() > 0.1


def test_what_a_photo_shows_bare_stays_bare_among_several(face: PaintedFace, shade: np.ndarray):
    from facestage.contract.result import SEEN
    from facestage.fit.forward.rendering import Textures
    from facestage.fit.textures.refine import Refined

    geometry, atlas = face.forward.geometry, face.atlas
    flat = np.full((256, 256), 0.5, np.float32)
    albedo = np.exp(atlas.bake(geometry.log_albedo - shade)).astype(np.float32)
    shown, hidden = np.zeros((2, 512, 512, 3), np.uint8)
    shown[atlas.skin, 0] = SEEN
    merged = MergedMaps(geometry, 512, geometry.log_albedo)
    merged.add(Refined(Textures(albedo, flat, flat), shown, hair=0 * shade), face.state, 1.0)
    merged.add(Refined(Textures(albedo, flat, flat), hidden, hair=shade), face.state, 1.0)
    found = np.log(merged.maps().textures.albedo)
    dense = atlas.skin & (atlas.bake(shade).min(axis=2) < -0.3)
    places = np.abs(np.diff(found, axis=0)).mean(axis=2)[(dense[1:] & dense[:-1])]
    print(f"from texel to texel {places.mean():.4f}")
    assert places.mean() < 0.02

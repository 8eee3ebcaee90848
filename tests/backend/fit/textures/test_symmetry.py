"""Mirrored texels of the default head against a search over all of them."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.textures.atlas import Atlas
from facestage.fit.textures.symmetry import MIRROR, mirrored_texels, nearest_points


@pytest.fixture(scope="module")
def geometry(renderer: str) -> FaceGeometry:
    from facestage.models.registry import load_model

    return FaceGeometry(load_model("default"))


def test_the_mirrored_texel_is_the_nearest_of_all(geometry: FaceGeometry):
    atlas = Atlas.build(geometry, 128)
    mirror = mirrored_texels(atlas, geometry)
    assert (mirror[~atlas.skin] == -1).all()
    share = (mirror[atlas.skin] >= 0).mean()
    place = atlas.bake(geometry.mean.astype(np.float32)).reshape(-1, 3)
    skin = np.flatnonzero(atlas.skin)
    paired = np.flatnonzero(mirror.ravel() >= 0)
    some = np.random.default_rng(3).choice(paired, 300, replace=False)
    distance = np.linalg.norm(place[skin][None] - (place[some] * MIRROR)[:, None], axis=2)
    found = np.linalg.norm(place[mirror.ravel()[some]] - place[some] * MIRROR, axis=1)
    excess = 1e3 * (found - distance.min(axis=1))
    most = np.percentile(excess, 95)
    print(
        f"{share:.1%} of the skin has a mirror image; 95 % at most {most:.2f} mm farther than "
        "the nearest texel"
    )
    assert share > 0.93 and np.median(excess) < 0.05 and most < 1.0
    # There and back again.
    back = mirror.ravel()[mirror.ravel()[paired]]
    step = np.hypot(*(np.array(divmod(back, 128)) - np.array(divmod(paired, 128))))[back >= 0]
    assert np.percentile(step, 95) <= 1.5


def test_nearest_points_against_all_triangles(geometry: FaceGeometry):
    random = np.random.default_rng(1)
    triangles = geometry.triangles[geometry.fitted]
    chosen = triangles[random.integers(len(triangles), size=60)]
    points = geometry.mean[chosen].mean(axis=1) + 0.0005 * random.normal(size=(60, 3))
    index, weights = nearest_points(points, geometry.mean, triangles)
    found = np.linalg.norm(
        np.einsum("ni,nix->nx", weights, geometry.mean[triangles[index]]) - points, axis=1
    )
    grid = np.array([(i, j, 12 - i - j) for i in range(13) for j in range(13 - i)]) / 12.0
    dense = np.einsum("gi,tix->tgx", grid, geometry.mean[triangles]).reshape(-1, 3)
    brute = np.array([np.sqrt(((dense - point) ** 2).sum(axis=1).min()) for point in points])
    assert (weights >= 0).all() and np.allclose(weights.sum(axis=1), 1)
    assert (found <= brute + 1e-6).mean() > 0.95

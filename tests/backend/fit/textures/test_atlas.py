"""What texels beyond the seams repeat, beside exact distances."""

import numpy as np
from scipy.ndimage import distance_transform_edt

from facestage.fit.textures.atlas import nearest_covered


def test_uncovered_texels_have_the_nearest_covered_one() -> None:
    """Exact within some texels, as far as lookups between texels reach; about so far away."""
    y, x = np.mgrid[:90, :120]
    covered = (np.hypot(y - 40, x - 30) < 22) | ((x > 70) & (y > 20) & (y < 50 + 0.3 * x))
    found = nearest_covered(covered)
    assert found.shape == (int((~covered).sum()),) and covered.ravel()[found].all()
    distance = np.hypot(found // 120 - y[~covered], found % 120 - x[~covered])
    exact = np.asarray(distance_transform_edt(~covered))[~covered]
    near = exact < 8
    np.testing.assert_allclose(distance[near], exact[near], atol=0.2)
    assert near.sum() > 1000 and (distance < 1.06 * exact + 0.2).all()


def test_all_texels_may_be_covered() -> None:
    assert len(nearest_covered(np.ones((8, 8), bool))) == 0

"""Where a mesh bulges: against shapes of known curvature, and its derivatives against
differences.
"""

from __future__ import annotations

import numpy as np
import pytest

from facestage.contract.curvature import Curvature
from facestage.contract.scattering import CURVATURE_MAX
from facestage.fit.face.curvature import MovingCurvature
from facestage.fit.face.geometry import FaceGeometry
from reference.synthetic_face import synthetic_face

COUNT = 24


def grid() -> np.ndarray:
    """(T, 3) triangles of COUNT x COUNT points."""
    index = np.arange(COUNT**2).reshape(COUNT, COUNT)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    return np.concatenate([np.stack([a, b, c], -1), np.stack([b, d, c], -1)]).reshape(-1, 3)


def bowl(radius_x: float, radius_y: float) -> np.ndarray:
    """(P, 3) a piece of 2 cm of a surface with these radii, bulging towards +Z."""
    x, y = np.meshgrid(np.linspace(-0.01, 0.01, COUNT), np.linspace(-0.01, 0.01, COUNT))
    height = -(x**2) / (2 * radius_x) - y**2 / (2 * radius_y)
    return np.stack([x, y, height], axis=-1).reshape(-1, 3)


@pytest.mark.parametrize(
    ("radii", "wanted"), [((0.1, 0.1), 10), ((-0.1, -0.1), -10), ((0.05, np.inf), 10)]
)
def test_it_is_the_mean_of_one_over_the_radii(radii: tuple[float, float], wanted: float):
    points = bowl(*radii)
    middle = (np.abs(points[:, :2]) < 0.005).all(axis=1)
    found = Curvature(grid(), len(points)).of(points)[middle]
    np.testing.assert_allclose(found, wanted, rtol=0.04)


def test_what_is_sharper_than_light_wanders_is_limited():
    points = 0.01 * bowl(0.1, 0.1)
    found = Curvature(grid(), len(points)).of(points)
    assert found.reshape(COUNT, COUNT)[3:-3, 3:-3].min() == CURVATURE_MAX


def test_its_change_is_that_of_differences():
    geometry = FaceGeometry(synthetic_face())
    rng = np.random.default_rng(3)
    count = len(geometry.mean)
    bends = MovingCurvature(geometry.triangles, count)
    moves = rng.normal(size=(3 * count, 2))
    wanted = np.zeros(count, bool)
    wanted[rng.permutation(count)[:40]] = True
    near = np.repeat(bends.around(wanted), 3)

    step = 1e-8
    plus, minus = (
        [geometry.mean + sign * step * moves[:, mode].reshape(-1, 3) for mode in range(2)]
        for sign in (1, -1)
    )
    turned = geometry.normal_operator(geometry.mean, np.ones(count, bool)) @ moves
    normals, lengths = geometry.vertex_normals(geometry.mean)
    found = bends.change(geometry.mean, normals, lengths, wanted, moves[near], turned[near])
    expected = np.stack(
        [
            (geometry.bends.of(a) - geometry.bends.of(b))[wanted] / (2 * step)
            for a, b in zip(plus, minus, strict=True)
        ],
        axis=1,
    )
    assert np.abs(expected).max() > 1
    np.testing.assert_allclose(found, expected, atol=1e-4 * np.abs(expected).max())

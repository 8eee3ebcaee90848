"""Which lights of which pixels are grainy; test_rendering.py looks at what comes of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.fit.forward.penumbras import CHANNELS, NEIGHBORS, Penumbras, box_sums
from facestage.render.light_terms import LightTerms
from reference.synthetic_scene import Scene

SIDE, LINE = 24, 10
x, y = np.mgrid[:SIDE, :SIDE].reshape(2, -1)


@pytest.mark.parametrize("name", ["diffuse", "specular"])
@pytest.mark.parametrize("radiance", [1.0, 0.0])
def test_a_light_that_changes_from_pixel_to_pixel_is_grainy_there(
    scene: Scene, name: str, radiance: float
):
    """Along a line of one light, in what comes from below the skin or from the surface."""
    count = len(scene.stage)
    even = LightTerms(np.full((len(x), count), 0.02, np.float32), np.zeros((len(x), count)))
    uneven = getattr(even, name).copy()
    uneven[(x == LINE) & (y % 2 == 0), 1] += 0.01
    lights = np.ones((2, count))
    lights[:, 1] = radiance
    penumbras = Penumbras(scene.forward, scene.state, scene.stage, lights, 8)
    pixels = np.stack([x, y], axis=1) + 40
    assert not penumbras.grainy(even, pixels).any()
    grainy = penumbras.grainy(replace(even, **{name: uneven}), pixels)
    near = np.abs(x - LINE) <= NEIGHBORS // 2
    np.testing.assert_array_equal(grainy[:, 1], near & (radiance > 0))
    assert not np.delete(grainy, 1, axis=1).any()


@pytest.mark.parametrize("channels", [1, 3, CHANNELS, CHANNELS + 1])
def test_any_number_of_lights_is_summed_over_neighbors(channels: int):
    image = np.random.default_rng(0).random((7, 9, channels)).astype(np.float32)
    wide = np.pad(image, ((1, 1), (1, 1), (0, 0)))
    wanted = sum(wide[i : i + 7, j : j + 9] for i in range(3) for j in range(3))
    np.testing.assert_allclose(box_sums(image, 3), wanted, rtol=1e-5)

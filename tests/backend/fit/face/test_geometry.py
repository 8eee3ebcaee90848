"""Shapes are kept for who asks again, and are the right ones."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.fit.face.geometry import SHAPES_KEPT, FaceGeometry
from reference.synthetic_face import synthetic_face


def test_a_shape_is_that_of_its_weights_whatever_was_asked_before():
    geometry = FaceGeometry(synthetic_face())
    random = np.random.default_rng(0)
    modes = geometry.basis.shape[1]
    asked = random.normal(size=(SHAPES_KEPT + 3, modes)).astype(np.float32)
    for weights in [*asked, *asked[::-1]]:
        found = geometry.vertices(weights[:4], weights[4:])
        wanted = geometry.mean + (geometry.basis @ weights).reshape(-1, 3)
        np.testing.assert_allclose(found, wanted, atol=1e-7)
    assert len(geometry._shapes) == SHAPES_KEPT
    assert geometry.vertices(weights[:4], weights[4:]) is found
    with pytest.raises(ValueError, match="read-only"):
        found[0] = 0

"""Textures painted in the UV square, and polygons on a picture."""

from __future__ import annotations

import numpy as np
import pytest


def test_painted_texture_is_the_interpolated_value() -> None:
    from facestage_blender.pictures.texture import paint_vertices

    uvs = np.array([[0.1, 0.1], [0.9, 0.1], [0.9, 0.9], [0.1, 0.9]])
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    texture = paint_vertices(uvs.astype(np.float32), triangles, uvs, triangles, 64)
    centre = (np.arange(64) + 0.5) / 64
    inside = (centre > 0.1) & (centre < 0.9)
    u, v = np.meshgrid(centre, centre[::-1])
    box = np.ix_(inside, inside[::-1])
    np.testing.assert_allclose(texture[box], np.stack([u, v], -1)[box], atol=1e-6)
    assert texture[0, 0] == pytest.approx([0.1, 0.9], abs=0.02)
    assert (texture > 0).all()

"""Normals of some vertices are those of the whole mesh there."""

from __future__ import annotations

import numpy as np

from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.some_normals import NormalsAt
from reference.synthetic_face import synthetic_face


def test_normals_of_some_vertices_are_those_of_the_whole_mesh():
    geometry = FaceGeometry(synthetic_face())
    random = np.random.default_rng(0)
    shape = geometry.mean + random.normal(0, 1e-3, geometry.mean.shape)
    chosen = np.sort(random.choice(len(geometry.mean), 40, replace=False))
    found = NormalsAt.of(geometry, chosen).at(shape)
    np.testing.assert_allclose(found, geometry.vertex_normals(shape)[0][chosen], atol=1e-12)

"""Normals of some vertices are those of the whole mesh there."""

from __future__ import annotations

import numpy as np

from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.some_normals import NormalsAt
from reference.synthetic_face import synthetic_face


def test_normals_of_some_vertices_are_those_of_the_whole_mesh():
    model = synthetic_face()
    geometry = FaceGeometry(model)
    random = np.random.default_rng(0)
    identity, expression = (
        random.normal(size=len(basis)) for basis in (model.identity_basis, model.expression_basis)
    )
    chosen = np.sort(random.choice(len(geometry.mean), 40, replace=False))
    found = NormalsAt.of(geometry, chosen).at(np.concatenate([identity, expression]))
    whole = geometry.vertex_normals(geometry.vertices(identity, expression))[0]
    np.testing.assert_allclose(found, whole[chosen], atol=1e-5)

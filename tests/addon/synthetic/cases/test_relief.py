"""Displaced heads: heights are what the truth says, and normals those of the heights."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from addon.synthetic.people import person_of, recipe
from facestage.contract.face_model import SKIN, FaceModel
from facestage_blender.synthetic.cases.relief import displaced, height_map
from facestage_blender.synthetic.cases.wrinkled import wrinkled


@pytest.fixture(autouse=True)
def small_maps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("facestage_blender.synthetic.cases.person.HEIGHT_SIZE", 192)


def test_a_person_has_relief_where_the_recipe_says(model: FaceModel) -> None:
    plain = recipe("soft_many")
    usual, bumpy = (person_of(model, replace(plain, relief=each), 5) for each in (False, True))
    assert usual.height is None and bumpy.height is not None
    np.testing.assert_array_equal(usual.albedo, bumpy.albedo)
    np.testing.assert_array_equal(usual.specular, bumpy.specular)
    assert 0.02 < bumpy.height.std() < 0.5 and np.abs(bumpy.height).max() < 3


def test_points_and_normals_are_those_of_the_height(model: FaceModel) -> None:
    height = height_map(model, 512, np.random.default_rng(0))
    flat, bumpy = (displaced(model, model.vertices, each) for each in (0 * height, height))
    for each, other in zip(flat[2:], bumpy[2:], strict=True):
        np.testing.assert_array_equal(each, other)
    points, normals, _, triangles, part = bumpy
    assert len(part) == len(triangles) and (part == SKIN).sum() > 30 * 64
    moved = np.einsum("px,px->p", points - flat[0], flat[1])
    assert 1e-5 < np.abs(moved).max() < 3e-3
    np.testing.assert_allclose(points - flat[0], moved[:, None] * flat[1], atol=1e-9)
    # Against the facets of the displaced mesh, less those of the flat one.
    fine = triangles[(np.abs(moved)[triangles] > 0).all(axis=1)]

    def facets(at: np.ndarray) -> np.ndarray:
        a, b, c = (at[fine[:, corner]] for corner in range(3))
        normal = np.cross(b - a, c - a)
        return normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-20)

    found = (normals - flat[1])[fine].mean(axis=1)
    expected = facets(points) - facets(flat[0])
    alike = (found * expected).sum() / np.sqrt((found**2).sum() * (expected**2).sum())
    print(f"changes of normals {alike:.3f} alike")
    assert alike > 0.8


def test_three_photos_show_one_skin(model: FaceModel) -> None:
    cases = wrinkled()
    assert len(cases) == 6
    of_a = [each for name, each in cases.items() if name.startswith("a_")]
    heights = [person_of(model, one, 3, same).height for one, same in of_a]
    assert all(np.array_equal(heights[0], each) for each in heights[1:])

"""People and recipes for the tests."""

from __future__ import annotations

from typing import Any

import numpy as np

from facestage.contract.face_model import FaceModel

SIZE = 48  # pixels of a photo's side


def person_of(model: FaceModel, chosen: Any, seed: int, same: int | None = None) -> Any:
    """With small textures."""
    from facestage_blender.synthetic.cases import person

    return person.person_of(model, chosen, seed, same, albedo_size=192)


def recipe(name: str):
    from facestage_blender.synthetic.cases.recipe import RECIPES

    return next(recipe for recipe in RECIPES if recipe.name == name)


def landmarks_of(model: FaceModel, vertices: np.ndarray) -> np.ndarray:
    corners, weights = model.landmark_vertices("ibug68")
    return np.einsum("mi,mix->mx", weights, vertices[corners])

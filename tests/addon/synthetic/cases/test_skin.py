"""Skin has the freckles and the beard that the recipe says, where they grow."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from addon.synthetic.people import person_of, recipe
from facestage.contract.face_model import FaceModel


def test_skin_is_what_the_recipe_says(model: FaceModel) -> None:

    plain = recipe("soft_many")
    usual = person_of(model, plain, 5).albedo
    changes: dict[str, dict[str, Any]] = {
        "mottle": {"mottle": 0.12},
        "freckles": {"freckles": True},
        "beard": {"beard": True},
        "shade": {"shade": 0.5},
        "dark": {"melanin": 1.1},
        "light": {"melanin": -0.3},
    }
    changed = {
        name: person_of(model, replace(plain, **change), 5).albedo
        for name, change in changes.items()
    }
    assert changed["mottle"].std() > usual.std()
    assert (changed["freckles"] <= usual).all()
    assert 0.01 < (changed["freckles"] < 0.85 * usual).any(axis=2).mean() < 0.2
    np.testing.assert_allclose(changed["shade"], np.clip(usual * 0.5, 0.005, 0.95), rtol=1e-5)
    assert changed["dark"].mean() < 0.8 * changed["light"].mean()
    assert person_of(model, recipe("oily_skin"), 5).roughness == 0.25


def test_a_beard_grows_around_the_mouth_only(model: FaceModel) -> None:
    from facestage_blender.synthetic.cases.skin import beard_weight

    weight = beard_weight(model)
    assert ((weight >= 0) & (weight <= 1)).all()
    corners, weights = model.landmark_vertices("ibug68")
    at = (weights * weight[corners]).sum(axis=1)
    assert at[[6, 8, 10]].min() > 0.5  # the chin
    assert at[17:].max() < 0.2  # brows, nose, eyes and lips
    eyes = np.concatenate([model.regions["eye_left"], model.regions["eye_right"]])
    assert not weight[eyes].any()

"""People are what their recipes say: a seed is one person, whose photos share the person alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from addon.synthetic.people import person_of, recipe
from facestage.contract.errors import InputError
from facestage.contract.face_model import FaceModel


def test_a_seed_is_one_person_under_one_light(head: FaceModel) -> None:
    from facestage_blender.headless.cases import case_seed

    first, again, other = (
        person_of(head, recipe("freckles"), case_seed("freckles", seed)) for seed in (0, 0, 1)
    )
    for name in ("identity", "expression", "albedo", "specular", "model_to_camera"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
        assert not np.array_equal(getattr(first, name), getattr(other, name))
    np.testing.assert_array_equal(first.stage.position, again.stage.position)
    assert not np.allclose(first.stage.position, other.stage.position)
    assert (
        len({case_seed(name, seed) for name in ("cap", "cap_2", "beard") for seed in range(3)}) == 9
    )


def test_photos_of_one_person_share_the_person_alone(head: FaceModel) -> None:
    from facestage_blender.headless.cases import case_seed, photos

    chosen = photos(2)
    first, second = (
        person_of(head, each, case_seed(f"7/{name}", 0), 7) for name, each in chosen.items()
    )
    other = person_of(head, chosen["photo_1"], case_seed("8/photo_1", 0), 8)
    for name in ("identity", "albedo", "specular", "roughness"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
        assert not np.array_equal(getattr(first, name), getattr(other, name))
    for name in ("expression", "model_to_camera"):
        assert not np.array_equal(getattr(first, name), getattr(second, name))
    for wrong in (0, 9):
        with pytest.raises(InputError, match="expected 1 to 8"):
            photos(wrong)


def test_expressions_are_found_by_either_spelling(head: FaceModel) -> None:
    from facestage_blender.synthetic.cases.person import expression_weights

    wanted = {
        "mouthSmileLeft": 0.5,
        "mouthSmileRight": 0.4,
        "browInnerUp": 0.3,
        "jawOpen": 0.2,
        "tongueOut": 1.0,
    }
    for names, weights in (
        (("jawOpen", "mouthSmileRight", "mouthSmileLeft", "browInnerUp"), (0.2, 0.4, 0.5, 0.3)),
        (("browInnerUp_L", "browInnerUp_R", "mouthSmile_L", "mouthSmile_R"), (0.3, 0.3, 0.5, 0.4)),
    ):
        np.testing.assert_array_equal(
            expression_weights(replace(head, expression_names=names), wanted), weights
        )

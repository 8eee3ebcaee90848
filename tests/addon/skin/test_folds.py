"""Folds in the albedo go as the sliders that pull at them do; Blender needs no script for it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from addon.skin.test_haemoglobin import ALBEDO, shown_albedo
from addon.skin.test_pores import patch
from facestage.contract.folds import PLACES, Folds

RATIO = np.array([0.7, 0.6, 0.5])
PULL = np.array([[2.0, 0.0, -1.0, 0.0], [0.0, 1.25, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]])
FITTED = {"a": 0.7, "b": 0.8, "c": 0.4}


@pytest.fixture
def item(scene: Any) -> Any:
    """A piece of skin with an albedo and four sliders, of which none moves it."""
    from facestage_blender.pictures.images import texture_image

    item = patch(scene)
    item.shape_key_add(name="Basis", from_mix=False)
    for name in "abcd":
        item.shape_key_add(name=name, from_mix=False)
    picture = np.ones((8, 8, 1), np.float32) * ALBEDO.astype(np.float32)
    item.data.materials[0].node_tree.nodes["Albedo"].image = texture_image("Albedo", picture)
    return item


def fold_map() -> Any:
    from facestage_blender.pictures.images import set_color_space, texture_image

    pixels = np.ones((8, 8, 1), np.float32) * RATIO.astype(np.float32)
    image = texture_image("Facestage Folds", pixels)
    set_color_space(image, colored=False)
    return image


def folds(item: Any, *place: float) -> Folds:
    return Folds(np.tile(place, (len(item.data.vertices), 1)), PULL)


def paths(*names: str) -> list[str | None]:
    return [f'key_blocks["{name}"].value' if name else None for name in names]


def shown_with(scene: Any, item: Any, **weights: float) -> np.ndarray:
    import bpy

    for name in "abcd":
        item.data.shape_keys.key_blocks[name].value = weights.get(name, 0.0)
    scene.frame_set(scene.frame_current)
    bpy.context.view_layer.update()
    return shown_albedo(scene, item)


def test_albedo_is_what_the_contract_says(scene: Any, item: Any) -> None:
    from facestage_blender.skin.folds import give_folds, take_folds

    given = folds(item, 0.6, 0.3, 0.1)
    for _ in range(2):  # the second time in the first one's place
        give_folds(item, fold_map(), given, paths(*"abcd"))
    tree = item.data.materials[0].node_tree
    assert all(each.driver.is_simple_expression for each in tree.animation_data.drivers)
    for weights in (FITTED, {}, {"a": 0.3, "b": 0.4, "c": 0.2}, {"a": 1.0}, {"b": 1.0, "c": 1.0}):
        gone = given.gone(np.array([weights.get(name, 0.0) for name in "abcd"]))[0]
        # Of the third place no slider pulls: its folds stay.
        wanted = ALBEDO * RATIO ** -(gone - 0.1)
        np.testing.assert_allclose(shown_with(scene, item, **weights), wanted, rtol=4e-3)
    take_folds(item)
    np.testing.assert_allclose(shown_with(scene, item), ALBEDO, rtol=2e-3)
    assert not len(tree.animation_data.drivers)
    assert not [each for each in tree.nodes if "old" in each.name]
    assert not [one for one in item.data.attributes if one.name.startswith("facestage_")]


def test_with_blood_on_top_both_count_in_any_order(scene: Any, item: Any) -> None:
    from facestage_blender.skin.folds import give_folds, take_folds
    from facestage_blender.skin.haemoglobin import give_haemoglobin, take_haemoglobin, weight_path

    give_folds(item, fold_map(), folds(item, 1.0, 0.0, 0.0), paths(*"abcd"))
    everywhere = np.ones((1, len(item.data.vertices)))
    (tree,) = give_haemoglobin(item, everywhere, np.full(3, -0.2))
    path, axis = weight_path(0)
    tree.path_resolve(path.removesuffix(".default_value")).default_value[axis] = 1.0
    both = ALBEDO / RATIO * np.exp(-0.2)
    np.testing.assert_allclose(shown_with(scene, item), both, rtol=4e-3)
    take_folds(item)
    np.testing.assert_allclose(shown_with(scene, item), ALBEDO * np.exp(-0.2), rtol=4e-3)
    take_haemoglobin(item)
    np.testing.assert_allclose(shown_with(scene, item), ALBEDO, rtol=4e-3)


@pytest.mark.parametrize("missing", ["slider", "picture", "folds", "vertices"])
def test_what_cannot_be_followed_stays_as_it_is_painted(
    scene: Any, item: Any, missing: str
) -> None:
    from facestage_blender.skin.folds import give_folds

    given, picture = folds(item, 1.0, 0.0, 0.0), fold_map()
    if missing == "vertices":
        given = Folds(np.ones((3, len(PLACES))), PULL)
    names = paths("", "b", "c", "d") if missing == "slider" else paths(*"abcd")
    give_folds(
        item,
        None if missing == "picture" else picture,
        None if missing == "folds" else given,
        names,
    )
    np.testing.assert_allclose(shown_with(scene, item), ALBEDO, rtol=2e-3)

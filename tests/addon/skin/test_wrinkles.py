"""Wrinkles whose normal maps follow sliders: their slopes add up as the sliders say."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from addon.skin.test_pores import patch, shown_slopes

TILTS = {"first": np.array([0.2, 0.0]), "second": np.array([0.0, -0.1])}  # by u and v


def flat_map(name: str, tilt: np.ndarray) -> Any:
    """A normal map that is tilted alike everywhere."""
    from facestage_blender.pictures.images import set_color_space, texture_image

    normal = np.array([*tilt, 1.0]) / np.sqrt(1.0 + tilt @ tilt)
    pixels = np.ones((8, 8, 1), np.float32) * (0.5 + 0.5 * normal).astype(np.float32)
    image = texture_image(f"Facestage Wrinkles {name}", pixels)
    set_color_space(image, colored=False)
    return image


@pytest.fixture
def item(scene: Any) -> Any:
    """A piece of skin with four sliders, of which none moves it."""
    item = patch(scene)
    item.shape_key_add(name="Basis", from_mix=False)
    for name in "abcd":
        item.shape_key_add(name=name, from_mix=False)
    return item


def driven(item: Any) -> list[Any]:
    from facestage_blender.skin.wrinkles import DrivenWrinkles

    keys = item.data.shape_keys
    paths = {name: f'key_blocks["{name}"].value' for name in "abcd"}
    sliders = {"first": [paths["a"], paths["b"]], "second": [paths["c"]]}
    return [
        DrivenWrinkles(name, flat_map(name, tilt), keys, sliders[name])
        for name, tilt in TILTS.items()
    ]


def middle(slopes: np.ndarray) -> np.ndarray:
    """(2,) tilt of the normals, to the right and upwards."""
    return -slopes[60:-60, 60:-60].mean(axis=(0, 1))


@pytest.mark.parametrize("pores", ["none", "before", "after"])
def test_slopes_follow_the_sliders(scene: Any, item: Any, pores: str) -> None:
    import bpy

    from facestage_blender.skin.material import bend_normals
    from facestage_blender.skin.pores import give_pores, remove_pores
    from facestage_blender.skin.wrinkles import give_wrinkles, take_wrinkles

    (material,), blocks = item.data.materials, item.data.shape_keys.key_blocks
    if pores == "before":
        give_pores(item)
    for _ in range(2):  # the second time in the first one's place
        give_wrinkles(item, driven(item))
    if pores == "after":
        give_pores(item)
    if pores != "none":  # they lie on top, and go without them
        assert "Pores" in material.node_tree.nodes
        remove_pores(item)
    for weights in ((1.0, 0.0, 0.0), (0.5, 1.0, 1.0), (0.0, 0.0, 0.0)):
        for name, weight in zip("abc", weights, strict=True):
            blocks[name].value = weight
        scene.frame_set(scene.frame_current)
        bpy.context.view_layer.update()
        wanted = 0.5 * (weights[0] + weights[1]) * TILTS["first"] + weights[2] * TILTS["second"]
        np.testing.assert_allclose(middle(shown_slopes(scene, item)), wanted, atol=8e-3)
    # On top of what a result's own normal map says, and still there when that goes.
    blocks["c"].value = 1.0
    bpy.context.view_layer.update()
    own = np.array([-0.1, 0.05])
    for image, wanted in ((flat_map("own", own), own + TILTS["second"]), (None, TILTS["second"])):
        bend_normals(material, image)
        np.testing.assert_allclose(middle(shown_slopes(scene, item)), wanted, atol=8e-3)
    take_wrinkles(item)
    tree = material.node_tree
    assert not tree.nodes["Facestage Skin"].inputs["Normal"].is_linked
    assert not [node for node in tree.nodes if node.name.startswith("Wrinkles")]
    assert tree.animation_data is None or not len(tree.animation_data.drivers)
    assert not {f"Facestage Wrinkles {name}" for name in TILTS} & set(bpy.data.images.keys())

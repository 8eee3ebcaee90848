"""Brow hair and a film's blood both change the albedo on its way to the skin: they come and go in
any order.
"""

from __future__ import annotations

from itertools import permutations
from typing import Any

import numpy as np
import pytest

from addon.skin.test_haemoglobin import ALBEDO, COLOR, shown_albedo
from addon.skin.test_pores import patch

BARE = np.array([0.6, 0.5, 0.4])
WEIGHT, SHARE = 1.5, 0.25  # of the blood, and of the paint that goes below hair


def put(name: str, item: Any) -> None:
    from facestage_blender.skin.brow_paint import thin_paint
    from facestage_blender.skin.haemoglobin import give_haemoglobin, weight_path

    count = len(item.data.vertices)
    if name == "brows":
        thin_paint(item, np.tile(BARE, (count, 1)), np.full(count, SHARE))
        return
    for tree in give_haemoglobin(item, np.ones((1, count)), COLOR):
        path, axis = weight_path(0)
        tree.path_resolve(path.removesuffix(".default_value")).default_value[axis] = WEIGHT


def take(name: str, item: Any) -> None:
    from facestage_blender.skin.brow_paint import restore_paint
    from facestage_blender.skin.haemoglobin import take_haemoglobin

    (restore_paint if name == "brows" else take_haemoglobin)(item)


def expected(names: list[str]) -> np.ndarray:
    """The albedo with these on top of it, in the order in which they came."""
    albedo = ALBEDO
    for name in names:
        if name == "brows":
            albedo = (1 - SHARE) * albedo + SHARE * BARE
        else:
            albedo = albedo * np.exp(WEIGHT * COLOR)
    return albedo


@pytest.mark.parametrize("pictured", [True, False])
@pytest.mark.parametrize("order", permutations(("brows", "blood")))
@pytest.mark.parametrize("first_out", [0, 1])
def test_each_leaves_the_other_as_it_is(
    scene, order: tuple[str, str], first_out: int, pictured: bool
) -> None:
    from facestage_blender.pictures.images import texture_image

    item = patch(scene)
    tree = item.data.materials[0].node_tree
    group = tree.nodes["Facestage Skin"]
    if pictured:
        picture = np.ones((8, 8, 1), np.float32) * ALBEDO.astype(np.float32)
        tree.nodes["Albedo"].image = texture_image("Albedo", picture)
    else:
        tree.links.remove(group.inputs["Albedo"].links[0])
        group.inputs["Albedo"].default_value = (*ALBEDO, 1.0)
    before = {node.name for node in tree.nodes}
    for name in order:
        put(name, item)
    np.testing.assert_allclose(shown_albedo(scene, item), expected(list(order)), rtol=2e-3)
    goes, stays = order[first_out], order[1 - first_out]
    take(goes, item)
    np.testing.assert_allclose(shown_albedo(scene, item), expected([stays]), rtol=2e-3)
    put(goes, item)
    np.testing.assert_allclose(shown_albedo(scene, item), expected([stays, goes]), rtol=2e-3)
    take(stays, item)
    np.testing.assert_allclose(shown_albedo(scene, item), expected([goes]), rtol=2e-3)
    take(goes, item)
    assert {node.name for node in tree.nodes} == before
    albedo = group.inputs["Albedo"]
    assert albedo.is_linked == pictured
    if pictured:
        assert albedo.links[0].from_node.name == "Albedo"
    else:
        np.testing.assert_allclose(albedo.default_value[:3], ALBEDO, rtol=1e-6)

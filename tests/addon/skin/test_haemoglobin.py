"""Haemoglobin on top of the albedo: what the material is given is what the model of skin says."""

from __future__ import annotations

from typing import Any

import numpy as np

from addon.skin.test_pores import patch

ALBEDO = np.array([0.4, 0.25, 0.18])
COLOR = np.array([-0.04, -0.09, -0.06])


def shown_albedo(scene: Any, item: Any) -> np.ndarray:
    """(3,) of the patch's middle, as Cycles has it."""
    from facestage_blender.pictures.render import render_linear

    tree = item.data.materials[0].node_tree
    output = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
    lit = tree.nodes.new("ShaderNodeEmission")
    albedo = tree.nodes["Facestage Skin"].inputs["Albedo"]
    tree.links.new(albedo.links[0].from_socket, lit.inputs["Color"])
    tree.links.new(lit.outputs[0], output.inputs["Surface"])
    found = render_linear(scene, 4, direct_only=True)
    side = len(found) // 2
    tree.nodes.remove(lit)
    return np.asarray(found[side - 4 : side + 4, side - 4 : side + 4, :3].mean(axis=(0, 1)))


def test_albedo_is_multiplied_as_the_weights_say(scene) -> None:
    from facestage_blender.pictures.images import texture_image
    from facestage_blender.skin.haemoglobin import give_haemoglobin, take_haemoglobin, weight_path

    item = patch(scene)
    tree = item.data.materials[0].node_tree
    picture = np.ones((8, 8, 1), np.float32) * ALBEDO.astype(np.float32)
    tree.nodes["Albedo"].image = texture_image("Albedo", picture)
    harmonics = np.array([1.0, -0.5, 2.0, 0.25])
    everywhere = harmonics[:, None] * np.ones(len(item.data.vertices))
    assert give_haemoglobin(item, everywhere, COLOR) == [tree]
    np.testing.assert_allclose(shown_albedo(scene, item), ALBEDO, rtol=2e-3)
    for sign in (1.0, -1.0):
        weights = sign * np.array([1.5, 1.0, 0.5, -2.0])
        for harmonic, weight in enumerate(weights):
            path, axis = weight_path(harmonic)
            node = path.removesuffix(".default_value")
            tree.path_resolve(node).default_value[axis] = weight
        wanted = ALBEDO * np.exp(weights @ harmonics * COLOR)
        np.testing.assert_allclose(shown_albedo(scene, item), wanted, rtol=2e-3)
    take_haemoglobin(item)
    np.testing.assert_allclose(shown_albedo(scene, item), ALBEDO, rtol=2e-3)
    assert not [one for one in item.data.attributes if one.name.startswith("facestage_")]

"""Made-up pores: as steep as measured skin, none on lips, beside a normal map, and gone again."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.face_model import EYES, SKIN, FaceModel

SIDE, PIXELS = 0.02, 160  # metres of skin, and pixels that show it
OCTAVES_MM = ((1, 2), (2, 4), (4, 8))
SLOPES = (0.018, 0.013, 0.011)  # of a scan's normal map, docs/textures.md


def patch(scene: Any, middle: float = 0.0) -> Any:
    """A flat piece of skin, ``middle`` metres beside the middle of the face, and a camera over
    it.
    """
    import bpy

    from facestage_blender.skin.material import part_materials

    bpy.ops.mesh.primitive_plane_add(size=SIDE)
    item = bpy.context.object
    for vertex in item.data.vertices:
        vertex.co.x += middle
    item.data.materials.append(part_materials(np.array([SKIN]))[0])
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(camera)
    camera.location = (middle, 0.0, 1.0)
    camera.data.type, camera.data.ortho_scale = "ORTHO", SIDE
    scene.camera = camera
    scene.render.resolution_x = scene.render.resolution_y = PIXELS
    scene.render.resolution_percentage = 100
    return item


def shown_slopes(scene: Any, item: Any) -> np.ndarray:
    """(h, w, 2) slopes of the normals that the skin's material is given, as Cycles has them."""
    from facestage_blender.pictures.render import render_linear

    tree = item.data.materials[0].node_tree
    output = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
    lit, half = tree.nodes.new("ShaderNodeEmission"), tree.nodes.new("ShaderNodeVectorMath")
    half.operation = "MULTIPLY_ADD"
    half.inputs[1].default_value = half.inputs[2].default_value = (0.5, 0.5, 0.5)
    tree.links.new(
        tree.nodes["Facestage Skin"].inputs["Normal"].links[0].from_socket, half.inputs[0]
    )
    tree.links.new(half.outputs[0], lit.inputs["Color"])
    tree.links.new(lit.outputs[0], output.inputs["Surface"])
    normal = render_linear(scene, 16, direct_only=True)[..., :3] * 2 - 1
    return np.asarray(-normal[..., :2] / normal[..., 2:])


def octave(slopes: np.ndarray, low_mm: float, high_mm: float) -> float:
    """Root mean square along one axis of waves between these lengths."""
    frequency = np.fft.fftfreq(PIXELS, 1e3 * SIDE / PIXELS)
    length = np.hypot(*np.meshgrid(frequency, frequency))
    wanted = (length >= 1 / high_mm) & (length < 1 / low_mm)
    waves = np.fft.fft2(slopes, axes=(0, 1)) * wanted[..., None]
    return float(np.sqrt((np.fft.ifft2(waves, axes=(0, 1)).real ** 2).mean()))


def test_they_are_as_steep_as_skin_and_the_slider_scales_them(scene) -> None:
    from facestage_blender.skin.pores import give_pores, pores_of

    item = patch(scene)
    assert pores_of(item) is None
    give_pores(item)
    assert pores_of(item).default_value == 1.0
    slopes = shown_slopes(scene, item)
    found = [octave(slopes, *each) for each in OCTAVES_MM]
    fine = octave(slopes, 0.25, 1.0)
    print("slopes by octave", np.round(found, 4), "measured", SLOPES, "finer", round(fine, 3))
    np.testing.assert_allclose(found, SLOPES, rtol=0.35)
    assert 0.02 < fine < 0.1


def test_the_nose_has_more_than_the_sides(scene) -> None:
    """What is finer than a millimetre is pores: steeper in the middle of a face that is wider than
    the patch.
    """
    from facestage_blender.skin import pores

    item = patch(scene)
    pores.give_pores(item)
    steep = []
    for central, depth in ((1.0, pores.CENTRAL), (0.0, pores.BESIDE)):
        region = np.tile([depth, central, 0.0], (len(item.data.vertices), 1))
        item.data.attributes[pores.REGION].data.foreach_set("vector", region.ravel())
        steep.append(octave(shown_slopes(scene, item), 0.25, 1.0))
    print(f"slopes on the nose {steep[0]:.3f}, beside {steep[1]:.3f}")
    assert steep[0] > 1.5 * steep[1] > 0


def test_they_lie_on_a_normal_map_and_go_again(scene) -> None:
    import bpy

    from facestage_blender.pictures.images import texture_image
    from facestage_blender.skin.material import bend_normals
    from facestage_blender.skin.pores import give_pores, pores_of, remove_pores

    item = patch(scene)
    material = item.data.materials[0]
    nodes = material.node_tree.nodes
    before, normal = len(nodes), nodes["Facestage Skin"].inputs["Normal"]
    image = texture_image("normal", np.full((4, 4, 3), (0.5, 0.5, 1.0), np.float32))
    give_pores(item)
    bend_normals(material, image)  # as a result does that is applied later
    assert normal.links[0].from_node.name == "Pores"
    assert nodes["Pores"].inputs["Normal"].links[0].from_node.name == "Normal Map"
    give_pores(item)  # again: still one layer
    assert sum(node.type == "BUMP" for node in nodes) == 1
    remove_pores(item)
    assert pores_of(item) is None and normal.links[0].from_node.name == "Normal Map"
    give_pores(item)
    assert nodes["Pores"].inputs["Normal"].links[0].from_node.name == "Normal Map"
    bend_normals(material, None)
    remove_pores(item)
    assert not normal.is_linked and "facestage_rest" not in item.data.attributes
    assert len(nodes) == before + 1  # the normal map's, which any result leaves
    assert bpy.context.object == item


def test_a_face_has_them_on_its_skin_and_not_on_its_lips(scene) -> None:
    from facestage.models.registry import load_model
    from facestage_blender.rig.face_rig import build_rig
    from facestage_blender.scene.stage import new_stage
    from facestage_blender.skin.pores import REGION, REST, give_pores

    model: FaceModel = load_model("default")
    rig = build_rig(scene, model, "default", new_stage(scene))
    give_pores(rig)
    attributes = rig.data.attributes
    region, rest = (np.empty(3 * len(model.vertices), np.float32) for _ in range(2))
    attributes[REGION].data.foreach_get("vector", region)
    attributes[REST].data.foreach_get("vector", rest)
    depth, central, _ = region.reshape(-1, 3).T
    assert (depth[model.regions["lips"]] == 0).all() and (depth[model.regions["scalp"]] == 0).all()
    cheek = np.setdiff1d(model.regions["face"], model.regions["lips"])
    cheek = np.setdiff1d(cheek, np.concatenate([model.regions[k] for k in ("brows", "scalp")]))
    assert depth[cheek].min() >= 0.6 and central[cheek].max() > 0.99
    assert np.ptp(rest.reshape(-1, 3), axis=0) == pytest.approx(
        np.ptp(model.vertices, axis=0)[[0, 2, 1]], rel=1e-4
    )
    for slot in rig.material_slots:
        nodes = slot.material.node_tree.nodes
        skin = nodes.get("Facestage Skin")
        assert ("Pores" in nodes) == bool(skin is not None and skin["facestage_scatters"])


def test_what_is_no_skin_of_ours_has_none(scene) -> None:
    import bpy

    from facestage_blender.skin.material import part_materials
    from facestage_blender.skin.pores import give_pores

    mesh = bpy.data.meshes.new("eye")
    mesh.materials.append(part_materials(np.array([EYES]))[0])
    with pytest.raises(InputError, match="not Facestage's"):
        give_pores(bpy.data.objects.new("eye", mesh))

"""Brow hair: where it grows, how it follows the skin, its color, its end."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.face_model import FaceModel


@pytest.fixture(scope="session")
def default() -> FaceModel:
    from facestage.models.registry import load_model

    return load_model("default")


@pytest.fixture
def rig(scene, default: FaceModel) -> Any:
    from facestage_blender.rig.face_rig import build_rig
    from facestage_blender.scene.stage import new_stage

    return build_rig(scene, default, "default", new_stage(scene))


def shown(item: Any) -> np.ndarray:
    """(n, 3) the vertices of an object as modifiers and sliders leave them, in its own axes."""
    import bpy

    bpy.context.view_layer.update()
    evaluated = item.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    points = np.empty(3 * len(evaluated.vertices), np.float32)
    evaluated.vertices.foreach_get("co", points)
    return points.reshape(-1, 3).astype(float)


def hairs(brows: Any) -> np.ndarray:
    """(hairs, sections, 3) the middle of each section."""
    from facestage_blender.skin.hairs import SECTIONS, SIDES

    return shown(brows).reshape(-1, SECTIONS, SIDES, 3).mean(axis=2)


def wear(rig: Any, albedo: np.ndarray) -> None:
    """Give the rig an albedo (h, w, 3) of row 0 at the top."""
    from facestage_blender.pictures.images import texture_image
    from facestage_blender.skin.material import set_textures

    images = {"albedo": texture_image("albedo", albedo.astype(np.float32))}
    images["specular"] = texture_image("one", np.ones((4, 4), np.float32))
    set_textures(rig, images, {"roughness": 0.4})


def model_albedo(rig: Any) -> np.ndarray:
    from facestage_blender.pictures.images import image_pixels

    return image_pixels(rig.facestage_face.albedo_image)[..., :3].copy()


def skin_tree(rig: Any) -> Any:
    from facestage_blender.skin.lids import part_tree

    return part_tree(rig.data, shown(rig))[0]


def test_they_grow_on_the_brows_along_them(rig, default: FaceModel) -> None:
    from facestage_blender.scene import frames
    from facestage_blender.skin.brows import grow_brows

    lines = hairs(grow_brows(rig))
    print(len(lines), "hairs")
    assert 200 < len(lines) < 1200
    skin = skin_tree(rig)
    far = np.array([skin.find_nearest(each.tolist())[3] for each in lines[::5].reshape(-1, 3)])
    assert far.max() < 0.002
    brows = frames.points_to_blender(default.vertices[default.regions["brows"]])
    low, high = brows.min(axis=0) - 0.006, brows.max(axis=0) + 0.006
    inside = ((lines[:, 0] > low) & (lines[:, 0] < high)).all(axis=1)
    print("within the brows", inside.mean())
    assert inside.mean() > 0.97
    for side in (-1, 1):
        own = lines[side * lines[:, 0, 0] > 0]
        assert len(own) > 80
        outwards = side * (own[:, -1, 0] - own[:, 0, 0])
        middle = np.median(np.abs(own[:, 0, 0]))
        assert (outwards[np.abs(own[:, 0, 0]) > middle] > 0).mean() > 0.95
        rise = own[:, -1, 2] - own[:, 0, 2]
        inner = np.abs(own[:, 0, 0]) < np.quantile(np.abs(own[:, 0, 0]), 0.2)
        assert np.median(rise[inner]) > np.median(rise[~inner]) + 0.001
    length = np.linalg.norm(np.diff(lines, axis=1), axis=2).sum(axis=1)
    assert length.min() > 0.002
    assert length.max() < 0.013


def test_they_follow_the_skin(rig) -> None:
    from facestage_blender.skin.brows import grow_brows

    brows = grow_brows(rig)
    before = hairs(brows)
    rig.data.shape_keys.key_blocks["browInnerUp"].value = 1.0
    after, skin = hairs(brows), skin_tree(rig)
    inner = np.abs(before[:, 0, 0]) < 0.02
    assert (after[inner, 0, 2] - before[inner, 0, 2]).min() > 0.001
    far = np.array([skin.find_nearest(each.tolist())[3] for each in after[::5].reshape(-1, 3)])
    assert far.max() < 0.003
    length = [np.linalg.norm(lines[:, -1] - lines[:, 0], axis=1) for lines in (before, after)]
    np.testing.assert_allclose(length[1], length[0], rtol=0.02)


def test_a_face_without_brows_gets_none(rig) -> None:
    from facestage_blender.skin.brows import grow_brows

    wear(rig, np.tile([0.5, 0.3, 0.2], (64, 64, 1)))
    assert len(grow_brows(rig).data.vertices) == 0


def test_fainter_brows_have_fewer_hairs_in_their_own_color(rig) -> None:
    from facestage_blender.skin.brows import grow_brows

    albedo = model_albedo(rig)
    counts, colors = [], []
    for share, red in ((1.0, 1.0), (0.35, 1.0), (1.0, 3.0)):
        faint = np.exp(share * np.log(albedo) + (1 - share) * np.log([0.45, 0.27, 0.19]))
        wear(rig, np.clip(faint * [red, 1.0, 1.0], 0, 1))
        brows = grow_brows(rig)
        counts.append(len(brows.data.vertices))
        nodes = brows.data.materials[0].node_tree.nodes
        surface = next(each for each in nodes if "Base Color" in each.inputs)
        colors.append(np.array(surface.inputs["Base Color"].default_value)[:3])
    print(counts, colors)
    assert counts[1] < 0.7 * counts[0]
    assert colors[0].max() < 0.15
    assert colors[1].mean() > 1.5 * colors[0].mean()
    assert abs(colors[2][0] / colors[2][1] / (colors[0][0] / colors[0][1]) - 3) < 0.3


def test_each_hair_has_the_color_of_its_place(rig) -> None:
    from facestage_blender.skin.brows import COLOR, grow_brows
    from facestage_blender.skin.hairs import SECTIONS, SIDES

    albedo = model_albedo(rig)
    half = albedo.shape[1] // 2
    albedo[:, half:] **= 0.6
    wear(rig, albedo)
    brows = grow_brows(rig)
    color = np.array([each.vector for each in brows.data.attributes[COLOR].data])
    color = color.reshape(-1, SECTIONS * SIDES, 3)
    assert np.ptp(color, axis=1).max() == 0
    light = np.log(color[:, 0].mean(axis=1))
    right = hairs(brows)[:, 0, 0] < 0
    sides = [light[side].mean() for side in (right, ~right)]
    print(f"log lightness of the sides {sides}, scatter {light[right].std():.2f}")
    assert abs(sides[0] - sides[1]) > 0.3
    assert light[right].std() > 0.1
    surface = brows.data.materials[0].node_tree.nodes["Principled BSDF"]
    assert surface.inputs["Base Color"].links[0].from_node.attribute_name == COLOR


def test_dark_paint_is_not_made_grey(rig, default: FaceModel) -> None:
    """What shows below hair is no more than so many times as light as the paint."""
    from facestage_blender.skin.brow_paint import SHARE
    from facestage_blender.skin.brows import THINNED, grow_brows

    albedo, skin, gone = model_albedo(rig), np.array([0.45, 0.27, 0.19]), []
    for exponent in (0.5, 2.0):
        wear(rig, np.clip(skin * (albedo / skin) ** exponent, 0, 1))
        grow_brows(rig)
        share = np.array([each.value for each in rig.data.attributes[SHARE].data])
        gone.append(share[default.regions["brows"]].mean())
    print("of the paint goes", gone)
    assert gone[0] > 0.7 * THINNED
    assert gone[1] < 0.35 * THINNED


def test_a_brow_that_the_photo_hides_follows_the_other(rig) -> None:
    from facestage_blender.skin.brows import OTHER_SIDE, grow_brows

    both = hairs(grow_brows(rig))
    albedo = model_albedo(rig)
    half = albedo.shape[1] // 2
    albedo[:, half:] = [0.45, 0.27, 0.19]
    wear(rig, albedo)
    one = hairs(grow_brows(rig))
    share = [(side * one[:, 0, 0] > 0).sum() / (side * both[:, 0, 0] > 0).sum() for side in (-1, 1)]
    print("share of hairs", share)
    assert max(share) > 0.9
    assert abs(min(share) - OTHER_SIDE) < 0.15


def test_the_switch_leaves_nothing_behind(rig) -> None:
    import bpy

    def left() -> list[int]:
        data = bpy.data
        return [len(each) for each in (data.objects, data.meshes, data.materials, data.node_groups)]

    before = left()
    assert bpy.ops.facestage.brows() == {"FINISHED"}
    assert left() != before
    assert bpy.ops.facestage.brows() == {"FINISHED"}
    assert left() == before


def test_a_rebuilt_rig_keeps_them_where_it_can(scene, rig, default, head: FaceModel) -> None:
    from facestage_blender.rig.face_rig import build_rig
    from facestage_blender.skin.brows import brows_of, grow_brows

    grow_brows(rig)
    build_rig(scene, default, "default", rig.parent)
    assert brows_of(rig) is not None
    build_rig(scene, head, "egg", rig.parent)
    assert brows_of(rig) is None
    with pytest.raises(InputError, match="brows"):
        grow_brows(rig)


def test_the_skin_below_shows_less_paint_while_they_are_there(rig, default: FaceModel) -> None:
    from facestage.contract.texture_maps import ALBEDO
    from facestage_blender.skin.brow_paint import COLOR, NODE, SHARE
    from facestage_blender.skin.brows import THINNED, grow_brows, remove_brows
    from facestage_blender.skin.material import GROUP

    def source() -> str:
        tree = rig.material_slots[0].material.node_tree
        return tree.nodes[GROUP].inputs[ALBEDO.socket].links[0].from_node.name

    nodes = len(rig.material_slots[0].material.node_tree.nodes)
    before = source()
    grow_brows(rig)
    grow_brows(rig)  # again: nothing twice
    assert source() == NODE
    share = np.array([each.value for each in rig.data.attributes[SHARE].data])
    color = np.array([each.vector for each in rig.data.attributes[COLOR].data])
    brows = default.regions["brows"]
    print(
        f"of the paint {share[brows].mean():.2f} goes, elsewhere {np.delete(share, brows).mean()}"
    )
    assert share.max() <= THINNED + 1e-6
    assert share[brows].mean() > 0.5 * THINNED
    assert share[default.regions["lips"]].max() == 0
    assert (share > 0.02).sum() < 8 * len(brows)
    # What shows instead is as bright as the forehead, not as the hair.
    narrow = np.setdiff1d(default.regions["narrow_face"], default.regions["brows"])
    above = narrow[default.vertices[narrow, 1] > default.vertices[brows, 1].max()]
    skin = default.albedo_mean[above].mean()
    hair = default.albedo_mean[brows].mean()
    assert color[brows].mean() > hair + 0.6 * (skin - hair)
    remove_brows(rig)
    assert source() == before
    assert len(rig.material_slots[0].material.node_tree.nodes) == nodes
    assert SHARE not in rig.data.attributes and COLOR not in rig.data.attributes

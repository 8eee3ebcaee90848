"""The face as an asset: what another file gets of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from addon.ui.refusal import refused
from facestage.contract.face_model import FaceModel
from facestage.contract.result import Result
from reference.fit_scene import fit_scene


@pytest.fixture(scope="module")
def default_head() -> FaceModel:
    from facestage.models.registry import load_model

    return load_model("default")


@pytest.fixture
def fitted(scene, stand_in, photo: Path, landmark_file: Path, tmp_path: Path):
    """A scene with a fitted face."""
    stand_in("works")
    scene.facestage.output, scene.facestage.light_count = str(tmp_path / "work"), 5
    fit_scene(photo, landmark_file)
    return scene


@pytest.fixture
def grown(scene, default_head: FaceModel):
    """A scene with a face that has lashes, wet eyes and handles, and moves its jaw by them."""
    import bpy

    from facestage_blender.rig.face_rig import build_rig
    from facestage_blender.scene.stage import new_stage

    stage = new_stage(scene)
    stage.location = (0.3, -0.2, 1.1)
    build_rig(scene, default_head, "default", stage)
    assert bpy.ops.facestage.lashes(state="ON") == {"FINISHED"}
    assert bpy.ops.facestage.mark_as_asset(name="Alice") == {"FINISHED"}
    # What comes later belongs to it as well.
    assert bpy.ops.facestage.wet_eyes(state="ON") == {"FINISHED"}
    assert bpy.ops.facestage.add_control_rig() == {"FINISHED"}
    return scene


def elsewhere(path: Path, link: bool) -> Any:
    """The only asset of a saved file, in a file of its own that shows it."""
    import bpy

    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(str(path), link=link, assets_only=True) as (there, wanted):
        assert len(there.collections) == 1 and not there.objects
        wanted.collections = there.collections
    bpy.context.scene.collection.children.link(wanted.collections[0])
    bpy.context.view_layer.update()
    return wanted.collections[0]


def shown(item) -> np.ndarray:
    """(n, 3) an object's vertices as modifiers, drivers and its place show them."""
    import bpy

    graph = bpy.context.evaluated_depsgraph_get()
    graph.update()
    seen = item.evaluated_get(graph)
    points = np.empty(3 * len(seen.data.vertices), np.float32)
    seen.data.vertices.foreach_get("co", points)
    matrix = np.array(seen.matrix_world)
    return points.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]


@pytest.mark.parametrize("link", [False, True])
def test_another_file_gets_the_fitted_face(fitted, tmp_path: Path, link: bool) -> None:
    import bpy

    from facestage_blender.pictures.render import save_png

    result = Result.load(Path(fitted.facestage.result))
    halves = np.zeros((300, 400, 3))
    halves[:150, :, 0] = halves[150:, :, 2] = 1.0  # red above blue
    save_png(Path(fitted.facestage.result) / "face.png", halves)
    rig = fitted.facestage.rig
    values = {key.name: key.value for key in rig.data.shape_keys.key_blocks}
    place, name = np.array(rig.matrix_world), rig.name
    assert bpy.ops.facestage.mark_as_asset() == {"FINISHED"}
    asset = elsewhere(tmp_path / "face.blend", link)
    assert asset.name == name
    face = next(each for each in asset.objects if each.type == "MESH")
    assert {key.name: key.value for key in face.data.shape_keys.key_blocks} == pytest.approx(
        values, abs=1e-6
    )
    assert np.array(face.matrix_world) == pytest.approx(place, abs=1e-6)
    assert np.array(asset.instance_offset) == pytest.approx(place[:3, 3], abs=1e-6)
    assert not {each.type for each in bpy.data.objects} & {"LIGHT", "CAMERA"}
    about = asset.asset_data
    assert result.advice in about.description
    assert {each.name for each in about.tags} == {"face", "Facestage", "Built-in Head"}
    assert about.license == "CC0-1.0" and not about.author  # as the model's file says
    preview = np.array(asset.preview.image_pixels_float).reshape(256, 256, 4)
    assert preview[:100] == pytest.approx(np.broadcast_to([0, 0, 1, 1], (100, 256, 4)), abs=0.01)
    assert preview[-100:] == pytest.approx(np.broadcast_to([1, 0, 0, 1], (100, 256, 4)), abs=0.01)
    albedo = face.facestage_face.albedo_image
    used = {
        node.image
        for slot in face.material_slots
        for tree in (slot.material.node_tree, *groups(slot.material.node_tree))
        for node in tree.nodes
        if node.bl_idname == "ShaderNodeTexImage"
    }
    assert albedo in used
    assert all(each.packed_file is not None and each.size[0] for each in used - {None})


def groups(tree) -> list[Any]:
    """The groups in a tree of nodes."""
    found = [getattr(node, "node_tree", None) for node in tree.nodes]
    return [each for group in found if group is not None for each in (group, *groups(group))]


def test_what_grows_on_the_face_and_its_handles_come_along_and_work(grown, tmp_path: Path) -> None:
    import bpy

    from facestage_blender.skin.lashes import lashes_of
    from facestage_blender.skin.wet_eyes import wet_eyes_of

    asset = elsewhere(tmp_path / "face.blend", link=False)
    assert asset.name == "Alice" and asset.asset_data.license == "GPL-3.0-or-later"
    assert "not fitted" in asset.asset_data.description
    # Nothing was left without a place, which Blender would put loose into the scene.
    assert set(asset.objects) == set(bpy.data.objects) - widgets()
    face = next(each for each in asset.objects if each.facestage_face.is_rig)
    assert {lashes_of(face), wet_eyes_of(face)} < set(asset.objects)
    handles = next(each for each in asset.objects if each.type == "ARMATURE")
    rest = shown(face)
    handles.pose.bones["jaw_master"].rotation_euler.x = 0.3
    bpy.context.view_layer.update()
    assert np.abs(shown(face) - rest).max() > 0.002
    lashes = shown(lashes_of(face))
    handles.location[2] += 0.5
    bpy.context.view_layer.update()
    assert shown(lashes_of(face))[:, 2] == pytest.approx(lashes[:, 2] + 0.5, abs=1e-4)
    # It can be worked on as in the file that it is from.
    bpy.context.scene.facestage.rig = face
    assert bpy.ops.facestage.wet_eyes(state="OFF") == {"FINISHED"}
    assert bpy.ops.facestage.wet_eyes(state="ON") == {"FINISHED"}
    assert wet_eyes_of(face) in set(asset.objects)


def widgets() -> set[Any]:
    """What bones look like: in no collection."""
    import bpy

    return {
        bone.custom_shape
        for each in bpy.data.objects
        if each.type == "ARMATURE"
        for bone in each.pose.bones
    } - {None}


def test_pressed_again_it_is_no_asset_and_the_scene_is_as_before(fitted) -> None:
    import bpy

    before = {each.name: set(each.objects) for each in bpy.data.collections}
    for state, on in (("TOGGLE", True), ("ON", True), ("TOGGLE", False), ("OFF", False)):
        assert bpy.ops.facestage.mark_as_asset(state=state) == {"FINISHED"}
        assets = [each for each in bpy.data.collections if each.asset_data is not None]
        assert len(assets) == on
        assert {each.name for each in fitted.collection.children_recursive} == before.keys()
    assert {each.name: set(each.objects) for each in bpy.data.collections} == before


def test_asked_for_once_more_it_is_brought_up_to_date(fitted) -> None:
    import bpy

    bpy.ops.facestage.mark_as_asset(name="Alice")
    asset = bpy.data.collections["Alice"]
    asset.asset_data.author, asset.asset_data.description = "me", ""
    asset.asset_data.tags.new("mine")
    bpy.ops.facestage.mark_as_asset(state="ON", name="Alice at 30")
    assert asset.name == "Alice at 30" and asset.asset_data.author == "me"
    assert asset.asset_data.description
    assert len(asset.asset_data.tags) == 4


def test_a_result_that_is_gone_or_has_no_picture_does_not_stand_in_the_way(fitted) -> None:
    import bpy

    picture = Path(fitted.facestage.result) / "face.png"
    picture.write_bytes(b"no picture")
    assert bpy.ops.facestage.mark_as_asset(state="ON") == {"FINISHED"}
    fitted.facestage.result = "/no/such/folder"
    assert bpy.ops.facestage.mark_as_asset(state="ON") == {"FINISHED"}


def test_an_asset_goes_with_its_face(fitted, landmark_file: Path) -> None:
    import bpy

    bpy.ops.facestage.mark_as_asset()
    bpy.ops.facestage.add_face()
    bpy.ops.facestage.remove_face(number=1)
    assert not [each for each in bpy.data.collections if each.asset_data is not None]


def test_without_a_face_it_says_what_to_do(scene) -> None:
    import bpy

    refused(bpy.ops.facestage.mark_as_asset, "press Build Face Rig first")


def test_an_unsaved_file_is_said_to_want_saving(fitted, tmp_path: Path, capfd) -> None:
    import bpy

    bpy.ops.facestage.mark_as_asset(state="ON")
    assert "Save the .blend" in capfd.readouterr().out
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "face.blend"))
    capfd.readouterr()
    bpy.ops.facestage.mark_as_asset(state="ON")
    assert "Save the .blend" not in capfd.readouterr().out

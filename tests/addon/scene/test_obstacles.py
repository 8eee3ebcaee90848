"""What hides or lights the face beside the stage."""

from __future__ import annotations

import pytest

from addon.ui.refusal import refused
from facestage.contract.errors import InputError
from facestage.contract.face_model import FaceModel


@pytest.fixture
def default_file(scene):
    """Blender's default scene, with a stage inside its cube."""
    import addon_utils
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=False)
    addon_utils.enable("facestage_blender", default_set=True)
    assert bpy.ops.facestage.build_stage() == {"FINISHED"}
    return bpy.context.scene


def test_the_default_cube_and_lights_are_hidden_and_given_back(default_file) -> None:
    import bpy

    from facestage_blender.scene.obstacles import obstacles, world_shines

    cube, lamp, world = bpy.data.objects["Cube"], bpy.data.objects["Light"], default_file.world
    cube.hide_viewport = True
    assert set(obstacles(default_file)) == {cube, lamp}
    assert world_shines(default_file)
    assert bpy.ops.facestage.clear_stage() == {"FINISHED"}
    assert cube.hide_render and lamp.hide_render and lamp.hide_viewport
    assert default_file.world is None
    assert not obstacles(default_file) and not world_shines(default_file)
    assert bpy.ops.facestage.clear_stage() == {"FINISHED"}  # again: what was hidden is remembered
    assert bpy.ops.facestage.give_back() == {"FINISHED"}
    assert not cube.hide_render and not lamp.hide_render
    assert cube.hide_viewport and not lamp.hide_viewport
    assert default_file.world == world
    refused(bpy.ops.facestage.give_back, "Nothing")


def test_what_is_far_away_dark_or_part_of_the_face_is_not_in_the_way(
    default_file, head: FaceModel
) -> None:
    import bpy

    from facestage_blender.rig.face_rig import build_rig
    from facestage_blender.scene.obstacles import obstacles

    cube, lamp = bpy.data.objects["Cube"], bpy.data.objects["Light"]
    rig = build_rig(default_file, head, "default", default_file.facestage.stage)
    cube.location, lamp.data.energy = (3.0, 0.0, 0.0), 0.0
    hair = bpy.data.objects.new("Hair", cube.data)
    hair.parent = rig
    default_file.collection.objects.link(hair)
    default_file.view_layers[0].update()
    assert not obstacles(default_file)
    rig.parent = None
    assert not obstacles(default_file)
    cube.location = (1.9, 0.0, 0.0)  # its side is 0.1 m within the stage
    default_file.view_layers[0].update()
    assert obstacles(default_file) == [cube]
    hair.parent = None
    hair.location = (0.0, 0.0, 0.0)
    default_file.view_layers[0].update()
    assert set(obstacles(default_file)) == {cube, hair}


def test_a_world_that_the_user_chose_meanwhile_stays(default_file) -> None:
    import bpy

    bpy.ops.facestage.clear_stage()
    default_file.world = chosen = bpy.data.worlds.new("Chosen")
    bpy.ops.facestage.give_back()
    assert default_file.world == chosen


def test_without_a_stage_nothing_is_hidden(scene) -> None:
    from facestage_blender.scene.obstacles import clear

    with pytest.raises(InputError, match="no light stage"):
        clear(scene)

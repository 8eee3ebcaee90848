"""Solid views that show a fitted face's skin: when, where, and what they showed before."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from addon.stand_in_results import made_up
from facestage.contract.face_model import FaceModel

GREY, SKIN, COLORS = "MATERIAL", "TEXTURE", "VERTEX"


@pytest.fixture
def result(
    scene, head: FaceModel, photo: Path, landmark_file: Path, stand_in, tmp_path: Path
) -> str:
    """A scene with a rig, and the folder of a result with deviations."""
    import bpy

    from facestage_blender.exchange.photos import choose_photo
    from facestage_blender.exchange.scene_read import read_job
    from facestage_blender.landmarks.editing import choose_landmarks
    from facestage_blender.rig.face_rig import build_rig
    from facestage_blender.scene.stage import build_stage, default_stage

    stand_in("works")
    stage = build_stage(scene, default_stage(5, 1.0, 0.2))
    build_rig(scene, head, "default", stage)
    choose_photo(scene, photo)
    choose_landmarks(scene, landmark_file)
    scene.facestage.output = str(tmp_path / "out")
    assert bpy.ops.facestage.fit(apply=False) == {"FINISHED"}
    plain, folder = made_up(read_job(scene), head, 2), Path(scene.facestage.result)
    deviation = np.ones(plain.vertices.shape)
    replace(plain, arrays={"vertex_deviation_mm": deviation}).write_into(folder)
    assert shading().color_type == GREY  # a fit that is not applied shows nothing
    return str(folder)


def shading():
    """Of the one 3D view."""
    import bpy

    screen = bpy.context.window_manager.windows[0].screen
    return next(area for area in screen.areas if area.type == "VIEW_3D").spaces.active.shading


def test_an_applied_result_is_shown_and_one_button_gives_the_clay_back(scene, result: str):
    import bpy

    apply, show = bpy.ops.facestage.apply_result, bpy.ops.facestage.show_skin
    shading().type = "RENDERED"
    apply(folder=result)
    assert (shading().type, shading().color_type) == ("RENDERED", SKIN)
    for state, wanted in (("OFF", GREY), ("OFF", GREY), ("ON", SKIN), ("ON", SKIN)):
        assert show(state=state) == {"FINISHED"}
        assert (shading().type, shading().color_type) == ("RENDERED", wanted)
    show(state="TOGGLE")
    apply(folder=result)
    assert shading().color_type == GREY  # turned off by hand
    shading().type = "SOLID"


@pytest.mark.parametrize("chosen", ["OBJECT", "RANDOM"])
def test_views_whose_colors_the_user_chose_stay_as_they_are(scene, result: str, chosen: str):
    import bpy

    shading().color_type = chosen
    bpy.ops.facestage.apply_result(folder=result)
    assert shading().color_type == chosen
    shading().color_type = GREY  # by hand, since
    bpy.ops.facestage.show_skin(state="OFF")
    assert shading().color_type == GREY
    bpy.ops.facestage.show_skin(state="ON")
    shading().color_type = chosen
    bpy.ops.facestage.show_skin(state="OFF")
    assert shading().color_type == chosen
    shading().color_type = GREY


@pytest.mark.parametrize("chosen", ["Default", "basic.sl"])
def test_skin_is_shown_in_light_that_does_not_darken_it(scene, result: str, chosen: str):
    import bpy

    shading().studio_light = chosen
    bpy.ops.facestage.apply_result(folder=result)
    assert shading().studio_light == ("paint.sl" if chosen == "Default" else chosen)
    shading().type = "RENDERED"
    bpy.ops.facestage.show_skin(state="OFF")
    assert shading().type == "RENDERED"
    shading().type = "SOLID"
    assert shading().studio_light == chosen
    shading().type = "RENDERED"
    bpy.ops.facestage.show_skin(state="ON")
    shading().type = "SOLID"
    assert shading().studio_light == ("paint.sl" if chosen == "Default" else chosen)
    bpy.ops.facestage.show_skin(state="OFF")
    shading().studio_light = "Default"


def test_certainty_lies_over_skin_whichever_is_turned_first(scene, result: str):
    import bpy

    skin, certainty = bpy.ops.facestage.show_skin, bpy.ops.facestage.show_certainty
    bpy.ops.facestage.apply_result(folder=result)
    for turn, state, wanted in (
        (certainty, "ON", COLORS),
        (certainty, "OFF", SKIN),
        (certainty, "ON", COLORS),
        (skin, "OFF", COLORS),
        (certainty, "OFF", GREY),
        (certainty, "ON", COLORS),
        (skin, "ON", COLORS),
        (certainty, "OFF", SKIN),
        (skin, "OFF", GREY),
    ):
        turn(state=state)
        assert shading().color_type == wanted


def test_undo_takes_it_back_with_the_result(scene, result: str):
    import bpy

    bpy.ops.ed.undo_push(message="before")
    bpy.ops.facestage.apply_result(folder=result)
    bpy.ops.ed.undo_push(message="Apply Result")
    assert shading().color_type == SKIN
    bpy.ops.ed.undo()
    assert shading().color_type == GREY
    bpy.ops.ed.redo()
    assert shading().color_type == SKIN


def test_solid_views_show_the_albedo_and_no_cornea(scene, result: str):
    import bpy

    bpy.ops.facestage.apply_result(folder=result)
    materials = [slot.material for slot in scene.facestage.rig.material_slots]
    shown = [each.node_tree.nodes.active for each in materials if "Albedo" in each.node_tree.nodes]
    assert len(shown) > 1
    assert {each.image for each in shown} == {scene.facestage.rig.facestage_face.albedo_image}

    from facestage_blender.skin.eye_material import show_eyes
    from facestage_blender.skin.wet_nodes import wet_material

    # The eyes' own picture lies over their part of the UV square alone, which Solid views ignore.
    rig, closer = scene.facestage.rig, bpy.data.images.new("closer", 8, 8)
    eyes = next(each for each in materials if each.name.startswith("Facestage Eyes")).node_tree
    show_eyes(rig, closer)
    assert eyes.nodes["Albedo"].image == closer
    assert eyes.nodes.active.image == rig.facestage_face.albedo_image
    assert wet_material("wet").diffuse_color[3] == 0.0


def test_hairs_are_dark_and_dull_in_solid_views(scene):
    import bpy

    from facestage_blender.skin.lids import color_growth
    from facestage_blender.skin.material import plain_material

    mesh = bpy.data.meshes.new("hair")
    mesh.materials.append(plain_material("hair", (0.5, 0.5, 0.5), 0.3))
    color_growth(bpy.data.objects.new("hair", mesh), (0.03, 0.02, 0.01))
    material = mesh.materials[0]
    np.testing.assert_allclose(material.diffuse_color, (0.03, 0.02, 0.01, 1.0), rtol=1e-6)
    assert material.specular_intensity == 0.0

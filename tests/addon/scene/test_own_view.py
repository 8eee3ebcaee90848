"""The photo has a camera of its own, and the user's scene its looks again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from addon.ui.refusal import refused


@pytest.fixture
def filmed(scene):
    """Blender's default scene with a camera that is animated, and a film's look."""
    import addon_utils
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=False)
    addon_utils.enable("facestage_blender", default_set=True)
    scene = bpy.context.scene
    scene.camera.keyframe_insert("location", frame=1)
    scene.camera.data.keyframe_insert("lens", frame=1)
    scene.render.resolution_x, scene.render.resolution_percentage = 2048, 50
    scene.view_settings.view_transform, scene.view_settings.exposure = "AgX", 0.5
    return scene


def looks(scene) -> list[object]:
    """What the scene shows, and how."""
    render, view, camera = scene.render, scene.view_settings, scene.camera
    return [
        *(render.resolution_x, render.resolution_y, render.resolution_percentage),
        *(view.view_transform, view.exposure, view.look),
        *(camera.name, camera.data.lens, np.array(camera.matrix_world).round(5).tolist()),
        [each.image for each in camera.data.background_images],
    ]


def test_the_users_camera_and_render_settings_are_kept_and_given_back(filmed, photo: Path):
    import bpy

    users, before = filmed.camera, looks(filmed)
    assert bpy.ops.facestage.choose_photo(filepath=str(photo)) == {"FINISHED"}
    own = filmed.camera
    assert own != users and own.animation_data is None and own.data.animation_data is None
    assert own.name in bpy.data.collections["Facestage"].objects
    np.testing.assert_allclose(np.array(own.matrix_world), np.array(users.matrix_world), atol=1e-6)
    assert filmed.view_settings.view_transform == "Standard" and filmed.render.resolution_x == 96
    own.location.x += 1.0
    own.data.lens = 31.0
    bpy.ops.facestage.choose_photo(filepath=str(photo))
    assert filmed.camera == own  # and no third one
    assert bpy.ops.facestage.give_camera_back() == {"FINISHED"}
    filmed.view_layers[0].update()
    assert looks(filmed) == before
    refused(bpy.ops.facestage.give_camera_back, "that it had before the photo")
    assert bpy.ops.facestage.choose_photo(filepath=str(photo)) == {"FINISHED"}
    assert filmed.camera == own and own.data.lens == 31.0
    bpy.ops.facestage.give_camera_back()
    filmed.view_layers[0].update()
    assert looks(filmed) == before


def test_a_fit_does_not_touch_a_camera_that_was_given_back(filmed, photo: Path) -> None:
    import bpy

    from facestage_blender.scene.own_view import return_to_photo

    bpy.ops.facestage.choose_photo(filepath=str(photo))
    own, users = filmed.camera, filmed.facestage.camera_before
    bpy.ops.facestage.give_camera_back()
    assert filmed.camera == users
    return_to_photo(filmed)
    assert filmed.camera == own and filmed.facestage.camera_before == users
    bpy.data.objects.remove(own)
    filmed.camera = users
    filmed.facestage.view_before = ""
    return_to_photo(filmed)
    assert filmed.camera == users


@pytest.mark.parametrize("name", ["known_lens", "keep_camera"])
def test_a_camera_that_is_the_photos_is_used(filmed, photo: Path, name: str) -> None:
    import bpy

    users = filmed.camera
    setattr(filmed.facestage, name, True)
    bpy.ops.facestage.choose_photo(filepath=str(photo))
    assert filmed.camera == users


def test_what_is_no_picture_changes_nothing(filmed, tmp_path: Path) -> None:
    import bpy

    before = looks(filmed)
    refused(bpy.ops.facestage.choose_photo, "none.png", filepath=str(tmp_path / "none.png"))
    assert looks(filmed) == before and not filmed.facestage.view_before

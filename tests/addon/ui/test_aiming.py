"""The photo's camera before the first fit: it sees the new rig as the photo shows the face."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from facestage.contract.face_model import FaceModel
from facestage.contract.files.storage import write_json


@pytest.fixture
def away(scene, stand_in, head: FaceModel, photo: Path, tmp_path: Path):
    """A scene whose camera of the user's looks down on its middle from far off."""
    import bpy
    from mathutils import Euler, Matrix

    stand_in("works")
    scene.facestage.output = str(tmp_path / "work")
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(scene.camera)
    pose = Matrix.LocRotScale((7.4, -6.9, 5.0), Euler((1.1, 0.0, 0.8)), None)
    scene.camera.matrix_world = pose
    scene.view_layers[0].update()
    assert bpy.ops.facestage.choose_photo(filepath=str(photo)) == {"FINISHED"}
    assert bpy.ops.facestage.build_stage() == {"FINISHED"}
    return scene


def shown(scene) -> tuple[np.ndarray, np.ndarray]:
    """(n, 2) where the rig's vertices show in the photo, and (n,) how far before the camera."""
    from facestage_blender.pins.pinning import Setting
    from facestage_blender.pins.rig_shapes import current_vertices

    setting = Setting.of(scene)
    to_camera = setting.guess().to_camera
    points = current_vertices(setting.rig) @ to_camera[:3, :3].T + to_camera[:3, 3]
    return setting.lens.project(points), -points[:, 2]


def test_a_new_rig_is_seen_whole_from_the_front(away) -> None:
    import bpy
    from mathutils import Euler, Matrix

    users = bpy.data.objects["Camera"]
    before = np.array(users.matrix_world)
    away.facestage.stage.matrix_world = Matrix.LocRotScale(
        (0.3, 0.2, 0.1), Euler((0.0, 0.2, 0.7)), None
    )
    assert bpy.ops.facestage.build_rig() == {"FINISHED"}
    away.view_layers[0].update()
    pixels, depth = shown(away)
    size = np.array([away.render.resolution_x, away.render.resolution_y])
    middle = (pixels.min(axis=0) + pixels.max(axis=0)) / 2
    np.testing.assert_allclose(middle, size / 2, atol=0.05 * size.max())
    assert 0.5 < np.ptp(pixels[:, 1]) / size[1] < 0.85
    assert np.ptp(pixels[:, 0]) < size[0]
    # The nose is what is nearest, and points are upright.
    vertices = np.array([v.co for v in away.facestage.rig.data.vertices])
    assert np.corrcoef(vertices[:, 1], depth)[0, 1] > 0.9
    assert np.corrcoef(vertices[:, 2], pixels[:, 1])[0, 1] < -0.9
    np.testing.assert_array_equal(np.array(users.matrix_world), before)


def test_it_is_seen_where_the_landmarks_are(away, tmp_path: Path) -> None:
    import bpy
    from mathutils import Euler, Matrix

    from facestage_blender.pins.pinning import anchors

    assert bpy.ops.facestage.build_rig() == {"FINISHED"}
    _, corners, weights = anchors(away.facestage.rig, "ibug68")
    away.camera.matrix_world = Matrix.LocRotScale((0.1, -0.6, 0.05), Euler((1.5, 0.1, 0.2)), None)
    away.view_layers[0].update()
    wanted = np.einsum("mi,mix->mx", weights, shown(away)[0][corners])
    path = tmp_path / "points.json"
    write_json(path, {"scheme": "ibug68", "points": wanted.tolist()})
    away.camera.matrix_world = Matrix.LocRotScale((2, 1, 0), None, None)
    bpy.ops.facestage.choose_landmarks(filepath=str(path))
    assert bpy.ops.facestage.build_rig() == {"FINISHED"}
    away.view_layers[0].update()
    now = np.einsum("mi,mix->mx", weights, shown(away)[0][corners])
    np.testing.assert_allclose(now, wanted, atol=0.3)
    sliders = away.facestage.rig.data.shape_keys.key_blocks
    assert max(abs(key.value) for key in sliders[1:]) == 0


@pytest.mark.parametrize("whose", ["kept", "fitted", "the user's"])
def test_a_camera_that_has_its_place_stays(away, tmp_path: Path, whose: str) -> None:
    import bpy

    if whose == "kept":
        away.facestage.keep_camera = True
    elif whose == "fitted":
        away.facestage.result = str(tmp_path)
    else:
        bpy.ops.facestage.give_camera_back()
    before = np.array(away.camera.matrix_world)
    assert bpy.ops.facestage.build_rig() == {"FINISHED"}
    np.testing.assert_array_equal(np.array(away.camera.matrix_world), before)

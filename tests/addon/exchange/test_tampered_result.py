"""Whatever is done to a result's files: applying it is refused and changes nothing, or leaves a
sound scene.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.files.storage import read_arrays
from facestage.contract.relight_cache import RELIGHT_CACHE
from facestage.contract.result import Result
from reference.fit_scene import fit_scene
from reference.tampering import ARRAY_CHANGES, FILES, copy_of, tamperings

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes and /dev/zero are of Unix")


@pytest.fixture
def fitted(scene, stand_in, photo: Path, landmark_file: Path, tmp_path: Path) -> tuple[Any, Path]:
    """A scene with a result applied, and the result's folder."""

    stand_in("works")
    scene.facestage.output = str(tmp_path / "work")
    scene.facestage.light_count = 3
    fit_scene(photo, landmark_file)
    return scene, tmp_path / "work" / "result"


def test_a_tampered_result_changes_nothing_or_nothing_to_worry_about(
    fitted, tmp_path: Path
) -> None:
    from facestage_blender.exchange.write_back import apply_result

    scene, sound = fitted
    refused = applied = 0
    before = snapshot(scene)
    for name, deed in tamperings(sound):
        folder = copy_of(sound, tmp_path / "spoiled")
        deed(folder)
        try:
            apply_result(scene, Result.load(folder))
            sentence = ""
        except InputError as error:
            sentence = str(error)
        if sentence:
            refused += 1
            assert sentence.isprintable() and len(sentence) < 1000, name
            assert snapshot(scene) == before, f"{name} left the scene half changed: {sentence}"
        else:
            applied += 1
            assert_finite(snapshot(scene), name)
            apply_result(scene, Result.load(sound))
            before = snapshot(scene)
    print(f"{refused} refused, {applied} applied")
    assert refused > 500 and applied > 50


def oversized(path: Path) -> None:
    """The header says 60000 x 60000 pixels."""
    content = bytearray(path.read_bytes())
    for name in (b"dataWindow\0box2i\0", b"displayWindow\0box2i\0"):
        place = content.index(name) + len(name) + 4
        content[place + 8 : place + 16] = np.array([59_999, 59_999], "<i4").tobytes()
    path.write_bytes(content)


def not_finite(path: Path) -> None:
    os.environ["OPENCV_IO_ENABLE_OPENEXR"] = "1"
    import cv2

    assert cv2.imwrite(str(path), np.full((16, 16, 3), np.nan, np.float32))


def test_a_damaged_texture_is_refused_and_none_is_left(fitted, tmp_path: Path) -> None:
    from facestage_blender.exchange.write_back import apply_result

    scene, sound = fitted
    before = snapshot(scene)
    for picture in ("albedo.exr", "specular.exr", "roughness.exr"):
        for deed, words in (
            (oversized, "60000 x 60000"),
            (not_finite, "NaN"),
            (FILES["half"], "cut off"),
        ):
            folder = copy_of(sound, tmp_path / "spoiled")
            deed(folder / picture)
            with pytest.raises(InputError, match=words):
                apply_result(scene, Result.load(folder))
            assert snapshot(scene) == before, f"{picture}: {words}"


def test_weights_that_the_rig_lacks_change_nothing(fitted) -> None:
    from facestage_blender.exchange.write_back import apply_result

    scene, sound = fitted
    data = json.loads((sound / "result.json").read_text())
    data["expression"] = {f"no {name}": value for name, value in data["expression"].items()}
    (sound / "result.json").write_text(json.dumps(data))
    before = snapshot(scene)
    with pytest.raises(InputError, match="has no shape key 'no jawOpen'"):
        apply_result(scene, Result.load(sound))
    assert snapshot(scene) == before


def test_a_camera_that_is_none_is_said(fitted) -> None:
    from facestage_blender.exchange.write_back import apply_result
    from facestage_blender.scene.stage import stage_lights

    scene, sound = fitted
    scene.camera = stage_lights(scene.facestage.stage)[0]
    before = snapshot(scene)
    with pytest.raises(InputError, match="choose a camera"):
        apply_result(scene, Result.load(sound))
    assert snapshot(scene) == before


RECORDS = (
    "[" * 5000,
    "[]",
    "{}",
    '{"identity": 5, "expression": {}}',
    '{"identity": {}, "expression": {"a": ["a", 0]}, "to_model": []}',
    json.dumps({"identity": {}, "expression": {}, "to_model": np.zeros((4, 4)).tolist()}),
)


def test_a_damaged_record_of_an_own_mesh_is_said(fitted) -> None:
    from facestage_blender.exchange.write_back import apply_result

    scene, sound = fitted
    result = Result.load(sound)
    for record in RECORDS:
        scene.facestage.rig.facestage_face.own_mesh = record
        before = snapshot(scene)
        with pytest.raises(InputError, match="Use My Mesh again"):
            apply_result(scene, result)
        assert snapshot(scene) == before


def test_paths_that_no_machine_has_are_said(fitted) -> None:
    import bpy

    from facestage_blender.scene.paths import result_folder
    from facestage_blender.ui.sidebar import existing

    scene, _ = fitted
    photo = scene.facestage.photo
    for path in ("~nosuchuser/result", "x" * 5000, "/" + "y" * 300):
        scene.facestage.result = path
        for operator in (bpy.ops.facestage.apply_result, bpy.ops.facestage.open_report):
            refused(operator)
        assert existing(result_folder, scene) is None
        scene.facestage.photo = path
        refused(bpy.ops.facestage.fit)
        scene.facestage.photo = photo


def refused(operator) -> None:
    with pytest.raises(RuntimeError) as caught:
        operator()
    assert "Traceback" not in str(caught.value)


def test_a_damaged_relight_cache_turns_no_preview_on(fitted) -> None:
    import bpy

    from facestage_blender.preview import live as preview

    scene, sound = fitted
    bpy.ops.facestage.prepare_relight()
    preview.stop()
    arrays, before = read_arrays(sound / RELIGHT_CACHE, "cache"), snapshot(scene)
    for name in ("size", "pixels", "coverage", "images", "scale", "samples"):
        for change in ("NaN", "negative", "huge", "empty", "text"):
            np.savez(
                sound / RELIGHT_CACHE, **(arrays | {name: ARRAY_CHANGES[change](arrays[name])})
            )
            with pytest.raises(RuntimeError, match=r"relight cache.*damaged"):
                bpy.ops.facestage.relight_preview()
            assert snapshot(scene) == before, f"{name}: {change}"


def snapshot(scene) -> dict[str, Any]:
    """All that applying a result may change, as plain values."""
    import bpy

    settings, rig = scene.facestage, scene.facestage.rig
    objects = {
        item.name: (
            item.type,
            tuple(map(tuple, item.matrix_world)),
            item.parent.name if item.parent else "",
        )
        for item in bpy.data.objects
    }
    lights = {
        light.name: (light.energy, tuple(light.color), light.size, light.shape)
        for light in bpy.data.lights
    }
    cameras = {
        camera.name: (
            camera.lens,
            camera.shift_x,
            camera.shift_y,
            camera.sensor_width,
            camera.sensor_fit,
        )
        for camera in bpy.data.cameras
    }
    keys = rig.data.shape_keys.key_blocks
    sliders = {key.name: (key.value, key.slider_min, key.slider_max) for key in keys}
    points = np.empty(3 * len(rig.data.vertices), np.float32)
    keys[0].data.foreach_get("co", points)
    images = {
        image.name: (tuple(image.size), image.packed_file is not None) for image in bpy.data.images
    }
    face = rig.facestage_face
    return {
        "objects": objects,
        "lights": lights,
        "cameras": cameras,
        "sliders": sliders,
        "images": images,
        "points": points.tolist(),
        "materials": sorted(material.name for material in bpy.data.materials),
        "textures": [
            image.name if image else "" for image in (face.albedo_image, face.specular_image)
        ],
        "roughness": face.roughness,
        "result": settings.result,
        "own": face.own_mesh,
        "render": (scene.render.resolution_x, scene.render.resolution_y),
        "states": [item.facestage_light.state for item in bpy.data.objects],
        "fitted": [tuple(item.facestage_light.fitted_radiance) for item in bpy.data.objects],
    }


def assert_finite(values: Any, name: str) -> None:
    if isinstance(values, dict):
        values = list(values.values())
    if isinstance(values, list | tuple):
        for value in values:
            assert_finite(value, name)
    elif isinstance(values, float):
        assert np.isfinite(values), name

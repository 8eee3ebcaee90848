"""Expression sliders by region: found, at rest, as fitted, mirrored."""

from __future__ import annotations

from pathlib import Path

import pytest

from reference.fit_scene import fit_scene


@pytest.mark.parametrize(
    ("name", "region"),
    [
        ("eyeBlinkLeft", "Eyes"),
        ("browDownLeft", "Brows"),
        ("jawOpen", "Jaw"),
        ("tongueOut", "Jaw"),
        ("mouthSmileRight", "Mouth"),
        ("cheekPuff", "Cheeks and Nose"),
        ("noseSneerLeft", "Cheeks and Nose"),
        ("AU17_chin_raiser", "Further"),
        ("eyelid", "Further"),
    ],
)
def test_arkits_names_say_the_region(name: str, region: str) -> None:
    from facestage_blender.rig.expressions import region_of

    assert region_of(name) == region


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("mouthSmileLeft", "mouthSmileRight"),
        ("jawLeft", "jawRight"),
        ("LeftBlink", "RightBlink"),
        ("AU46_wink_left", "AU46_wink_right"),
        ("Smile.L", "Smile.R"),
        ("smile_l", "smile_r"),
        ("cleft", "cleft"),
        ("brightness", "brightness"),
        ("jawOpen", "jawOpen"),
    ],
)
def test_left_is_rights_other_side(left: str, right: str) -> None:
    from facestage_blender.rig.expressions import mirrored

    assert mirrored(left) == right and mirrored(right) == left


@pytest.fixture
def rig(scene, head):
    """A rig whose expressions have a left and a right."""
    from dataclasses import replace

    from facestage_blender.rig.face_rig import build_rig
    from facestage_blender.scene.stage import new_stage

    names = ("jawOpen", "mouthSmileLeft", "mouthSmileRight", "AU1")
    return build_rig(scene, replace(head, expression_names=names), "default", new_stage(scene))


def test_sliders_are_found_without_those_of_identity(rig) -> None:
    from facestage_blender.rig.expressions import expression_keys

    found = {region: [key.name for key in keys] for region, keys in expression_keys(rig).items()}
    assert found == {
        "Jaw": ["jawOpen"],
        "Mouth": ["mouthSmileLeft", "mouthSmileRight"],
        "Further": ["AU1"],
    }


def test_mirror_and_neutral(rig) -> None:
    import bpy

    keys = rig.data.shape_keys.key_blocks
    keys["jawOpen"].value, keys["mouthSmileLeft"].value = 0.5, 0.8
    keys["identity/mode_0"].value = 1.5
    assert bpy.ops.facestage.set_expression(to="MIRROR") == {"FINISHED"}
    assert keys["mouthSmileRight"].value == pytest.approx(0.8)
    assert keys["mouthSmileLeft"].value == 0.0 and keys["jawOpen"].value == pytest.approx(0.5)
    assert bpy.ops.facestage.set_expression(to="NEUTRAL") == {"FINISHED"}
    assert not any(keys[name].value for name in ("jawOpen", "mouthSmileRight"))
    assert keys["identity/mode_0"].value == pytest.approx(1.5)


def test_as_fitted(scene, stand_in, photo: Path, landmark_file: Path, tmp_path: Path) -> None:
    import bpy

    stand_in("works")
    scene.facestage.output = str(tmp_path / "work")
    fit_scene(photo, landmark_file)
    keys = scene.facestage.rig.data.shape_keys.key_blocks
    fitted = {key.name: key.value for key in keys}
    assert any(value for name, value in fitted.items() if not name.startswith("identity/"))
    keys["jawOpen"].value = fitted["jawOpen"] + 0.3
    assert bpy.ops.facestage.set_expression(to="FITTED") == {"FINISHED"}
    assert {key.name: key.value for key in keys} == pytest.approx(fitted)

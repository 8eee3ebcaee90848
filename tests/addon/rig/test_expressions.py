"""Expression sliders by region: found, at rest, as fitted, mirrored."""

from __future__ import annotations

from pathlib import Path

import pytest

from addon.ui.refusal import refused
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


@pytest.fixture
def folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Where the user's expressions are kept, empty."""
    from facestage_blender.ui import expressions

    monkeypatch.setattr(expressions, "expression_folder", lambda: tmp_path / "expressions")
    return tmp_path / "expressions"


def test_built_in_expressions_are_made_of_arkits_names(scene) -> None:
    from facestage.contract.arkit import ARKIT_NAMES
    from facestage_blender.rig.presets import BUILT_IN

    for name, weights in BUILT_IN.items():
        assert set(weights) <= set(ARKIT_NAMES), name
        assert all(0 < weight <= 1 for weight in weights.values())


def test_an_expression_moves_its_sliders_and_rests_the_others(rig, folder: Path) -> None:
    import bpy

    keys = rig.data.shape_keys.key_blocks
    keys["AU1"].value, keys["identity/mode_0"].value = 0.7, 1.5
    assert bpy.ops.facestage.apply_expression(name="Laugh") == {"FINISHED"}
    assert keys["jawOpen"].value == pytest.approx(0.35)
    assert keys["mouthSmileLeft"].value == keys["mouthSmileRight"].value == pytest.approx(0.9)
    assert keys["AU1"].value == 0.0 and keys["identity/mode_0"].value == pytest.approx(1.5)
    refused(bpy.ops.facestage.apply_expression, "has none of the sliders", name="Kiss")
    refused(bpy.ops.facestage.apply_expression, "no expression 'Bliss'", name="Bliss")


def test_an_expression_is_kept_for_other_faces_and_forgotten(rig, scene, head, folder) -> None:
    from dataclasses import replace

    import bpy

    from facestage_blender.rig.face_rig import build_rig
    from facestage_blender.rig.presets import preset_names

    keys = rig.data.shape_keys.key_blocks
    keys["mouthSmileLeft"].value, keys["AU1"].value = 0.4, 0.2
    assert bpy.ops.facestage.keep_expression(name="Half a smile") == {"FINISHED"}
    assert preset_names(folder) == ["Half a smile"]
    other = replace(head, expression_names=("jawOpen", "mouthSmile_L", "mouthSmile_R", "AU2"))
    keys = build_rig(scene, other, "ict:x", rig.parent).data.shape_keys.key_blocks
    assert bpy.ops.facestage.apply_expression(name="Half a smile") == {"FINISHED"}
    assert keys["mouthSmile_L"].value == pytest.approx(0.4)
    assert keys["mouthSmile_R"].value == keys["AU2"].value == 0.0
    assert bpy.ops.facestage.keep_expression(name="From the other") == {"FINISHED"}
    assert '"mouthSmileLeft": 0.4' in (folder / "From the other.json").read_text(encoding="utf-8")
    assert bpy.ops.facestage.forget_expression(name="Half a smile") == {"FINISHED"}
    refused(bpy.ops.facestage.forget_expression, "of yours", name="Half a smile")


@pytest.mark.parametrize("name", ["", "  ", "../away", "a/b", "Smile", "x" * 60, "con."])
def test_what_cannot_be_a_name_is_refused(rig, folder: Path, name: str) -> None:
    import bpy

    refused(bpy.ops.facestage.keep_expression, name.strip() or "cannot name", name=name)
    assert not folder.exists() or not list(folder.iterdir())


def test_a_damaged_expression_is_one_sentence(rig, folder: Path) -> None:
    import bpy

    folder.mkdir()
    (folder / "Bent.json").write_text('{"schema": 1, "weights": {"jawOpen": "wide"}}')
    refused(bpy.ops.facestage.apply_expression, "Bent.json", name="Bent")


def test_all_sliders_are_keyed(rig, scene) -> None:
    import bpy

    keys = rig.data.shape_keys.key_blocks
    scene.frame_set(10)
    keys["jawOpen"].value = 0.8
    assert bpy.ops.facestage.key_expression() == {"FINISHED"}
    scene.frame_set(20)
    keys["jawOpen"].value = keys["AU1"].value = 0.2
    assert bpy.ops.facestage.key_expression() == {"FINISHED"}
    scene.frame_set(15)
    assert keys["jawOpen"].value == pytest.approx(0.5) and keys["AU1"].value == pytest.approx(0.1)

"""The control rig: handles move sliders, keys go on to work, and everything is given back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from addon.ui.refusal import refused
from facestage.contract.arkit import ARKIT_NAMES, spellings
from facestage.contract.face_model import FaceModel

EXACT = 2e-5
# A slider's value by the place of its handle, which goes a centimetre and lies half a metre from
# where single precision counts from.
ROUNDED = 5e-6
SEEN = 1e-4  # what a slider shows above rounding

# Handle, property, axis, metres or radians, and what it moves.
MOVES = [
    ("jaw_master", "rotation_euler", 0, 0.1, {"jawOpen"}),
    ("jaw_master", "rotation_euler", 2, -0.05, {"jawLeft"}),
    ("jaw_master", "rotation_euler", 2, 0.05, {"jawRight"}),
    ("jaw_master", "location", 1, 0.003, {"jawForward"}),
    ("lips.L", "location", 1, 0.003, {"mouthSmileLeft"}),
    ("lips.R", "location", 1, 0.003, {"mouthSmileRight"}),
    ("lips.L", "location", 1, -0.003, {"mouthFrownLeft"}),
    ("lips.L", "location", 0, 0.003, {"mouthStretchLeft"}),
    ("lips.R", "location", 0, -0.003, {"mouthStretchRight"}),
    ("lips.L", "location", 0, -0.003, {"mouthPucker"}),
    ("lips.R", "location", 0, 0.003, {"mouthPucker"}),
    ("lips.R", "location", 2, -0.003, {"mouthDimpleRight"}),
    ("lip.T", "location", 1, 0.003, {"mouthUpperUpLeft", "mouthUpperUpRight"}),
    ("lip.T", "location", 1, -0.003, {"mouthClose"}),
    ("lip.T", "location", 2, 0.003, {"mouthShrugUpper"}),
    ("lip.T", "location", 2, -0.003, {"mouthRollUpper"}),
    ("lip.B", "location", 1, -0.003, {"mouthLowerDownLeft", "mouthLowerDownRight"}),
    ("lip.B", "location", 1, 0.003, {"mouthShrugLower"}),
    ("lip.B", "location", 2, -0.003, {"mouthRollLower"}),
    ("lip.T.L.001", "location", 1, 0.003, {"mouthUpperUpLeft"}),
    ("lip.B.R.001", "location", 1, -0.003, {"mouthLowerDownRight"}),
    ("lip.B.L.001", "location", 1, 0.003, {"mouthPressLeft"}),
    ("mouth", "location", 0, 0.003, {"mouthLeft"}),
    ("mouth", "location", 0, -0.003, {"mouthRight"}),
    ("mouth", "location", 2, 0.003, {"mouthFunnel"}),
    ("lid.T.L.002", "location", 1, -0.003, {"eyeBlinkLeft"}),
    ("lid.T.R.002", "location", 1, 0.003, {"eyeWideRight"}),
    ("lid.B.L.002", "location", 1, 0.003, {"eyeSquintLeft"}),
    ("brow.T.L.003", "location", 1, 0.003, {"browInnerUp"}),
    ("brow.T.R", "location", 1, 0.003, {"browOuterUpRight"}),
    ("brow.T.L", "location", 1, -0.003, {"browDownLeft"}),
    ("brow.T.R.003", "location", 1, -0.003, {"browDownRight"}),
    ("cheek.T.L.001", "location", 1, 0.003, {"cheekSquintLeft"}),
    ("cheek.B.R.001", "location", 2, 0.003, {"cheekPuff"}),
    ("nose.L.001", "location", 1, 0.003, {"noseSneerLeft"}),
    ("eyes", "location", 0, 0.05, {"eyeLookOutLeft", "eyeLookInRight"}),
    ("eyes", "location", 0, -0.05, {"eyeLookInLeft", "eyeLookOutRight"}),
    ("eyes", "location", 1, 0.05, {"eyeLookUpLeft", "eyeLookUpRight"}),
    ("eyes", "location", 1, -0.05, {"eyeLookDownLeft", "eyeLookDownRight"}),
    ("eye.L", "location", 0, 0.05, {"eyeLookOutLeft"}),
]


@pytest.fixture(scope="module")
def default_head() -> FaceModel:
    from facestage.models.registry import load_model

    return load_model("default")


def build(scene, model: FaceModel, spec: str = "default"):
    from facestage_blender.rig.face_rig import build_rig
    from facestage_blender.scene.stage import new_stage

    rig = build_rig(scene, model, spec, scene.facestage.stage or new_stage(scene))
    rig.location, rig.rotation_euler = (0.1, -0.2, 0.3), (0.2, 0.1, -0.3)
    update()
    return rig


@pytest.fixture
def rig(scene, default_head: FaceModel):
    """The default head with a control rig."""
    import bpy

    rig = build(scene, default_head)
    assert bpy.ops.facestage.add_control_rig() == {"FINISHED"}
    return rig


@pytest.fixture(scope="module")
def rigged(empty_scene, default_head: FaceModel) -> dict[str, np.ndarray]:
    """Where the default head's handles stand at rest."""
    import bpy

    with empty_scene() as scene:
        rig = build(scene, default_head)
        bpy.ops.facestage.add_control_rig()
        return {each.name: np.array(each.bone.head_local) for each in bones(rig)}


def update() -> None:
    import bpy

    bpy.context.view_layer.update()


def shown(rig) -> dict[str, float]:
    """The expression that the face shows."""
    update()
    return {
        key.name: key.value
        for key in list(rig.data.shape_keys.key_blocks)[1:]
        if abs(key.value) > SEEN and not key.name.startswith("identity/")
    }


def bones(rig):
    return rig.facestage_face.control_rig.pose.bones


def place(item) -> np.ndarray:
    update()
    return np.array(item.matrix_world)


def test_each_handle_moves_its_sliders(rig) -> None:
    for bone, path, axis, value, sliders in MOVES:
        getattr(bones(rig)[bone], path)[axis] = value
        moved = shown(rig)
        getattr(bones(rig)[bone], path)[axis] = 0.0
        assert set(moved) == sliders, (bone, path, axis)
        assert all(0.05 < each < 1 for each in moved.values()), (bone, moved)
    assert not shown(rig)


def test_every_slider_of_arkit_has_its_handle(rig) -> None:
    from facestage_blender.rig.control.binding import read_terms

    assert {term.slider for term in read_terms(rig)} == set(ARKIT_NAMES)


def test_drivers_need_no_python(rig) -> None:
    drivers = rig.data.shape_keys.animation_data.drivers
    assert len(drivers) == len(ARKIT_NAMES)
    assert all(each.driver.is_valid and each.driver.is_simple_expression for each in drivers)


def test_ict_has_all_handles(scene, ict_facekit: FaceModel) -> None:
    import bpy

    from facestage_blender.rig.control.binding import read_terms

    rig = build(scene, ict_facekit, "ict:x")
    assert bpy.ops.facestage.add_control_rig() == {"FINISHED"}
    known = {name for arkit in ARKIT_NAMES for names in spellings(arkit) for name in names} & set(
        ict_facekit.expression_names
    )
    assert {term.slider for term in read_terms(rig)} == known
    bones(rig)["brow.T.L.003"].location.y = bones(rig)["lips.R"].location.y = 0.003
    assert set(shown(rig)) == {"browInnerUp_L", "mouthSmile_R"}
    bones(rig)["eyes"].location.x = -0.1
    assert {"eyeLookIn_L", "eyeLookOut_R"} <= set(shown(rig))


@pytest.mark.parametrize(
    ("bone", "landmark"),
    [
        ("brow.T.L.003", 22),
        ("brow.T.R", 18),
        ("lid.T.L.002", 43),
        ("lips.L", 54),
        ("lips.R", 48),
        ("lip.T", 51),
        ("lip.B", 57),
        ("nose.R.001", 31),
    ],
)
def test_handles_stand_where_the_face_has_them(
    rigged, default_head, bone: str, landmark: int
) -> None:
    from facestage_blender.scene import frames

    table = default_head.landmarks["ibug68"][landmark]
    wanted = frames.points_to_blender(table[3:] @ default_head.vertices[table[:3].astype(int)])
    # A sneer lifts the skin beside the nose, above its wing.
    assert np.linalg.norm(rigged[bone] - wanted) < (0.02 if "nose" in bone else 0.011)


def test_cheeks_and_nose_have_their_handles_to_themselves(rigged) -> None:
    """Not at the corner of the mouth, which a puff, a sneer and a smile move most."""
    mouth, nose = rigged["lips.L"], rigged["nose.L.001"]
    above, beside = rigged["cheek.T.L.001"], rigged["cheek.B.L.001"]
    assert min(np.linalg.norm(at - mouth) for at in (nose, above, beside)) > 0.018
    assert nose[2] > mouth[2] + 0.02 and above[2] > nose[2] > beside[2]
    assert above[0] > nose[0] + 0.015 and beside[0] > mouth[0] + 0.01


def test_eyes_look_at_their_target(rig, default_head) -> None:
    """The eyeball's own vertices turn as far as the target is away."""
    import bpy

    ball = default_head.regions["eye_left"]
    bones(rig)["eyes"].location.x = 0.08
    update()
    graph = bpy.context.evaluated_depsgraph_get()
    flat = np.empty(3 * len(rig.data.vertices), np.float32)
    rig.evaluated_get(graph).data.vertices.foreach_get("co", flat)
    points, rest = flat.reshape(-1, 3)[ball], np.array([rig.data.vertices[i].co for i in ball])
    one, other = rest - rest.mean(axis=0), points - points.mean(axis=0)
    left, _, right = np.linalg.svd(one.T @ other)
    gaze = (right.T @ left.T) @ [0.0, -1.0, 0.0]
    away = bones(rig)["eye.L"].head - bones(rig)["master_eye.L"].head
    wanted = np.array(away) / away.length
    # Rounding may make the cosine of no angle more than one.
    assert np.degrees(np.arccos(min(gaze @ wanted, 1.0))) < 1.0


def test_limits_keep_handles_on_their_ways(rig) -> None:
    bones(rig)["lips.L"].location = (0.0, 1.0, 0.0)
    bones(rig)["jaw_master"].rotation_euler.x = 3.0
    bones(rig)["lips.R"].location.x = 1.0  # inwards
    wanted = {"mouthSmileLeft": 1.0, "jawOpen": 1.0, "mouthPucker": 0.5}
    assert shown(rig) == pytest.approx(wanted, abs=1e-4)


def test_head_and_neck_move_the_face(rig) -> None:
    before = place(rig)
    bones(rig)["head"].rotation_euler.y = 0.3
    turned = place(rig)
    bones(rig)["head"].rotation_euler.y = 0.0
    bones(rig)["neck"].rotation_euler.x = 0.3
    nodded = place(rig)
    assert np.abs(turned - before).max() > 0.1 and np.abs(nodded - before).max() > 0.1
    bones(rig)["neck"].rotation_euler.x = 0.0
    assert place(rig) == pytest.approx(before, abs=EXACT)
    assert not shown(rig)


def test_blenders_mirror_pose_mirrors_the_face(rig) -> None:
    import bpy

    armature = rig.facestage_face.control_rig
    bpy.context.view_layer.objects.active = armature
    bones(rig)["lips.L"].location = (0.002, 0.003, 0.0)
    bones(rig)["lid.T.L.002"].location.y = -0.004
    one = shown(rig)
    bpy.ops.object.mode_set(mode="POSE")
    if bpy.app.version >= (5, 0, 0):
        for bone in armature.pose.bones:
            bone.select = True
    else:
        bpy.ops.pose.select_all(action="SELECT")
    bpy.ops.pose.copy()
    bpy.ops.pose.paste(flipped=True)
    bpy.ops.object.mode_set(mode="OBJECT")
    swapped = {name.replace("Left", "Right"): value for name, value in one.items()}
    assert len(one) == 3 and shown(rig) == pytest.approx(swapped, abs=1e-4)


def test_sliders_and_handles_add_up(rig) -> None:
    import bpy

    keys = rig.data.shape_keys
    keys["jawOpen"] = 0.3
    keys.update_tag()
    bones(rig)["jaw_master"].rotation_euler.x = 0.1
    both = shown(rig)["jawOpen"]
    keys["jawOpen"] = 0.0
    keys.update_tag()
    assert both == pytest.approx(0.3 + shown(rig)["jawOpen"])
    assert bpy.ops.facestage.set_expression(to="NEUTRAL") == {"FINISHED"}
    assert not shown(rig)
    assert bpy.ops.facestage.apply_expression(name="Smile") == {"FINISHED"}
    assert shown(rig)["mouthSmileLeft"] == pytest.approx(0.6, abs=1e-4)


def test_adding_and_removing_change_nothing(scene, default_head) -> None:
    import bpy

    rig = build(scene, default_head)
    keys = rig.data.shape_keys.key_blocks
    keys["jawOpen"].value, keys["mouthSmileLeft"].value = 0.4, 0.2
    keys["jawOpen"].keyframe_insert("value", frame=1)
    keys["jawOpen"].value = 0.8
    keys["jawOpen"].keyframe_insert("value", frame=11)
    scene.frame_set(6)
    rig.location.x = 0.5
    objects = {item.name for item in bpy.data.objects}
    before, parent, expression = place(rig), rig.parent, shown(rig)
    assert expression["jawOpen"] == pytest.approx(0.6)
    assert bpy.ops.facestage.add_control_rig() == {"FINISHED"}
    assert place(rig) == pytest.approx(before, abs=EXACT) and shown(rig) == pytest.approx(
        expression, abs=ROUNDED
    )
    scene.frame_set(11)
    assert shown(rig)["jawOpen"] == pytest.approx(0.8)
    scene.frame_set(6)
    assert bpy.ops.facestage.remove_control_rig() == {"FINISHED"}
    assert place(rig) == pytest.approx(before, abs=EXACT) and shown(rig) == pytest.approx(
        expression, abs=ROUNDED
    )
    assert rig.parent == parent and rig.parent_type == "OBJECT"
    assert {item.name for item in bpy.data.objects} == objects
    assert not rig.data.shape_keys.animation_data.drivers and not bpy.data.armatures
    assert [name for name in ARKIT_NAMES if name in rig.data.shape_keys] == []
    keys["jawOpen"].value = 0.0
    scene.frame_set(1)
    assert shown(rig)["jawOpen"] == pytest.approx(0.4)
    refused(bpy.ops.facestage.remove_control_rig, "no control rig")
    refused(bpy.ops.facestage.bake_to_rig, "no control rig")


def test_removing_a_posed_rig_leaves_the_face_as_it_is(rig) -> None:
    import bpy

    bones(rig)["jaw_master"].rotation_euler.x = 0.1
    bones(rig)["head"].rotation_euler.y = 0.4
    expression, where = shown(rig), place(rig)
    assert bpy.ops.facestage.remove_control_rig() == {"FINISHED"}
    assert shown(rig) == pytest.approx(expression)
    assert place(rig) == pytest.approx(where, abs=EXACT)


def test_a_deleted_armature_can_be_made_again(rig) -> None:
    import bpy

    before = place(rig)
    bpy.ops.object.select_all(action="DESELECT")
    rig.facestage_face.control_rig.select_set(True)
    bpy.ops.object.delete()
    assert bpy.ops.facestage.add_control_rig() == {"FINISHED"}
    assert place(rig) == pytest.approx(before, abs=EXACT)
    bones(rig)["jaw_master"].rotation_euler.x = 0.1
    assert set(shown(rig)) == {"jawOpen"}
    assert len(bpy.data.armatures) == 1


def test_a_saved_file_keeps_the_rig(rig, tmp_path: Path) -> None:
    import bpy

    path = str(tmp_path / "rigged.blend")
    bones(rig)["lips.L"].location.y = 0.003
    expression = shown(rig)
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=path, use_scripts=False)
    rig = bpy.context.scene.facestage.rig
    assert shown(rig) == pytest.approx(expression)
    assert bones(rig)["lips.L"].custom_shape is not None
    bones(rig)["lips.L"].location.y = 0.0
    bones(rig)["jaw_master"].rotation_euler.x = 0.1
    assert set(shown(rig)) == {"jawOpen"}
    assert bpy.ops.facestage.remove_control_rig() == {"FINISHED"}


def test_a_rig_can_be_built_again_under_its_handles(rig, scene, default_head) -> None:
    import bpy

    from facestage_blender.rig.control.control_rig import renewal_steps
    from facestage_blender.rig.face_rig import build_rig

    where = place(rig)
    again = build_rig(scene, default_head, "default", scene.facestage.stage)
    list(renewal_steps(scene))
    assert again == rig and place(rig) == pytest.approx(where, abs=EXACT)
    bones(rig)["jaw_master"].rotation_euler.x = 0.1
    assert set(shown(rig)) == {"jawOpen"}
    assert len([item for item in bpy.data.objects if item.type == "ARMATURE"]) == 1


def test_a_face_without_arkits_expressions_is_refused(scene, head) -> None:
    from dataclasses import replace

    import bpy

    build(scene, replace(head, expression_names=("a", "b", "c", "d")))
    refused(bpy.ops.facestage.add_control_rig, "none of ARKit's expressions")
    assert not bpy.data.armatures


def test_what_another_driver_moves_is_left_to_it(scene, default_head) -> None:
    import bpy

    rig = build(scene, default_head)
    driver = rig.data.shape_keys.key_blocks["jawOpen"].driver_add("value").driver
    driver.expression = "0.25"
    assert bpy.ops.facestage.add_control_rig() == {"FINISHED"}
    assert rig.data.shape_keys.key_blocks["jawOpen"].driver_add("value").driver.expression == "0.25"
    assert "jawOpen" not in rig.data.shape_keys


def test_all_is_keyed(rig, scene) -> None:
    import bpy

    keys = rig.data.shape_keys
    keys["mouthSmileLeft"] = 0.5
    bones(rig)["jaw_master"].rotation_euler.x = 0.1
    scene.frame_set(10)
    assert bpy.ops.facestage.key_expression() == {"FINISHED"}
    one = shown(rig)
    assert bpy.ops.facestage.set_expression(to="NEUTRAL") == {"FINISHED"}
    scene.frame_set(20)
    assert bpy.ops.facestage.set_expression(to="NEUTRAL") == {"FINISHED"}
    assert bpy.ops.facestage.key_expression() == {"FINISHED"}
    scene.frame_set(10)
    assert shown(rig) == pytest.approx(one) and len(one) == 2
    scene.frame_set(20)
    assert not shown(rig)


@pytest.fixture
def played(rig, scene) -> dict[str, np.ndarray]:
    """Forty frames of everything at once on the sliders."""
    from facestage_blender.rig.keyframes import write_keys

    rng = np.random.default_rng(1)
    weights = {name: np.clip(rng.normal(0, 0.5, 40), 0, 1) for name in ARKIT_NAMES}
    write_keys(rig, np.arange(5.0, 45.0), weights)
    return weights


def frames_are(rig, scene, weights: dict[str, np.ndarray]) -> None:
    for frame in (5, 17, 30, 44):
        scene.frame_set(frame)
        wanted = {name: each[frame - 5] for name, each in weights.items() if each[frame - 5] > 1e-4}
        found = {name: value for name, value in shown(rig).items() if value > 1e-4}
        assert found == pytest.approx(wanted, abs=1e-4)


def test_keys_of_sliders_play_under_the_rig_and_are_given_back(rig, scene, played) -> None:
    import bpy

    frames_are(rig, scene, played)
    assert bpy.ops.facestage.remove_control_rig() == {"FINISHED"}
    frames_are(rig, scene, played)
    assert bpy.ops.facestage.add_control_rig() == {"FINISHED"}
    frames_are(rig, scene, played)


def test_baked_keys_are_the_handles_and_show_the_same(rig, scene, played) -> None:
    import bpy

    assert bpy.ops.facestage.bake_to_rig() == {"FINISHED"}
    frames_are(rig, scene, played)
    smiles = played["mouthSmileLeft"] - played["mouthFrownLeft"]
    for frame in (smiles.argmax(), smiles.argmin()):
        scene.frame_set(5 + int(frame))
        assert np.sign(bones(rig)["lips.L"].location.y) == np.sign(smiles[frame]) != 0
    scene.frame_set(5 + int(played["jawOpen"].argmax()))
    assert bones(rig)["jaw_master"].rotation_euler.x > 0
    # What can be told apart is wholly the handles'.
    blinks = np.where(played["eyeWideLeft"] == 0, played["eyeBlinkLeft"], 0)
    assert blinks.max() > 0
    scene.frame_set(5 + int(blinks.argmax()))
    assert rig.data.shape_keys["eyeBlinkLeft"] == 0
    assert bpy.ops.facestage.bake_to_rig() == {"FINISHED"}  # keyed handles stay
    frames_are(rig, scene, played)


def test_a_still_expression_is_baked(rig) -> None:
    import bpy

    assert bpy.ops.facestage.apply_expression(name="Laugh") == {"FINISHED"}
    bones(rig)["brow.T.L"].location.y = 0.003
    bones(rig)["eyes"].location.x = 0.05
    one = shown(rig)
    assert bpy.ops.facestage.bake_to_rig() == {"FINISHED"}
    assert shown(rig) == pytest.approx(one, abs=1e-4)
    assert bones(rig)["lips.L"].location.y > 0.004
    assert not any(rig.data.shape_keys[name] for name in ARKIT_NAMES)


def test_the_action_of_another_face_stays_as_it_is(rig, scene, played) -> None:
    """Two faces may play one action: baking one must not take it from the other."""
    import bpy

    shapes = rig.data.shape_keys
    action = shapes.animation_data.action
    other = bpy.data.objects.new("Other", bpy.data.meshes.new("Other"))
    other.shape_key_add(name="Basis")
    other.data.shape_keys.animation_data_create().action = action
    curves = _count(action)
    assert bpy.ops.facestage.bake_to_rig() == {"FINISHED"}
    assert other.data.shape_keys.animation_data.action == action and _count(action) == curves
    assert shapes.animation_data.action != action
    frames_are(rig, scene, played)


def _count(action) -> int:
    if hasattr(action, "fcurves"):
        return len(action.fcurves)
    return len(action.layers[0].strips[0].channelbags[0].fcurves)

"""Scene -> job -> result -> scene: what is read is what was written."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.face_model import FaceModel
from facestage.contract.folds import Folds
from facestage.contract.job import Job
from facestage.contract.light_stage import joined, lights_behind, selected
from facestage.contract.parameters import PARAMETERS
from facestage.contract.result import Result
from facestage.contract.texture_maps import FOLD_MAP
from facestage.images.image_io import write_exr
from facestage_blender.backend.commands import fit_command
from facestage_blender.skin.material import skin_nodes
from reference.known import known


@pytest.fixture
def ready(scene, head: FaceModel, photo: Path, landmark_file: Path):
    """A scene with everything set up for a fit."""
    from facestage_blender.exchange.photos import choose_photo
    from facestage_blender.landmarks.editing import choose_landmarks
    from facestage_blender.rig.face_rig import build_rig
    from facestage_blender.scene.stage import build_stage, default_stage

    empty = build_stage(scene, default_stage(5, 1.0, 0.2))
    empty.location, empty.rotation_euler = (0.5, 0.25, 1.5), (0.1, 0.2, 0.7)
    build_rig(scene, head, "default", empty)
    choose_photo(scene, photo)
    choose_landmarks(scene, landmark_file)
    return scene


def fitted(scene, stand_in: Callable[[str], list[str]], folder: Path) -> Result:
    from facestage_blender.exchange.scene_read import read_job

    read_job(scene).save(folder / "job")
    subprocess.run(
        fit_command(stand_in("works"), [folder / "job"], folder / "result"),
        check=True,
        capture_output=True,
    )
    return Result.load(folder / "result")


def pose_handles(scene) -> None:
    """A control rig whose handles are not at rest."""
    from facestage_blender.rig.control.control_rig import add_control_rig

    bones = add_control_rig(scene).pose.bones
    bones["jaw_master"].rotation_euler.x = bones["head"].rotation_euler.y = 0.2
    bones["neck"].rotation_euler.z = 0.1


def camera_vertices(scene) -> np.ndarray:
    """(n, 3) the rig's vertices as shown, in the camera frame."""
    import bpy

    rig = scene.facestage.rig
    shown = rig.evaluated_get(bpy.context.evaluated_depsgraph_get())
    flat = np.empty(3 * len(shown.data.vertices), np.float32)
    shown.data.vertices.foreach_get("co", flat)
    matrix = np.array(scene.camera.matrix_world.inverted() @ rig.matrix_world)
    return flat.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]


def test_job_holds_what_the_scene_says(ready, tmp_path: Path) -> None:
    from facestage_blender.exchange.scene_read import read_job

    settings = ready.facestage
    settings.freeze, settings.light_color, settings.budget = (
        {"identity", "roughness"},
        "uniform",
        12.5,
    )
    settings.weight_prior, settings.seed, settings.device = 2.0, 7, "cpu"
    settings.surround, settings.exposure_known = "on", False
    settings.rig.data.shape_keys.key_blocks["identity/mode_2"].value = 1.5
    read_job(ready).save(tmp_path / "job")
    job = Job.load(tmp_path / "job")
    assert job.freeze == ("identity", "roughness")
    assert (job.surround, job.exposure) == ("on", "unknown")
    assert (job.light_color, job.budget_seconds, job.seed, job.device) == (
        "uniform",
        12.5,
        7,
        "cpu",
    )
    assert (job.weights.prior, job.weights.photo) == (2.0, 1.0)
    assert (job.camera, job.camera_to_stage) == (None, None)
    np.testing.assert_allclose(job.initial["identity"], [0, 0, 1.5, 0, 0, 0])
    assert float(job.initial["roughness"]) == pytest.approx(0.45)
    assert "expression" not in job.initial
    assert known(job.landmarks).scheme == "ibug68"
    assert len(known(job.stage)) == 5
    assert job.image.read_bytes() == Path(settings.photo).read_bytes()


def test_every_parameter_can_be_frozen(ready) -> None:
    from facestage_blender.exchange.scene_read import read_job

    for name in PARAMETERS:
        ready.facestage.freeze = {name}
        assert read_job(ready).freeze == (name,)


def test_relief_is_one_more_shape_key_until_a_result_has_none(
    ready, stand_in, tmp_path: Path
) -> None:
    from facestage_blender.exchange.write_back import apply_result
    from facestage_blender.rig.face_rig import read_weights
    from facestage_blender.rig.relief_key import NAME

    plain = fitted(ready, stand_in, tmp_path)
    relief = 1e-3 * np.random.default_rng(5).normal(size=plain.vertices.shape)
    vertices = plain.vertices + relief @ plain.model_to_camera[:3, :3].T
    result = replace(plain, vertices=vertices, arrays=plain.arrays | {"relief": relief})
    apply_result(ready, result)
    np.testing.assert_allclose(camera_vertices(ready), result.vertices, atol=2e-6)
    keys = ready.facestage.rig.data.shape_keys.key_blocks
    weights, count = read_weights(ready.facestage.rig), len(keys)
    assert [len(part) for part in weights] == [len(plain.identity), len(plain.expression)]
    apply_result(ready, result)
    assert len(keys) == count
    np.testing.assert_allclose(camera_vertices(ready), result.vertices, atol=2e-6)
    with pytest.raises(InputError, match="relief has 3 vertices"):
        apply_result(ready, replace(result, arrays={"relief": relief[:3]}))
    assert NAME in keys
    apply_result(ready, plain)
    assert NAME not in keys
    np.testing.assert_allclose(camera_vertices(ready), plain.vertices, atol=2e-6)


def test_folds_are_driven_until_a_result_has_none(ready, stand_in, tmp_path: Path) -> None:
    import bpy

    from facestage_blender.exchange.write_back import apply_result
    from facestage_blender.rig.face_rig import set_weights
    from facestage_blender.skin.folds import ATTRIBUTE, gone_path

    plain = fitted(ready, stand_in, tmp_path)
    pull = np.zeros((3, len(plain.expression)))
    pull[0, 2] = 1 / plain.expression[2]
    given = Folds(np.tile([1.0, 0.0, 0.0], (len(plain.vertices), 1)), pull)
    write_exr(known(plain.folder) / FOLD_MAP.file, np.full((8, 8, 3), 0.8))
    apply_result(ready, replace(plain, arrays=plain.arrays | given.arrays))
    rig, name = ready.facestage.rig, plain.expression_names[2]
    (tree,) = (tree for tree, _ in skin_nodes(rig))
    for share in (1.0, 0.25, 0.0):
        set_weights(rig, {}, {name: share * float(plain.expression[2])})
        bpy.context.view_layer.update()
        found = tree.path_resolve(gone_path())[0]
        assert found == pytest.approx(1 - share, abs=1e-3)
    assert ATTRIBUTE in rig.data.attributes
    (known(plain.folder) / FOLD_MAP.file).unlink()
    apply_result(ready, plain)
    assert ATTRIBUTE not in rig.data.attributes
    assert not [each for each in bpy.data.images if "Folds" in each.name]


@pytest.mark.parametrize("handles", [False, True])
def test_result_is_shown_where_the_fit_had_it(
    ready, stand_in, tmp_path: Path, handles: bool
) -> None:
    from facestage_blender.exchange.scene_read import (
        read_camera_to_stage,
        read_job,
        read_model_to_stage,
    )
    from facestage_blender.exchange.write_back import apply_result

    world = ready.world
    result = fitted(ready, stand_in, tmp_path)
    if handles:
        pose_handles(ready)
    apply_result(ready, result)
    np.testing.assert_allclose(camera_vertices(ready), result.vertices, atol=2e-6)
    np.testing.assert_allclose(read_camera_to_stage(ready), result.camera_to_stage, atol=1e-6)
    np.testing.assert_allclose(read_model_to_stage(ready), result.model_to_stage, atol=1e-6)
    ready.facestage.keep_camera = ready.facestage.start_from_rig = True
    job = read_job(ready)
    np.testing.assert_allclose(known(job.stage).radiance, result.stage.radiance, rtol=1e-5)
    np.testing.assert_allclose(known(job.stage).position, result.stage.position, atol=1e-6)
    np.testing.assert_allclose(job.initial["identity"], result.identity, atol=1e-6)
    np.testing.assert_allclose(job.initial["expression"], result.expression, atol=1e-6)
    np.testing.assert_allclose(job.initial["model_to_camera"], result.model_to_camera, atol=1e-6)
    assert float(job.initial["roughness"]) == pytest.approx(result.roughness)
    assert known(job.camera).focal_px == pytest.approx(result.camera.focal_px, rel=1e-6)
    assert known(job.camera).principal_px == pytest.approx(result.camera.principal_px, abs=1e-3)
    assert ready.world == world


def test_lights_that_joined_from_behind_are_shown_and_fitted_again(
    ready, stand_in, tmp_path: Path
) -> None:
    from facestage_blender.exchange.scene_read import read_job
    from facestage_blender.exchange.write_back import apply_result
    from facestage_blender.scene.stage import new_stage, stage_lights

    plain = fitted(ready, stand_in, tmp_path)
    behind = selected(known(lights_behind(plain.stage)), np.array([1, 4, 6]))
    stage = joined(plain.stage, behind.with_radiance(np.full((3, 3), 7.5)))
    apply_result(ready, replace(plain, stage=stage))
    shown = stage_lights(ready.facestage.stage)
    assert len(shown) == len(plain.stage) + 3
    # A face looks along -Y.
    assert all(light.matrix_basis.translation.y > 0 for light in shown[-3:])
    found = known(read_job(ready).stage)
    np.testing.assert_allclose(found.position, stage.position, atol=1e-6)
    np.testing.assert_allclose(found.radiance, stage.radiance, rtol=1e-5)
    assert lights_behind(found) is None, "nothing joins them"
    new_stage(ready)
    assert len(stage_lights(ready.facestage.stage)) == ready.facestage.light_count


def test_textures_are_packed_and_linear(ready, stand_in, tmp_path: Path) -> None:
    import bpy

    from facestage_blender.exchange.write_back import apply_result
    from facestage_blender.pictures.render import read_pixels

    result = fitted(ready, stand_in, tmp_path)
    apply_result(ready, result)
    apply_result(ready, result)
    face = ready.facestage.rig.facestage_face
    for image in (face.albedo_image, face.specular_image, face.roughness_image):
        assert image.packed_file is not None
        colored = image is face.albedo_image
        assert image.colorspace_settings.name == ("Linear Rec.709" if colored else "Non-Color")
    assert len(bpy.data.images) == 4  # with the photo: nothing is left behind by the second time
    specular = np.array(face.specular_image.pixels).reshape(16, 16, 4)[::-1]
    np.testing.assert_array_equal(specular, read_pixels(known(result.folder) / "specular.exr"))
    assert (specular[..., 0] == specular[..., 1]).all()
    for material in ready.facestage.rig.data.materials:
        assert material.node_tree.nodes["Albedo"].image == face.albedo_image
        assert material.node_tree.nodes["Specular"].image == face.specular_image
        roughness = material.node_tree.nodes["Facestage Skin"].inputs["Roughness"]
        assert roughness.links[0].from_node.image == face.roughness_image


def test_a_result_without_a_roughness_map_has_one_value(ready, stand_in, tmp_path: Path) -> None:
    from facestage_blender.exchange.write_back import apply_result

    result = fitted(ready, stand_in, tmp_path)
    apply_result(ready, result)
    (known(result.folder) / "roughness.exr").unlink()
    apply_result(ready, result)
    assert ready.facestage.rig.facestage_face.roughness_image is None
    for material in ready.facestage.rig.data.materials:
        roughness = material.node_tree.nodes["Facestage Skin"].inputs["Roughness"]
        assert not roughness.links and roughness.default_value == pytest.approx(result.roughness)


@pytest.mark.parametrize("handles", [False, True])
def test_kept_camera_stays_and_the_head_moves(
    ready, stand_in, tmp_path: Path, handles: bool
) -> None:
    from facestage_blender.exchange.write_back import apply_result

    ready.facestage.keep_camera = True
    ready.camera.location, ready.camera.data.lens = (0.4, -0.9, 1.6), 61.0
    ready.view_layers[0].update()
    before = ready.camera.matrix_world.copy()
    result = fitted(ready, stand_in, tmp_path)
    if handles:
        pose_handles(ready)
    apply_result(ready, result)
    assert ready.camera.matrix_world == before
    assert ready.camera.data.lens == 61.0
    np.testing.assert_allclose(camera_vertices(ready), result.vertices, atol=2e-6)


def test_what_is_missing_is_said(scene, ready, stand_in, tmp_path: Path) -> None:
    from facestage_blender.exchange.scene_read import read_job
    from facestage_blender.exchange.write_back import apply_result

    result = fitted(ready, stand_in, tmp_path)
    (known(result.folder) / "albedo.exr").unlink()
    with pytest.raises(InputError, match="albedo"):
        apply_result(ready, result)
    ready.facestage.rig.facestage_face.model = "ict:/there"
    with pytest.raises(InputError, match="ict:/there"):
        apply_result(ready, result)
    ready.facestage.photo = ""
    with pytest.raises(InputError, match="Choose Photo"):
        read_job(ready)


def test_skin_knows_how_light_comes_out_of_it(ready, stand_in, tmp_path: Path) -> None:
    """As much as the fit found, of the shape that it found; older results say nothing of it."""
    from facestage.contract.curvature import Curvature
    from facestage_blender.exchange.write_back import apply_result

    result = fitted(ready, stand_in, tmp_path)
    older = {name: value for name, value in result.further.items() if name != "translucency"}
    apply_result(ready, replace(result, further=older | {"translucency": np.array(0.7)}))
    rig = ready.facestage.rig
    skin, eyes = (
        next(
            slot.material.node_tree.nodes["Facestage Skin"].inputs["Translucency"]
            for slot in rig.material_slots
            if slot.material.name == name
        )
        for name in ("Facestage Skin", "Facestage Eyes")
    )
    assert (skin.default_value, eyes.default_value) == (pytest.approx(0.7), 0.0)
    shown = np.empty(len(rig.data.vertices), np.float32)
    rig.data.attributes["facestage_curvature"].data.foreach_get("value", shown)
    wanted = Curvature(result.triangles, len(result.vertices)).of(result.vertices)
    np.testing.assert_allclose(shown, wanted, atol=1.0)
    assert np.ptp(wanted) > 30
    moved = result.vertices * [1.0, 1.0, 0.8]
    scattering = older | {"scattering": np.array(0.5)}
    apply_result(ready, replace(result, further=scattering, vertices=moved))
    rig.data.attributes["facestage_curvature"].data.foreach_get("value", shown)
    np.testing.assert_allclose(shown, Curvature(result.triangles, len(moved)).of(moved), atol=1.0)
    apply_result(ready, replace(result, further=older))
    assert skin.default_value == 0.0
    assert "facestage_curvature" not in rig.data.attributes


def test_relief_comes_with_a_result_and_goes_with_an_older_one(
    ready, stand_in: Callable[[str], list[str]], tmp_path: Path
) -> None:
    """Beside eyes of their own, whose material places its picture by further nodes."""
    from facestage_blender.exchange.write_back import apply_result
    from facestage_blender.pictures.render import save_exr
    from facestage_blender.skin.displaced_skin import displace, is_displaced

    result = fitted(ready, stand_in, tmp_path)
    folder = known(result.folder)
    save_exr(folder / "normal.exr", np.full((8, 8, 3), (0.6, 0.5, 0.99), np.float32))
    save_exr(folder / "height.exr", np.full((8, 8, 3), 0.1, np.float32))
    save_exr(folder / "eyes.exr", np.full((8, 8, 3), 0.2, np.float32))
    rig = ready.facestage.rig
    skins = [slot.material.node_tree.nodes.get("Facestage Skin") for slot in rig.material_slots]
    normals = [node.inputs["Normal"] for node in skins if node is not None]
    for _ in range(2):
        apply_result(ready, result)
        assert len(normals) > 1 and all(each.is_linked for each in normals)
        assert rig.facestage_face.normal_image.colorspace_settings.name == "Non-Color"
        displace(rig, True)
        assert is_displaced(rig) and not any(each.is_linked for each in normals)
    for name in ("normal", "height", "eyes"):
        (folder / f"{name}.exr").unlink()
    apply_result(ready, result)
    assert not is_displaced(rig) and not any(each.is_linked for each in normals)
    assert rig.facestage_face.height_image is None


def test_handles_go_where_the_fitted_skin_is(ready, stand_in, tmp_path: Path) -> None:
    from facestage_blender.exchange.write_back import apply_result
    from facestage_blender.rig.control.control_rig import add_control_rig

    armature = add_control_rig(ready)
    before = armature.data.bones["jaw_master"].tail_local.copy()
    apply_result(ready, fitted(ready, stand_in, tmp_path))
    after = armature.data.bones["jaw_master"].tail_local.copy()
    assert (after - before).length > 1e-4
    add_control_rig(ready)  # nothing changes where it is fitted already
    assert (armature.data.bones["jaw_master"].tail_local - after).length < 1e-6


def test_handles_are_placed_anew_only_for_another_shape(ready, stand_in, tmp_path: Path) -> None:
    from facestage_blender.exchange.write_back import apply_result, apply_steps
    from facestage_blender.rig.control.control_rig import add_control_rig

    armature = add_control_rig(ready)
    result = fitted(ready, stand_in, tmp_path)
    assert len(list(apply_steps(ready, result))) == 8  # pictures, shape, skin, certainty, handles
    place = armature.data.bones["jaw_master"].tail_local.copy()
    lengthen(armature, "jaw_master")
    longer = armature.data.bones["jaw_master"].tail_local.copy()
    assert (longer - place).length > 1e-3
    smiling = replace(result, expression=0.5 * result.expression)
    assert len(list(apply_steps(ready, smiling))) == 6
    assert (armature.data.bones["jaw_master"].tail_local - longer).length < 1e-6
    apply_result(ready, replace(result, identity=0.5 * result.identity))
    assert (armature.data.bones["jaw_master"].tail_local - longer).length > 1e-3
    lengthen(armature, "jaw_master")
    add_control_rig(ready)  # whoever asks for it gets it
    apply_result(ready, result)
    assert (armature.data.bones["jaw_master"].tail_local - place).length < 1e-6


def lengthen(armature, bone: str) -> None:
    """Put the end of a bone elsewhere by hand."""
    import bpy

    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    armature.data.edit_bones[bone].tail.z += 0.01
    bpy.ops.object.mode_set(mode="OBJECT")

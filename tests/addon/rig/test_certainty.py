"""A result's deviations on the mesh: their values, their colors, where they are shown and where
not.
"""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib import colormaps

from addon.stand_in_results import made_up
from addon.ui.refusal import refused
from facestage.contract.face_model import FaceModel
from facestage.contract.result import Result
from reference.known import known

FACE = np.arange(400, 900)


@pytest.fixture
def result(
    scene, head: FaceModel, photo: Path, landmark_file: Path, stand_in, tmp_path: Path
) -> Result:
    """A scene with a rig that has a narrow face, and a result with deviations on disk."""
    import bpy

    from facestage_blender.exchange.photos import choose_photo
    from facestage_blender.exchange.scene_read import read_job
    from facestage_blender.landmarks.editing import choose_landmarks
    from facestage_blender.rig.face_rig import build_rig
    from facestage_blender.scene.stage import build_stage, default_stage

    stand_in("works")
    build_rig(
        scene,
        replace(head, regions={"narrow_face": FACE}),
        "default",
        build_stage(scene, default_stage(5, 1.0, 0.2)),
    )
    choose_photo(scene, photo)
    choose_landmarks(scene, landmark_file)
    scene.facestage.output = str(tmp_path / "out")
    assert bpy.ops.facestage.fit(apply=False) == {"FINISHED"}
    folder = Path(scene.facestage.result)
    plain = made_up(read_job(scene), head, 2)
    deviation = np.random.default_rng(6).gamma(2.0, 0.4, plain.vertices.shape)
    deviation[FACE] *= 0.3
    deviation[0, 0] = np.inf
    shutil.copytree(folder, tmp_path / "sure")
    replace(plain, arrays={"vertex_deviation_mm": deviation}).write_into(tmp_path / "sure")
    return Result.load(tmp_path / "sure")


def total_mm(result: Result) -> np.ndarray:
    """As the file has them."""
    with np.load(known(result.folder) / "result.npz") as arrays:
        values = arrays["extra/vertex_deviation_mm"]
    return np.sqrt((np.where(np.isfinite(values), values, 0) ** 2).sum(axis=1))


def apply(result: Result) -> None:
    import bpy

    assert bpy.ops.facestage.apply_result(folder=str(result.folder)) == {"FINISHED"}


def read(mesh, name: str, kind: str, width: int) -> np.ndarray:
    flat = np.empty(width * len(mesh.vertices), np.float32)
    mesh.attributes[name].data.foreach_get(kind, flat)
    return flat.reshape(-1, width)


def shading():
    """Of the one 3D view."""
    import bpy

    screen = bpy.context.window_manager.windows[0].screen
    return next(area for area in screen.areas if area.type == "VIEW_3D").spaces.active.shading


def test_values_are_the_files_and_colors_the_reports(scene, result: Result) -> None:
    for _ in range(2):
        apply(result)
        mesh, total = scene.facestage.rig.data, total_mm(result)
        np.testing.assert_allclose(
            read(mesh, "facestage_deviation_mm", "value", 1)[:, 0], total, rtol=1e-6
        )
        names = {each.name for each in mesh.attributes if each.name.startswith("Facestage")}
        assert names == {"Facestage Certainty"}
        end = 1.0  # above the narrow face's 97 percent; the whole head's would be 5
        assert 0.5 < np.percentile(total[FACE], 97) < end < np.percentile(total, 97)
        wanted = colormaps["viridis"](np.clip(total / end, 0, 1))[:, :3]
        data = mesh.attributes["Facestage Certainty"].data
        found = np.array([each.color_srgb[:3] for each in data])
        np.testing.assert_allclose(found, wanted, atol=6 / 255)


def test_the_users_colors_stay_the_ones_that_are_drawn_and_rendered(scene, result: Result) -> None:
    mesh = scene.facestage.rig.data
    apply(result)
    assert (mesh.attributes.active_color_name, mesh.attributes.default_color_name) == ("", "")
    mesh.color_attributes.new("Paint", "BYTE_COLOR", "CORNER")
    mesh.attributes.active_color_name = mesh.attributes.default_color_name = "Paint"
    apply(result)
    assert mesh.attributes.active_color_name == mesh.attributes.default_color_name == "Paint"


def test_the_toggle_shows_them_and_gives_back_what_was_shown(scene, result: Result) -> None:
    import bpy

    turn, mesh = bpy.ops.facestage.show_certainty, scene.facestage.rig.data
    apply(result)
    shading().type = "WIREFRAME"
    for state in ("ON", "ON", "OFF", "OFF", "TOGGLE", "TOGGLE"):
        assert turn(state=state) == {"FINISHED"}
        on = mesh.attributes.active_color_name == "Facestage Certainty"
        if state != "TOGGLE":
            assert on == (state == "ON")
        if on:
            assert (shading().type, shading().color_type) == ("SOLID", "VERTEX")
        else:
            assert (shading().type, shading().color_type) == ("WIREFRAME", "TEXTURE")
        assert mesh.attributes.default_color_name == ""
        # What is drawn is a copy of the mesh, which is made anew only where it is said to be.
        drawn = scene.facestage.rig.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        assert drawn.attributes.active_color_name == mesh.attributes.active_color_name
    turn(state="ON")
    apply(result)
    assert mesh.attributes.active_color_name == "Facestage Certainty"
    assert shading().color_type == "VERTEX"
    shading().type = "RENDERED"  # by hand since
    turn(state="OFF")
    assert shading().type == "RENDERED"


def test_showing_is_one_undo_step(scene, result: Result) -> None:
    import bpy

    apply(result)
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.facestage.show_certainty(state="ON")
    bpy.ops.ed.undo_push(message="Show Certainty")
    assert shading().color_type == "VERTEX"
    bpy.ops.ed.undo()
    mesh = bpy.context.scene.facestage.rig.data
    assert (mesh.attributes.active_color_name, shading().color_type) == ("", "TEXTURE")
    bpy.ops.ed.redo()
    mesh = bpy.context.scene.facestage.rig.data
    assert mesh.attributes.active_color_name == "Facestage Certainty"
    assert shading().color_type == "VERTEX"


def test_an_older_result_takes_them_away_and_the_button_says_why(scene, result: Result) -> None:
    import bpy

    turn = bpy.ops.facestage.show_certainty
    refused(turn, "no standard deviations")
    apply(result)
    turn(state="ON")
    replace(result, arrays={}).write_into(known(result.folder))
    apply(result)
    names = scene.facestage.rig.data.attributes.keys()
    assert not {"Facestage Certainty", "facestage_deviation_mm"} & set(names)
    assert shading().color_type == "TEXTURE"
    refused(turn, "no standard deviations")


def test_a_rig_built_anew_gives_the_views_back(scene, head: FaceModel, result: Result) -> None:
    import bpy

    from facestage_blender.rig.face_rig import build_rig

    apply(result)
    bpy.ops.facestage.show_certainty(state="ON")
    build_rig(scene, head, "default", scene.facestage.stage)
    assert shading().color_type == "MATERIAL"


@pytest.mark.parametrize("shown", [False, True])
@pytest.mark.parametrize("suffix", [".glb", ".fbx", ".usdc", ".obj"])
def test_exported_files_hold_none(
    scene, result: Result, tmp_path: Path, suffix: str, shown: bool
) -> None:
    import bpy

    from addon.exchange.test_export import imported
    from facestage_blender.exchange.export import export_face

    apply(result)
    bpy.ops.facestage.show_certainty(state="ON" if shown else "OFF")
    path = export_face(scene, tmp_path / f"face{suffix}")[0]
    assert bpy.ops.facestage.show_certainty.poll()
    assert shading().color_type == ("VERTEX" if shown else "TEXTURE")
    face = imported(scene, path)
    there = face.data
    marks = {"facestage_skin", "facestage_color_before"}
    assert not marks & (set(face.keys()) | set(there.keys()))
    assert not there.color_attributes
    assert not [each.name for each in there.attributes if "facestage_dev" in each.name]


def test_a_mesh_of_the_users_keeps_the_face_for_the_scale(
    scene, head: FaceModel, result: Result
) -> None:
    from facestage_blender.rig.certainty import remember_region, write_certainty

    rig, deviation = scene.facestage.rig, result.arrays["vertex_deviation_mm"]
    rig.vertex_groups.clear()
    rig.facestage_face.own_mesh = "{}"
    found = []
    for regions in ({}, {"narrow_face": FACE}):
        remember_region(rig.data, replace(head, regions=regions))
        write_certainty(rig, deviation)
        found.append(read(rig.data, "Facestage Certainty", "color", 4))
    assert found[0][FACE].mean() != pytest.approx(found[1][FACE].mean(), rel=0.05)

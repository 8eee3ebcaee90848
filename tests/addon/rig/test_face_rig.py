"""The rig against the model it was built from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.face_model import FaceModel


@pytest.fixture
def rig(scene, head: FaceModel):
    from facestage_blender.rig.face_rig import build_rig
    from facestage_blender.scene.stage import build_stage, default_stage

    return build_rig(scene, head, "default", build_stage(scene, default_stage(4, 1.0, 0.2)))


def stage_vertices(rig) -> np.ndarray:
    """(n, 3) vertices of the rig as Blender shows them, in the stage frame."""
    import bpy

    from facestage_blender.scene import frames

    shown = rig.evaluated_get(bpy.context.evaluated_depsgraph_get())
    flat = np.empty(3 * len(shown.data.vertices), np.float32)
    shown.data.vertices.foreach_get("co", flat)
    local = flat.reshape(-1, 3)
    matrix = np.array(rig.parent.matrix_world.inverted() @ rig.matrix_world)
    return frames.points_to_stage(local @ matrix[:3, :3].T + matrix[:3, 3])


def test_sliders_make_the_models_shapes(rig, head: FaceModel) -> None:
    from facestage_blender.rig.face_rig import read_weights, set_weights

    rng = np.random.default_rng(0)
    identity, expression = rng.normal(size=6) * 2, rng.uniform(0, 1, 4)
    np.testing.assert_allclose(stage_vertices(rig), head.vertices, atol=1e-7)
    identity_by_name = dict(zip(head.identity_names, identity, strict=True))
    expression_by_name = dict(zip(head.expression_names, expression, strict=True))
    set_weights(rig, identity_by_name, expression_by_name)
    np.testing.assert_allclose(stage_vertices(rig), head.shape(identity, expression), atol=1e-6)
    found = read_weights(rig)
    assert list(found[0]) == list(head.identity_names)
    assert found[0] == pytest.approx(identity_by_name, abs=1e-6)
    assert found[1] == pytest.approx(expression_by_name, abs=1e-6)


def test_mesh_has_the_models_polygons_uvs_parts_and_regions(rig, head: FaceModel) -> None:
    mesh = rig.data
    assert [len(polygon.vertices) for polygon in mesh.polygons] == [
        3 + (quad[3] >= 0) for quad in head.polygons
    ]
    for index in (0, 7, len(head.polygons) - 1):
        polygon = mesh.polygons[index]
        corners = head.polygons[index][head.polygons[index] >= 0]
        assert list(polygon.vertices) == corners.tolist()
        uvs = [mesh.uv_layers["UVMap"].uv[loop].vector[:] for loop in polygon.loop_indices]
        np.testing.assert_allclose(
            uvs, head.uvs[head.polygon_uvs[index][: len(corners)]], atol=1e-7
        )
        assert polygon.use_smooth
    assert [polygon.material_index for polygon in mesh.polygons] == head.polygon_part.tolist()
    assert [material.name for material in mesh.materials] == ["Facestage Skin", "Facestage Eyes"]
    group = rig.vertex_groups["nose"].index
    members = [
        vertex.index
        for vertex in mesh.vertices
        if any(entry.group == group for entry in vertex.groups)
    ]
    assert members == sorted(head.regions["nose"])
    assert not mesh.validate()


def test_slider_ranges_follow_the_prior(scene, rig, head: FaceModel) -> None:
    from facestage_blender.rig.face_rig import build_rig, set_weights

    keys = rig.data.shape_keys.key_blocks
    assert (keys["identity/mode_0"].slider_min, keys["identity/mode_0"].slider_max) == (-5, 5)
    assert (keys["mode_0"].slider_min, keys["mode_0"].slider_max) == (0, 1)
    set_weights(rig, {"mode_0": 7.5}, {})
    assert keys["identity/mode_0"].value == 7.5
    gaussian = build_rig(scene, replace(head, expression_prior="gaussian"), "default", rig.parent)
    assert gaussian.data.shape_keys.key_blocks["mode_0"].slider_min == -5
    words = ("gaussian",) + ("box",) * (len(head.expression_names) - 1)
    mixed = build_rig(
        scene, replace(head, expression_prior=words), "default", rig.parent
    ).data.shape_keys.key_blocks
    assert [mixed[name].slider_min for name in head.expression_names] == [-5, 0, 0, 0]


def test_rebuilding_leaves_one_rig_and_nothing_behind(scene, rig, head: FaceModel) -> None:
    import bpy

    from facestage_blender.rig.face_rig import build_rig

    rig.location = (1, 2, 3)
    assert build_rig(scene, head, "ict:/somewhere", rig.parent) == rig
    assert tuple(rig.location) == (1, 2, 3)
    assert rig.facestage_face.model == "ict:/somewhere"
    assert (len(bpy.data.meshes), len(bpy.data.materials), len(bpy.data.shape_keys)) == (1, 2, 1)
    assert len(bpy.data.images) == 2
    assert len(rig.vertex_groups) == 1


def test_first_texture_is_the_models_mean_albedo(rig, head: FaceModel) -> None:
    from facestage_blender.pictures.images import image_pixels

    pixels = image_pixels(rig.facestage_face.albedo_image)
    centre = head.polygons[700]
    u, v = head.uvs[head.polygon_uvs[700]].mean(axis=0)
    size = len(pixels)
    np.testing.assert_allclose(
        pixels[int((1 - v) * size), int(u * size), :3],
        head.albedo_mean[centre].mean(axis=0),
        atol=0.01,
    )


def test_unknown_slider_is_named_before_anything_moves(rig) -> None:
    from facestage_blender.rig.face_rig import read_weights, set_weights

    before = read_weights(rig)
    with pytest.raises(InputError, match="tailWag"):
        set_weights(rig, {"mode_0": 1.0}, {"tailWag": 1.0})
    assert read_weights(rig) == before

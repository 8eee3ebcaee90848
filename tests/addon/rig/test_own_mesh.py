"""A mesh of the user's: read with all its peculiarities, marked, and written back to."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.camera import Camera
from facestage.contract.errors import InputError
from facestage.contract.face_model import FaceModel
from facestage.contract.light_stage import fibonacci_stage
from facestage.contract.result import CONVERGED, Result
from reference.known import known


@pytest.fixture
def alice(scene, head: FaceModel):
    """The egg in centimetres, Z up, scaled and turned under a parent, with odd sliders and a
    modifier.
    """
    import bpy

    from facestage_blender.rig.face_rig import add_shape_keys, build_mesh

    mesh = build_mesh(head)
    item = bpy.data.objects.new("Alice", mesh)
    scene.collection.objects.link(item)
    add_shape_keys(item, head)
    keys = mesh.shape_keys.key_blocks
    for name in [key.name for key in keys if key.name.startswith("identity/")]:
        item.shape_key_remove(keys[name])
    flat = np.empty(3 * len(mesh.vertices), np.float32)
    for data in (*(key.data for key in keys), mesh.vertices):
        data.foreach_get("co", flat)
        data.foreach_set("co", 100 * flat)
    keys["jawOpen"].slider_max, keys["browUp"].slider_min = 2.0, -1.0
    keys["blink"].mute = True
    parent = bpy.data.objects.new("Parent", None)
    scene.collection.objects.link(parent)
    parent.location, parent.rotation_euler = (1, 2, 3), (0, 0, 1)
    item.parent, item.scale, item.rotation_euler = parent, (0.01, 0.01, 0.01), (0.3, 0, 0.5)
    item.modifiers.new("Subdivision", "SUBSURF")
    scene.view_layers[0].update()
    scene.view_layers[0].objects.active = item
    return item


def model_of(rig, head: FaceModel) -> FaceModel:
    """What the backend makes of the mesh, without searching for its face."""
    from facestage_blender.scene import frames

    turn = frames.stage_to_blender()
    scaled = np.array(rig.scale)
    return FaceModel(
        name=rig.name,
        license="yours",
        source="",
        vertices=(rig.vertices * scaled @ turn + 0.01).astype(np.float32),
        polygons=rig.polygons,
        polygon_uvs=rig.polygon_uvs,
        polygon_part=np.minimum(rig.polygon_part, 4),
        uvs=rig.uvs,
        identity_names=head.identity_names,
        identity_basis=head.identity_basis,
        expression_names=rig.expression_names,
        expression_basis=(rig.expression_offsets * scaled @ turn).astype(np.float32),
        albedo_mean=head.albedo_mean,
        albedo_basis=head.albedo_basis,
        landmarks={},
    )


def result_of(model: FaceModel, identity: np.ndarray, expression: np.ndarray) -> Result:
    """A result of this model with a head pose."""
    pose = np.eye(4)
    pose[:3, :3] = [[0.8, 0, 0.6], [0, 1, 0], [-0.6, 0, 0.8]]
    pose[:3, 3] = 0.02, -0.01, -0.6
    to_stage = np.eye(4)
    to_stage[2, 3] = 0.6
    vertices = model.shape(identity, expression) @ pose[:3, :3].T + pose[:3, 3]
    return Result(
        status=CONVERGED,
        advice="",
        model="rig:x",
        camera=Camera.default(96, 80),
        camera_to_stage=to_stage,
        model_to_camera=pose,
        identity=identity,
        expression=expression,
        albedo=np.zeros(3),
        specular=np.ones((4, 4), np.float32),
        roughness=0.5,
        stage=fibonacci_stage(3),
        vertices=vertices,
        triangles=model.triangles,
        identity_names=model.identity_names,
        expression_names=model.expression_names,
    )


def test_shapes_ranges_and_left_out_sliders(alice, head: FaceModel) -> None:
    from facestage_blender.rig.own_mesh import read_mesh

    rig, own, notes = read_mesh(alice)
    np.testing.assert_allclose(rig.scale, 0.01, rtol=1e-5)
    assert own.expression == {
        "jawOpen": ("jawOpen", 2.0),
        "browUp": ("browUp", 1.0),
        "browUp (negative)": ("browUp", -1.0),
        "mode_0": ("mode_0", 1.0),
    }
    assert notes == ["1 muted shape keys are left out"]
    lengths = np.linalg.norm(rig.expression_offsets, axis=2).max(axis=1) / 100
    original = np.linalg.norm(head.expression_basis, axis=2).max(axis=1)
    np.testing.assert_allclose(
        lengths, [2 * original[0], original[1], original[1], original[2]], rtol=1e-4
    )
    assert len(alice.modifiers) == 1
    np.testing.assert_array_equal(rig.polygons, head.polygons)


def test_a_fit_is_written_back_as_the_fit_had_it(scene, alice, head: FaceModel) -> None:
    import bpy

    from facestage_blender.rig.face_rig import read_weights, rig_axes, set_weights
    from facestage_blender.rig.own_mesh import read_mesh
    from facestage_blender.rig.own_record import OwnMesh
    from facestage_blender.rig.own_rig import adopt, borrowed_shape
    from facestage_blender.rig.own_sliders import SHAPE_KEY, write_shape
    from facestage_blender.scene.stage import build_stage, place

    rig, own, _ = read_mesh(alice)
    model = model_of(rig, head)
    adopt(scene, alice, "rig:x", model, rig, own)
    result = result_of(model, np.array([1.0, -0.5, 0, 0.3, 0, 0]), np.array([0.25, 0.0, 0.5, 0.0]))
    set_weights(
        alice,
        dict(zip(result.identity_names, result.identity, strict=True)),
        dict(zip(result.expression_names, result.expression, strict=True)),
    )
    keys = alice.data.shape_keys.key_blocks
    assert (keys["jawOpen"].value, keys["browUp"].value) == pytest.approx((0.5, -0.5))
    assert (keys["jawOpen"].slider_max, keys["browUp"].slider_min) == (2.0, -1.0)
    tied = known(OwnMesh.of(alice))
    rest = known(borrowed_shape(alice, tied, result))
    write_shape(
        alice, tied, dict(zip(result.identity_names, result.identity.tolist(), strict=True)), rest
    )
    assert keys[SHAPE_KEY].value == 1.0
    empty = build_stage(scene, result.stage)
    place(empty, alice, result.model_to_stage, rig_axes(alice))
    scene.view_layers[0].update()
    alice.modifiers["Subdivision"].show_viewport = False
    shown = alice.evaluated_get(bpy.context.evaluated_depsgraph_get())
    flat = np.empty(3 * len(shown.data.vertices), np.float32)
    shown.data.vertices.foreach_get("co", flat)
    world = np.array(alice.matrix_world)
    stage = (flat.reshape(-1, 3) @ world[:3, :3].T + world[:3, 3]) @ np.array(
        [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    )
    wanted = result.vertices @ result.camera_to_stage[:3, :3].T + result.camera_to_stage[:3, 3]
    np.testing.assert_allclose(stage, wanted, atol=5e-6)
    identity, expression = read_weights(alice)
    np.testing.assert_allclose(list(identity.values()), result.identity, atol=1e-6)
    np.testing.assert_allclose(list(expression.values()), result.expression, atol=1e-6)


def test_marks_are_kept_replaced_and_cleared(alice) -> None:
    from facestage_blender.rig.own_marks import clear_mark, mark, read_marks

    for vertex in alice.data.vertices:
        vertex.select = vertex.index in (5, 9)
    assert mark(alice, "chin") == 2
    alice.data.vertices[9].select = False
    assert mark(alice, "chin") == 1
    assert {name: indices.tolist() for name, indices in read_marks(alice).items()} == {"chin": [5]}
    clear_mark(alice, "chin")
    assert read_marks(alice) == {}
    alice.data.vertices[5].select = False
    with pytest.raises(InputError, match="No vertex of 'Alice' is selected"):
        mark(alice, "chin")


def test_mesh_without_uvs_gets_a_map_and_keeps_its_selection(alice) -> None:
    from facestage_blender.rig.own_mesh import read_mesh

    alice.data.uv_layers.remove(alice.data.uv_layers[0])
    for vertex in alice.data.vertices:
        vertex.select = vertex.index < 7
    rig, own, _ = read_mesh(alice)
    assert own.uv_layer == "Facestage"
    assert 0 <= rig.uvs.min() < rig.uvs.max() <= 1
    assert sum(vertex.select for vertex in alice.data.vertices) == 7


def test_tiles_are_packed_beside_the_own_map(alice) -> None:
    from facestage_blender.rig.own_mesh import read_mesh

    layer = alice.data.uv_layers[0]
    flat = np.empty(2 * len(layer.uv), np.float32)
    layer.uv.foreach_get("vector", flat)
    layer.uv.foreach_set("vector", flat + np.tile([1.0, 0.0], len(layer.uv)).astype(np.float32) * 3)
    rig, own, _ = read_mesh(alice)
    assert own.uv_layer == "Facestage"
    assert rig.uvs.min() >= 0 and rig.uvs.max() <= 1
    after = np.empty_like(flat)
    alice.data.uv_layers[0].uv.foreach_get("vector", after)
    np.testing.assert_allclose(after[::2] - flat[::2], 3.0, atol=1e-5)


def test_what_cannot_be_a_face_is_refused(scene, alice) -> None:
    import bpy

    from facestage_blender.rig.own_mesh import read_mesh

    with pytest.raises(InputError, match="No mesh is active"):
        read_mesh(None)
    small = bpy.data.objects.new("Small", bpy.data.meshes.new("Small"))
    with pytest.raises(InputError, match="'Small' has 0 vertices"):
        read_mesh(small)
    alice.data.shape_keys.use_relative = False
    with pytest.raises(InputError, match="absolute"):
        read_mesh(alice)


def test_a_mesh_in_centimetres_gets_handles_and_gives_them_back(
    scene, alice, head: FaceModel
) -> None:
    import bpy

    from facestage_blender.rig.own_mesh import read_mesh
    from facestage_blender.rig.own_rig import adopt

    rig, own, _ = read_mesh(alice)
    model = model_of(rig, head)
    adopt(scene, alice, "rig:x", model, rig, own)
    before, parent, basis = alice.matrix_world.copy(), alice.parent, alice.matrix_basis.copy()
    assert bpy.ops.facestage.add_control_rig() == {"FINISHED"}
    np.testing.assert_allclose(alice.matrix_world, before, atol=2e-6)
    armature = alice.facestage_face.control_rig
    chin = armature.matrix_world @ armature.data.bones["jaw_master"].tail_local
    below = np.linalg.norm(np.array(chin) - np.array(alice.matrix_world.translation))
    assert 0.02 < below < 0.2  # metres
    armature.pose.bones["jaw_master"].rotation_euler.x = 3.0
    scene.view_layers[0].update()
    assert alice.data.shape_keys.key_blocks["jawOpen"].value == pytest.approx(2.0, abs=1e-3)
    again = read_mesh(alice)[1]
    assert again.expression == own.expression  # the handles' sliders are not taken for driven
    assert bpy.ops.facestage.remove_control_rig() == {"FINISHED"}
    np.testing.assert_allclose(alice.matrix_world, before, atol=2e-6)
    np.testing.assert_allclose(alice.matrix_basis, basis, atol=2e-6)
    assert alice.parent == parent


def test_pins_move_a_mesh_of_the_users(scene, alice, head: FaceModel, photo: Path) -> None:
    """In its own unit, under a parent, with a slider to both sides."""
    import bpy

    from facestage_blender.pins.pinning import Pinning, Setting
    from facestage_blender.pins.rig_shapes import current_vertices
    from facestage_blender.pins.solver import Guess
    from facestage_blender.rig.own_mesh import read_mesh
    from facestage_blender.rig.own_rig import adopt

    rig, own, _ = read_mesh(alice)
    adopt(scene, alice, "rig:x", replace(model_of(rig, head), landmarks=head.landmarks), rig, own)
    bpy.ops.facestage.choose_photo(filepath=str(photo))
    scene.facestage.result = "a fitted face"
    setting = Setting.of(scene)
    assert {each.name: (each.low, each.high) for each in setting.sliders} == {
        "jawOpen": (0.0, 2.0),
        "browUp": (-1.0, 1.0),
        "mode_0": (0.0, 1.0),
    }
    to_camera = np.diag([0.01, 0.01, 0.01, 1.0])
    to_camera[:3, :3] = to_camera[:3, :3] @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    to_camera[2, 3] = -0.6
    setting.show(Guess(to_camera, np.zeros(3)))
    scene.view_layers[0].update()
    np.testing.assert_allclose(setting.guess().to_camera, to_camera, atol=1e-5)
    assert bpy.ops.facestage.drag_pin(start=(48, 42), to=(51, 44)) == {"FINISHED"}
    pinning = Pinning(scene)
    np.testing.assert_allclose(pinning.shown, [[51, 44]], atol=0.2)
    points = current_vertices(alice) @ pinning.guess.to_camera[:3, :3].T
    seen = setting.lens.project(points + pinning.guess.to_camera[:3, 3])
    shown = np.einsum("pi,pix->px", pinning.pins.weights, seen[pinning.pins.corners])
    np.testing.assert_allclose(shown, pinning.shown, atol=0.02)


@pytest.mark.parametrize(
    ("name", "part"),
    [
        *(("M_LacrimalFluid", "other"), ("M_EyeBlend", "other"), ("M_EyeOcclusion", "other")),
        *(("M_EyeLashes", "other"), ("M_ScleraLeft", "eyes"), ("M_IrisRight", "eyes")),
        *(("M_GumsTongue", "mouth"), ("M_Teeth", "teeth"), ("M_BackHead", "skin")),
        *(("Eyelid", "unknown"), ("EyeLid Skin", "skin"), ("Lambert", "unknown")),
    ],
)
def test_names_of_materials_say_the_part(scene, name: str, part: str) -> None:
    from facestage.contract.face_model import PARTS
    from facestage_blender.rig.own_marks import guessed_part

    found = guessed_part(name)
    assert (PARTS[found] if found < len(PARTS) else "unknown") == part


def test_opaque_shells_do_not_hide_the_eyes(scene, alice, head: FaceModel) -> None:
    """What an .obj brings without its pictures is opaque; what is seen through stays, and so does
    hair.
    """
    import bpy

    from facestage_blender.rig.own_mesh import read_mesh
    from facestage_blender.rig.own_rig import adopt

    names = ("M_EyeOcclusion", "Tearline", "Lashes", "Hair")
    for name in names:
        material = bpy.data.materials.new(name)
        if material.node_tree is None:
            material.use_nodes = True
        alice.data.materials.append(material)
    surface = next(
        each
        for each in bpy.data.materials["Tearline"].node_tree.nodes
        if each.type == "BSDF_PRINCIPLED"
    )
    surface.inputs["Alpha"].default_value = 0.1
    rig, own, _ = read_mesh(alice)
    adopt(scene, alice, "rig:x", model_of(rig, head), rig, own)
    shown = [material.name for material in alice.data.materials][-4:]
    assert shown[1] == "Tearline" and shown[3] == "Hair"
    for place in (0, 2):
        assert shown[place].startswith("Facestage Other")
        kinds = {each.type for each in alice.data.materials[shown[place]].node_tree.nodes}
        assert kinds == {"BSDF_TRANSPARENT", "OUTPUT_MATERIAL"}
    assert all(name in bpy.data.materials for name in names)  # kept in the file


def test_lashes_behind_each_other_are_looked_through(scene) -> None:
    from facestage_blender.scene.stage import new_stage

    scene.cycles.transparent_max_bounces = 8
    new_stage(scene)
    assert scene.cycles.transparent_max_bounces >= 32
    scene.cycles.transparent_max_bounces = 500
    new_stage(scene)
    assert scene.cycles.transparent_max_bounces == 500


@pytest.mark.parametrize(("tilt", "taken"), [(0.3, True), (1.2, False), (3.14, False)])
def test_a_face_found_upside_down_is_refused_unless_it_is_marked(
    scene, alice, head: FaceModel, tilt: float, taken: bool
) -> None:
    import bpy

    from facestage_blender.rig.own_mesh import read_mesh
    from facestage_blender.rig.own_rig import adopt

    alice.rotation_euler = (tilt, 0.0, 0.5)
    scene.view_layers[0].update()
    materials = [material.name for material in alice.data.materials]
    rig, own, _ = read_mesh(alice)
    model = model_of(rig, head)
    if taken:
        adopt(scene, alice, "rig:x", model, rig, own)
        return
    with pytest.raises(InputError, match=r"off upright.*mark some landmarks"):
        adopt(scene, alice, "rig:x", model, rig, own)
    assert not alice.facestage_face.is_rig
    assert [material.name for material in alice.data.materials] == materials
    bpy.context.view_layer.objects.active = alice
    assert bpy.ops.facestage.mark_landmark(landmark="chin", vertex=17) == {"FINISHED"}
    rig, own, _ = read_mesh(alice)
    adopt(scene, alice, "rig:x", model, rig, own)


def test_lines_show_where_the_landmarks_were_found(scene, alice, head: FaceModel) -> None:
    from dataclasses import replace

    from facestage_blender.rig.own_lines import remove_lines, show_lines
    from facestage_blender.rig.own_mesh import read_mesh

    model = model_of(read_mesh(alice)[0], head)
    assert show_lines(alice, model) is None  # nobody says where they are
    model = replace(model, landmarks=head.landmarks)
    show_lines(alice, model)
    lines = known(show_lines(alice, model))
    assert [each for each in alice.children if each.type == "MESH"] == [lines]
    assert lines.hide_render and lines.show_in_front and len(lines.data.vertices) == 68
    table = head.landmarks["ibug68"]
    scene.view_layers[0].update()
    for index in (8, 30, 66):
        wanted = alice.data.vertices[int(table[index, 0])].co  # weights of 1
        assert (lines.data.vertices[index].co - wanted).length < 1e-6
        found = lines.matrix_world @ lines.data.vertices[index].co
        assert (found - alice.matrix_world @ wanted).length < 1e-6
    remove_lines(alice)
    assert not alice.children

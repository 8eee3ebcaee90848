"""The face for other programs: what is written is imported again, and compared."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree

from facestage.contract.errors import InputError
from facestage.contract.face_model import OTHER, FaceModel
from reference.known import known

SIZE = 96
JAW = 0.6
TOLERANCE = 2e-5  # metres: FBX and glTF store single precision
IMPORT = {
    ".glb": ("import_scene", "gltf", {}),
    ".fbx": ("import_scene", "fbx", {}),
    ".usdc": ("wm", "usd_import", {"import_usd_preview": True}),
    ".obj": ("wm", "obj_import", {}),
}


@pytest.fixture
def face(scene, head: FaceModel):
    """A lit face with an identity, an expression, a pose and textures, seen by a camera."""
    import bpy

    from facestage.contract.light_stage import fibonacci_stage
    from facestage_blender.rig.face_rig import build_rig, set_weights
    from facestage_blender.scene.stage import build_stage

    stage = fibonacci_stage(5, radius=1.0, side=0.4)
    power = np.array([9.0, 1.0, 3.0, 0.5, 4.0])[:, None] * np.array([1.0, 0.9, 0.7])
    empty = build_stage(scene, stage.with_radiance(power))
    rig = build_rig(scene, head, "default", empty)
    rig.location, rig.rotation_euler = (0.02, 0.01, 0.03), (0.1, 0.05, 0.4)
    identity = dict(zip(head.identity_names, np.linspace(-1, 1, 6), strict=True))
    set_weights(rig, identity, {"jawOpen": JAW})
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location, camera.rotation_euler = (0.0, -0.7, 0.0), (np.pi / 2, 0.0, 0.0)
    camera.data.lens = 60
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    return scene


def contents() -> dict[str, list[str]]:
    """The names of all that an export may leave behind."""
    import bpy

    kinds = ("objects", "meshes", "materials", "images", "shape_keys")
    return {kind: sorted(item.name for item in getattr(bpy.data, kind)) for kind in kinds}


def imported(scene, path: Path):
    """The mesh in a file, in the place of the scene's rig."""
    import bpy

    from facestage_blender.pictures.render import quiet

    before = set(bpy.data.objects)
    module, name, options = IMPORT[path.suffix]
    with quiet():
        getattr(getattr(bpy.ops, module), name)(filepath=str(path), **options)
    found = [item for item in set(bpy.data.objects) - before if item.type == "MESH"]
    assert len(found) == 1
    scene.facestage.rig.hide_render = True
    return found[0]


def psnr(one: np.ndarray, other: np.ndarray) -> float:
    from facestage_blender.pictures.render import srgb

    mask = one[..., 3] > 0.99
    assert mask.sum() > 1000
    off = srgb(one[..., :3])[mask] - srgb(other[..., :3])[mask]
    return float(-10 * np.log10((off**2).mean()))


def shown_points(item) -> np.ndarray:
    """(n, 3) the vertices of a mesh as its sliders show it, in the world."""
    import bpy

    graph = bpy.context.evaluated_depsgraph_get()
    graph.update()
    shown = item.evaluated_get(graph)
    flat = np.empty(3 * len(shown.data.vertices), np.float32)
    shown.data.vertices.foreach_get("co", flat)
    matrix = np.array(shown.matrix_world)
    return flat.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]


def uvs_of(item) -> np.ndarray:
    """The UV map of a mesh, flat."""
    uvs = np.empty(2 * len(item.data.loops), np.float32)
    item.data.uv_layers[0].uv.foreach_get("vector", uvs)
    return uvs


def apart(one: np.ndarray, other: np.ndarray) -> float:
    """The largest distance in metres of a point of one from the nearest point of the other."""
    return float(max(KDTree(one).query(other)[0].max(), KDTree(other).query(one)[0].max()))


@pytest.mark.parametrize(
    ("suffix", "handles"), [*((suffix, False) for suffix in IMPORT), (".glb", True), (".fbx", True)]
)
def test_an_imported_face_looks_and_moves_as_the_exported_one(
    face, head: FaceModel, tmp_path: Path, suffix: str, handles: bool
) -> None:
    from facestage_blender.exchange.export import export_face
    from facestage_blender.pictures.render import render_linear
    from facestage_blender.rig.control.control_rig import add_control_rig
    from facestage_blender.rig.sliders import rest_handles, set_slider

    if handles:
        set_slider(face.facestage.rig.data.shape_keys.key_blocks["jawOpen"], 0.5 * JAW)
        bones = add_control_rig(face).pose.bones
        bones["jaw_master"].rotation_euler.x = bones["head"].rotation_euler.y = 0.1
        face.view_layers[0].update()

    expected = render_linear(face, 64, direct_only=True)
    before = contents()
    written = export_face(face, tmp_path / f"face{suffix}", in_place=True)
    assert contents() == before
    assert written[0] == tmp_path / f"face{suffix}"
    assert sorted(tmp_path.rglob("*.*")) == sorted(written)
    there = imported(face, written[0])
    found = render_linear(face, 64, direct_only=True)
    match = psnr(expected, found)
    print(f"{suffix}: {match:.1f} dB, at least 30")
    assert match >= 30.0
    if suffix == ".obj":
        return
    keys = known(there.data.shape_keys).key_blocks
    assert [key.name for key in keys][1:] == list(head.expression_names)
    rig = face.facestage.rig
    opened = shown_points(rig)
    if suffix == ".usdc":  # which has sliders, but no values of theirs
        there.data.shape_keys.key_blocks["jawOpen"].value = JAW
    assert apart(shown_points(there), opened) < TOLERANCE
    rest_handles(rig)
    for item in (there, rig):
        set_slider(item.data.shape_keys.key_blocks["jawOpen"], 0.0)
    assert apart(shown_points(there), shown_points(rig)) < TOLERANCE
    assert apart(shown_points(there), opened) > 100 * TOLERANCE


@pytest.mark.parametrize("jaw", [JAW, 0.0])
def test_another_program_shows_the_exported_face(face, tmp_path: Path, jaw: float) -> None:
    """Read by trimesh and drawn by Mitsuba, which have nothing of Blender's."""
    import bpy

    from facestage_blender.exchange.export import export_face
    from facestage_blender.pictures.render import render_linear, save_png, srgb
    from facestage_blender.rig.sliders import set_slider
    from facestage_blender.scene.camera import camera_pose, read_camera
    from reference.gltf_viewer import AreaLamp, view

    written = export_face(face, tmp_path / "face.glb", in_place=True)
    there = view(written[0])
    assert there.weights["jawOpen"] == pytest.approx(JAW)
    set_slider(face.facestage.rig.data.shape_keys.key_blocks["jawOpen"], jaw)
    expected = render_linear(face, 64)
    lamps = [
        AreaLamp(
            np.array(item.matrix_world),
            np.full(2, item.data.size),
            item.data.energy * np.array(item.data.color) / (np.pi * item.data.size**2),
        )
        for item in bpy.data.objects
        if item.type == "LIGHT"
    ]
    camera = read_camera(face.camera.data, SIZE, SIZE)
    found = there.picture(camera, camera_pose(face.camera), lamps, 256, {"jawOpen": jaw})
    save_png(tmp_path / "two.png", srgb(np.hstack([expected[..., :3], found[..., :3]])))
    match = psnr(expected, found)
    print(f"{match:.1f} dB, at least 30; {tmp_path / 'two.png'}")
    assert match >= 30.0


def test_eyes_keep_their_own_picture(face, head: FaceModel, tmp_path: Path) -> None:
    """A left half of red and a right half of blue, whatever the albedo below them is."""
    from dataclasses import replace

    from facestage.contract.face_model import EYES
    from facestage.contract.texture_maps import EYE_MAP
    from facestage_blender.exchange.export import export_face
    from facestage_blender.pictures.images import image_pixels, texture_image
    from facestage_blender.rig.face_rig import build_rig
    from facestage_blender.skin.eye_material import material_uvs
    from facestage_blender.skin.material import set_textures

    part = head.polygon_part.copy()
    part[700:900] = EYES
    rig = build_rig(face, replace(head, polygon_part=part), "default", face.facestage.stage)
    pixels = np.zeros((64, 64, 3), np.float32)
    pixels[:, :32, 0] = pixels[:, 32:, 2] = 0.5
    gloss = texture_image("gloss", np.full((64, 64), 0.8, np.float32))
    albedo = texture_image("albedo", np.full((64, 64, 3), 0.3, np.float32))
    eyes = texture_image("eyes", pixels)
    set_textures(rig, {"albedo": albedo, "specular": gloss, EYE_MAP.name: eyes}, {"roughness": 0.4})
    before = uvs_of(rig)
    written = export_face(face, tmp_path / "face.glb", in_place=True)
    np.testing.assert_array_equal(uvs_of(rig), before)
    there = imported(face, written[0])
    index, material = next(
        (index, slot.material)
        for index, slot in enumerate(there.material_slots)
        if slot.material.name.startswith("Eyes")
    )
    uvs = material_uvs(there.data, index)
    np.testing.assert_allclose([uvs.min(0), uvs.max(0)], [[0, 0], [1, 1]], atol=1e-5)
    picture = next(
        node.image for node in material.node_tree.nodes if node.bl_idname == "ShaderNodeTexImage"
    )
    red, _, blue = np.moveaxis(image_pixels(picture)[..., :3], -1, 0)
    assert red[:, :30].min() > 0.4 and red[:, 34:].max() < 0.1 and blue[:, 34:].min() > 0.4
    surface = next(
        node for node in material.node_tree.nodes if node.bl_idname == "ShaderNodeBsdfPrincipled"
    )
    assert surface.inputs["Specular IOR Level"].default_value == pytest.approx(0.4, abs=0.01)
    skin = next(s.material for s in there.material_slots if s.material.name.startswith("Skin"))
    assert skin.name != material.name


def test_faces_that_nobody_sees_are_not_exported(face, head: FaceModel, tmp_path: Path) -> None:
    from dataclasses import replace

    from facestage_blender.exchange.export import export_face
    from facestage_blender.rig.face_rig import build_rig

    part = head.polygon_part.copy()
    part[:300] = OTHER
    build_rig(face, replace(head, polygon_part=part), "default", face.facestage.stage)
    export_face(face, tmp_path / "face.obj")
    faces = sum(line.startswith("f ") for line in (tmp_path / "face.obj").read_text().splitlines())
    assert faces == len(head.polygons) - 300
    materials = (tmp_path / "face.mtl").read_text()
    assert "Other" not in materials
    used = {line for line in (tmp_path / "face.obj").read_text().splitlines() if "usemtl" in line}
    assert len(used) == materials.count("newmtl") == 2


def test_textures_are_as_small_as_asked_and_colored_for_screens(face, tmp_path: Path) -> None:
    from facestage_blender.exchange.export import export_face
    from facestage_blender.pictures.images import image_pixels
    from facestage_blender.pictures.render import read_pixels, srgb

    export_face(face, tmp_path / "face.obj", side=128)
    found = read_pixels(tmp_path / "face_textures" / "albedo.png")[..., :3]
    assert found.shape == (128, 128, 3)
    whole = image_pixels(face.facestage.rig.facestage_face.albedo_image)[..., :3]
    means = whole.reshape(128, 2, 128, 2, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(found, srgb(means), atol=0.6 / 255)


def test_a_refused_export_writes_nothing(face, tmp_path: Path) -> None:
    from facestage_blender.exchange.export import export_face

    for name, sentence in (("face.stl", "ends in one of .glb"), ("face", "ends in one of")):
        with pytest.raises(InputError, match=sentence):
            export_face(face, tmp_path / name)
    with pytest.raises(InputError, match="at least 16"):
        export_face(face, tmp_path / "face.glb", side=4)
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(InputError, match="choose a folder"):
        export_face(face, tmp_path / "file" / "face.glb")
    assert [each.name for each in tmp_path.iterdir()] == ["file"]


def test_the_operator_exports_and_keeps_the_selection(face, tmp_path: Path) -> None:
    import bpy

    rig = face.facestage.rig
    bpy.context.view_layer.update()
    light = bpy.data.objects["Facestage Light 02"]
    for item in bpy.context.view_layer.objects:
        item.select_set(item == light)
    bpy.context.view_layer.objects.active = rig
    before = contents()
    answer = bpy.ops.facestage.export(filepath=str(tmp_path / "face.glb"), side="512")
    assert answer == {"FINISHED"}
    assert (tmp_path / "face.glb").stat().st_size > 10_000
    assert contents() == before
    assert bpy.context.view_layer.objects.active == rig
    assert [item for item in bpy.context.view_layer.objects if item.select_get()] == [light]


def test_normals_go_along_as_numbers(face, tmp_path: Path) -> None:
    from facestage.contract.texture_maps import PLAIN
    from facestage_blender.exchange.export import export_face
    from facestage_blender.pictures.images import image_pixels, load_image, texture_image
    from facestage_blender.skin.material import set_textures

    rig = face.facestage.rig
    kept = {name: getattr(rig.facestage_face, f"{name}_image") for name in ("albedo", "specular")}
    values = np.full((8, 8, 3), (0.6, 0.45, 0.98), np.float32)
    plain = {name: getattr(rig.facestage_face, name) for name in PLAIN}
    set_textures(rig, kept | {"normal": texture_image("normal", values)}, plain)
    written = export_face(face, tmp_path / "face.obj")
    picture = next(path for path in written if path.name == "normal.png")
    image = load_image(picture)
    image.colorspace_settings.name = "Non-Color"
    np.testing.assert_allclose(image_pixels(image)[..., :3], values, atol=1 / 255)
    there = imported(face, export_face(face, tmp_path / "face.glb")[0])
    nodes = [node for slot in there.material_slots for node in slot.material.node_tree.nodes]
    assert any(node.type == "NORMAL_MAP" for node in nodes)

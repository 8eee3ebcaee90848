"""Cornea and tears: their shape, how they follow gaze and lids, the iris behind them, their end."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mathutils.bvhtree import BVHTree

from facestage.contract.errors import InputError
from facestage.contract.face_model import FaceModel

LIMBUS = 0.0059


@pytest.fixture(scope="session")
def default() -> FaceModel:
    from facestage.models.registry import load_model

    return load_model("default")


@pytest.fixture
def rig(scene, default: FaceModel) -> Any:
    from facestage_blender.rig.face_rig import build_rig
    from facestage_blender.scene.stage import new_stage

    return build_rig(scene, default, "default", new_stage(scene))


def evaluated(item: Any) -> Any:
    import bpy

    bpy.context.view_layer.update()
    return item.evaluated_get(bpy.context.evaluated_depsgraph_get()).data


def shown(item: Any) -> np.ndarray:
    """(n, 3) the vertices of an object as modifiers and sliders leave them, in its own axes."""
    mesh = evaluated(item)
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    return points.reshape(-1, 3).astype(float)


def ball(rig: Any, side: str) -> np.ndarray:
    group = rig.vertex_groups[f"eye_{side}"].index
    return np.array([v.index for v in rig.data.vertices if any(g.group == group for g in v.groups)])


def middle(points: np.ndarray) -> np.ndarray:
    return np.asarray(0.5 * (points.min(axis=0) + points.max(axis=0)))


def parts(growth: Any) -> tuple[np.ndarray, np.ndarray]:
    """The shells (2, rings, around, 3) and the tears (lids, places, across, 3)."""
    from facestage_blender.skin.wet_eyes import ACROSS, AROUND, PLACES, RINGS

    points = shown(growth)
    shells = points[: 2 * RINGS * AROUND].reshape(2, RINGS, AROUND, 3)
    return shells, points[2 * RINGS * AROUND :].reshape(-1, PLACES, ACROSS, 3)


def skin_tree(rig: Any) -> BVHTree:
    from facestage_blender.skin.lids import part_tree

    return part_tree(rig.data, shown(rig))[0]


def test_the_cornea_bulges_as_a_sphere(rig) -> None:
    from facestage_blender.skin.wet_eyes import wet_eyes

    shells, _ = parts(wet_eyes(rig))
    eyeballs = shown(rig)
    for side, shell in zip(("left", "right"), shells, strict=True):
        own = eyeballs[ball(rig, side)]
        centre, radius = middle(own), 0.5 * np.ptp(own[:, 0])
        distance = np.linalg.norm(shell - centre, axis=-1)
        assert distance.min() > radius - 1e-4  # where lids press, still above the eyeball
        bulge = distance[0].mean() - radius
        print(side, "bulge", bulge)
        assert 0.0009 < bulge < 0.0014  # a cap of 7.8 mm on a ball of 12.2 mm
        aside = np.hypot(shell[..., 0] - centre[0], shell[..., 2] - centre[2])
        cap = shell[aside < 0.7 * LIMBUS]
        given = np.column_stack([2 * cap, np.ones(len(cap))])
        x = np.linalg.lstsq(given, (cap**2).sum(axis=1), rcond=None)[0]
        assert abs(np.sqrt(x[3] + x[:3] @ x[:3]) - 0.0078) < 0.0004
        assert np.abs(distance[aside > 1.5 * LIMBUS] - radius).max() < 0.0002


def test_all_of_it_faces_outwards(rig) -> None:
    from facestage_blender.skin.wet_eyes import wet_eyes

    mesh = evaluated(wet_eyes(rig))
    eyeballs = shown(rig)
    for side, sign in (("left", 1), ("right", -1)):
        centre = middle(eyeballs[ball(rig, side)])
        own = [each for each in mesh.polygons if sign * each.center[0] > 0]
        out = [np.dot(each.normal, np.array(each.center) - centre) for each in own]
        assert (np.array(out) > 0).mean() > 0.97


def test_the_cornea_follows_the_gaze_and_tears_do_not(rig) -> None:
    from facestage_blender.skin.wet_eyes import wet_eyes

    growth = wet_eyes(rig)
    pupil = ball(rig, "left")[0]
    before, tears = parts(growth)
    keys = rig.data.shape_keys.key_blocks
    keys["eyeLookOutLeft"].value = 1.0
    after, then = parts(growth)
    eyeballs = shown(rig)
    centre = middle(eyeballs[ball(rig, "left")])
    axis = after[0, 0].mean(axis=0) - centre
    looks = eyeballs[pupil] - centre
    cosine = axis @ looks / np.linalg.norm(axis) / np.linalg.norm(looks)
    assert cosine > np.cos(np.radians(4))
    assert np.linalg.norm(after[0, 0] - before[0, 0], axis=-1).min() > 0.003
    np.testing.assert_allclose(after[1], before[1], atol=1e-6)
    lids = np.linalg.norm(then - tears, axis=-1).max(axis=(1, 2))
    assert lids.max() < 0.002


def test_shut_lids_hide_the_cornea(rig) -> None:
    from facestage_blender.skin.wet_eyes import wet_eyes

    growth = wet_eyes(rig)
    rig.data.shape_keys.key_blocks["eyeBlinkLeft"].value = 1.0
    shells, _ = parts(growth)
    eyeballs, skin = shown(rig), skin_tree(rig)
    centre = middle(eyeballs[ball(rig, "left")])
    bare = 0
    for point in shells[0, :20].reshape(-1, 3):
        away = (point - centre) / np.linalg.norm(point - centre)
        bare += skin.ray_cast(point.tolist(), away.tolist(), 0.01)[0] is None
    share = bare / (20 * shells.shape[2])
    print("share of the cornea before the shut lid", share)
    assert share < 0.03


def test_tears_lie_between_eyeball_and_lid_and_go_with_it(rig) -> None:
    from facestage_blender.skin.wet_eyes import wet_eyes

    growth = wet_eyes(rig)
    _, tears = parts(growth)
    keys = rig.data.shape_keys.key_blocks
    keys["eyeBlinkLeft"].value = 1.0
    _, shut = parts(growth)
    eyeballs, skin = shown(rig), skin_tree(rig)
    for number, (side, upper) in enumerate(
        (("right", True), ("right", False), ("left", True), ("left", False))
    ):
        own = eyeballs[ball(rig, side)]
        centre, radius = middle(own), 0.5 * np.ptp(own[:, 0])
        above = np.linalg.norm(tears[number] - centre, axis=-1) - radius
        assert above.min() > -2e-5
        assert above[:, -1].max() < 0.0002  # they end on the eyeball
        print(
            above[:, -1].max(), above[10:-10, 0].min(), tears[number, 24, -1] - tears[number, 24, 0]
        )
        assert above[10:-10, 0].min() > 0.00015  # and begin before it, at the lid
        height = (tears[number, 24, -1] - tears[number, 24, 0])[2] * (-1 if upper else 1)
        assert 0.0003 < height < 0.001
    moved = (shut - tears)[2, 10:-10, :, 2]  # the left upper lid's
    assert moved.max() < -0.002
    far = [skin.find_nearest(each.tolist())[3] for each in shut[2, 10:-10, 0]]
    assert max(far) < 0.0015


def links(rig: Any) -> set[tuple[str, str, str, str]]:
    """What is linked to what in the material of the eyes."""
    tree = next(each for each in rig.data.materials if "Eyes" in each.name).node_tree
    return {
        (a.from_node.name, a.from_socket.name, a.to_node.name, a.to_socket.name) for a in tree.links
    }


def test_the_switch_leaves_nothing_behind(scene, rig) -> None:
    import bpy

    def left() -> list[Any]:
        data = bpy.data
        kinds = (data.objects, data.meshes, data.materials, data.node_groups)
        return [*(len(each) for each in kinds), sorted(rig.data.attributes.keys())]

    before = left()
    assert bpy.ops.facestage.wet_eyes() == {"FINISHED"}
    wired = links(rig)
    assert left() != before
    assert bpy.ops.facestage.wet_eyes() == {"FINISHED"}
    assert left() == before
    dry = links(rig)
    assert ("Specular", "Color", "Facestage Skin", "Specular") in dry - wired
    bpy.ops.facestage.wet_eyes()
    bpy.ops.facestage.wet_eyes()
    assert links(rig) == dry


def test_new_textures_leave_them_wet(rig) -> None:
    from facestage_blender.pictures.images import texture_image
    from facestage_blender.skin.material import set_textures
    from facestage_blender.skin.wet_eyes import dry_eyes, keep_wet, wet_eyes

    wet_eyes(rig)
    wired = links(rig)
    made = {name: texture_image(name, np.full((4, 4, 3), 0.5)) for name in ("albedo", "eyes")}
    made["specular"] = texture_image("specular", np.full((4, 4), 0.5, np.float32))
    set_textures(rig, made, {"roughness": 0.4})
    keep_wet(rig)
    now = links(rig)
    assert ("Specular", "Color", "Facestage Skin", "Specular") not in now
    normal = {each for each in wired if each[2:] == ("Facestage Skin", "Normal")}
    assert len(normal) == 1
    assert any(each[2:] == ("Facestage Skin", "Normal") for each in now)
    dry_eyes(rig)
    dry = links(rig)
    assert ("Eyes", "Vector", "Albedo", "Vector") in dry
    assert not any(each[2:] == ("Facestage Skin", "Normal") for each in dry)


def test_the_pupil_lies_behind_the_cornea(scene, rig, monkeypatch) -> None:
    """Seen from the side, what lies deeper is seen nearer to the border on the camera's side."""
    from facestage_blender.headless import close_ups as closeups
    from facestage_blender.skin.wet_eyes import wet_eyes

    def pupil() -> float:
        """How far right in the picture the pupil is, of its width."""
        picture = closeups.close_ups(scene, 64, 4)["eye"]
        dark = picture.sum(axis=2)[16:48, 8:56]
        return float((np.argsort(dark.ravel())[:40] % dark.shape[1]).mean() / 64)

    monkeypatch.setattr(closeups, "SHOTS", (closeups.Shot("eye", "eye", 0.02, 45.0),))
    before = pupil()
    wet_eyes(rig)
    after = pupil()
    print("pupil", before, after)
    # A plane 1.8 mm below at 45 degrees: 1.1 mm, as seen 0.8 mm of 20.
    assert 0.02 < after - before < 0.08


def test_a_rig_without_lids_stays_dry(scene, rig, default, head: FaceModel) -> None:
    from facestage_blender.rig.face_rig import build_rig
    from facestage_blender.skin.wet_eyes import wet_eyes, wet_eyes_of

    wet_eyes(rig)
    build_rig(scene, default, "default", rig.parent)
    assert wet_eyes_of(rig) is not None
    assert ("Specular", "Color", "Facestage Skin", "Specular") not in links(rig)
    build_rig(scene, head, "egg", rig.parent)
    assert wet_eyes_of(rig) is None
    with pytest.raises(InputError, match="lids"):
        wet_eyes(rig)


def test_exported_files_hold_none_of_it(scene, rig, tmp_path: Path) -> None:
    from facestage_blender.exchange.export import export_face
    from facestage_blender.skin.wet_eyes import wet_eyes

    written = []
    for name in ("dry", "wet"):
        folder = tmp_path / name
        folder.mkdir()
        export_face(scene, folder / "face.obj")
        written.append(
            {each.name: each.read_bytes() for each in folder.rglob("*") if each.is_file()}
        )
        wet_eyes(rig)
    assert written[0] == written[1]
    assert len(written[0]) > 3

"""Lashes: where they grow, how they follow the lids, their color, their end."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.face_model import FaceModel


@pytest.fixture(scope="session")
def default() -> FaceModel:
    from facestage.models.registry import load_model

    return load_model("default")


@pytest.fixture
def rig(scene, default: FaceModel) -> Any:
    from facestage_blender.rig.face_rig import build_rig
    from facestage_blender.scene.stage import new_stage

    return build_rig(scene, default, "default", new_stage(scene))


def shown(item: Any) -> np.ndarray:
    """(n, 3) the vertices of an object as modifiers and sliders leave them, in its own axes."""
    import bpy

    bpy.context.view_layer.update()
    evaluated = item.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    points = np.empty(3 * len(evaluated.vertices), np.float32)
    evaluated.vertices.foreach_get("co", points)
    return points.reshape(-1, 3)


def hairs(lashes: Any) -> np.ndarray:
    """(hairs, sections, 3) the middle of each section."""
    from facestage_blender.skin.hairs import SECTIONS, SIDES

    return shown(lashes).reshape(-1, SECTIONS, SIDES, 3).mean(axis=2)


def ball(rig: Any, side: str) -> np.ndarray:
    group = rig.vertex_groups[f"eye_{side}"].index
    return np.array([v.co for v in rig.data.vertices if any(g.group == group for g in v.groups)])


def centre(points: np.ndarray) -> np.ndarray:
    return np.asarray(0.5 * (points.min(axis=0) + points.max(axis=0)))


def test_they_grow_from_the_lids_away_from_the_eyeballs(rig) -> None:
    from facestage_blender.skin.lashes import grow_lashes

    lines = hairs(grow_lashes(rig))
    assert len(lines) == 2 * (90 + 55)
    skin = shown(rig)
    root = lines[:, 0]
    nearest = np.array([np.linalg.norm(skin - point, axis=1).min() for point in root[::7]])
    assert nearest.max() < 0.003
    for side, sign in (("left", 1), ("right", -1)):
        own = lines[sign * root[:, 0] > 0]
        middle = centre(ball(rig, side))
        distance = np.linalg.norm(own - middle, axis=2)
        radius = np.linalg.norm(ball(rig, side) - middle, axis=1).max()
        assert (distance[:, -1] > distance[:, 0] + 0.0015).all()
        assert distance[:, 1:].min() > radius - 0.001
        upper = own[:, 0, 2] > middle[2] - 0.001
        tips = own[:, -1, 2] - own[:, 0, 2]
        assert np.median(tips[upper]) > 0.001  # curled up
        assert np.median(tips[~upper]) < -0.001
    length = np.linalg.norm(np.diff(lines, axis=1), axis=2).sum(axis=1)
    assert 0.003 < np.median(length) < 0.011


def test_they_follow_the_lids(rig) -> None:
    from facestage_blender.skin.lashes import grow_lashes

    lashes = grow_lashes(rig)
    before = hairs(lashes)
    rig.data.shape_keys.key_blocks["eyeBlinkLeft"].value = 1.0
    after = hairs(lashes)
    left = before[:, 0, 0] > 0
    upper = left & (before[:, 0, 2] > centre(ball(rig, "left"))[2] + 0.002)
    np.testing.assert_allclose(after[~left], before[~left], atol=1e-6)
    assert (after[upper, 0, 2] < before[upper, 0, 2] - 0.0015).mean() > 0.8  # the lid went down
    skin = shown(rig)
    gap = [np.linalg.norm(skin - point, axis=1).min() for point in after[upper, 0][::5]]
    assert max(gap) < 0.003
    # and the hairs turned with it
    rise = [np.median(lines[upper, -1, 2] - lines[upper, 0, 2]) for lines in (before, after)]
    assert rise[1] < rise[0] - 0.001
    length = [np.linalg.norm(lines[:, -1] - lines[:, 0], axis=1) for lines in (before, after)]
    np.testing.assert_allclose(length[1], length[0], rtol=0.02)


def test_they_are_as_dark_as_the_brows(rig) -> None:
    from facestage_blender.pictures.images import texture_image
    from facestage_blender.skin.lashes import color_lashes, grow_lashes
    from facestage_blender.skin.material import set_textures

    lashes = grow_lashes(rig)

    def color() -> np.ndarray:
        nodes = lashes.data.materials[0].node_tree.nodes
        surface = next(each for each in nodes if "Base Color" in each.inputs)
        return np.array(surface.inputs["Base Color"].default_value)[:3]

    model = color()
    assert model.max() < 0.1  # the built-in head's brows are dark
    red = np.tile([0.4, 0.15, 0.05], (32, 32, 1)).astype(np.float32)
    images = {"albedo": texture_image("red", red)}
    images["specular"] = texture_image("one", np.ones((4, 4), np.float32))
    set_textures(rig, images, {"roughness": 0.4})
    color_lashes(rig)
    assert color()[0] > 2 * color()[1] > 4 * color()[2]


def test_the_switch_leaves_nothing_behind(scene, rig) -> None:
    import bpy

    def left() -> list[int]:
        data = bpy.data
        return [len(each) for each in (data.objects, data.meshes, data.materials, data.node_groups)]

    before = left()
    assert bpy.ops.facestage.lashes() == {"FINISHED"}
    assert left() != before
    assert bpy.ops.facestage.lashes() == {"FINISHED"}
    assert left() == before


def test_a_rebuilt_rig_keeps_them_where_it_can(scene, rig, default, head: FaceModel) -> None:
    from facestage_blender.rig.face_rig import build_rig
    from facestage_blender.skin.lashes import grow_lashes, lashes_of

    grow_lashes(rig)
    build_rig(scene, default, "default", rig.parent)
    assert len([each for each in rig.children if lashes_of(rig) == each]) == 1
    build_rig(scene, head, "egg", rig.parent)  # which has no lids
    assert lashes_of(rig) is None
    with pytest.raises(InputError, match="lids"):
        grow_lashes(rig)

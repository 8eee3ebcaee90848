"""A picture's light on the stage's lights."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.optimize import nnls

from addon.ui.refusal import refused
from facestage.contract.environment import directions
from facestage.contract.light_stage import fibonacci_stage, joined


def save(picture: np.ndarray, path: Path) -> Path:
    from facestage_blender.pictures.render import save_exr

    save_exr(path, picture.astype(np.float32))
    return path


def lamp(towards: np.ndarray, color: list[float], degrees: float) -> np.ndarray:
    """Dim, but for a lamp (stage frame) of a picture that is turned by ``degrees``."""
    there = directions(64, 128, degrees) @ (towards / np.linalg.norm(towards)) > 0.97
    return np.where(there[..., None], color, 0.02)


@pytest.mark.parametrize("degrees", [0.0, 90.0])
def test_the_light_comes_from_where_the_picture_is_bright(
    scene, tmp_path: Path, degrees: float
) -> None:
    import bpy

    from facestage_blender.scene.stage import build_stage, read_stage

    empty = build_stage(scene, fibonacci_stage(30, radiance=2.0))
    towards = np.array([-0.6, 0.5, 0.6])
    turn = np.radians(degrees)
    path = save(lamp(towards, [40.0, 20.0, 10.0], degrees), tmp_path / "a.exr")
    assert bpy.ops.facestage.light_from_picture(filepath=str(path), turn=turn) == {"FINISHED"}
    found = read_stage(empty)
    level = found.radiance.mean(axis=1)
    mean = level @ -found.direction / level.sum()
    assert mean @ towards / np.linalg.norm(mean) / np.linalg.norm(towards) > 0.97
    total = found.radiance.sum(axis=0)
    assert total[0] > 1.5 * total[1] > 2.0 * total[2]
    assert path.name not in bpy.data.images
    bpy.ops.facestage.relight(direction="fitted")
    np.testing.assert_allclose(read_stage(empty).radiance, 2.0, rtol=1e-5)


def test_a_picture_of_the_lights_gives_them_back(scene, tmp_path: Path) -> None:
    """All around, each its own color; one is off and stays so. As bright as the fitted ones are."""
    from facestage_blender.scene.picture_light import light_from_picture
    from facestage_blender.scene.stage import build_stage, read_stage, stage_lights

    stage = joined(fibonacci_stage(8), fibonacci_stage(4, behind=True))
    color = np.random.default_rng(0).uniform(0.0, 5.0, (12, 3))
    stage = stage.with_radiance(color)
    towards = directions(128, 256)
    outward = stage.position / np.linalg.norm(stage.position, axis=1)[:, None]
    cosine = np.cos(np.arctan(stage.side[0] / np.sqrt(np.pi) / np.linalg.norm(stage.position[0])))
    picture = ((towards @ outward.T > cosine) @ color).astype(np.float32)
    empty = build_stage(scene, stage.with_radiance(np.ones((12, 3))))
    share = light_from_picture(scene, save(picture, tmp_path / "a.exr"))
    found = read_stage(empty).radiance
    ratio = (found * color).sum() / (color**2).sum()
    print(f"share {share:.3f}, off by {np.abs(found / ratio - color).max():.3f} of 5")
    assert share > 0.97
    front = slice(0, 8)
    assert np.abs(found / ratio - color)[front].max() < 0.5
    stage_lights(empty)[2].facestage_light.state = "OFF"
    light_from_picture(scene, tmp_path / "a.exr")
    assert not read_stage(empty).radiance[2].any()


def test_least_squares_are_scipys() -> None:
    from facestage_blender.scene.picture_light import nonnegative

    random = np.random.default_rng(1)
    columns, wanted = random.uniform(0, 1, (60, 12)), random.normal(size=(60, 3))
    found = nonnegative(columns, wanted)
    for channel in range(3):
        np.testing.assert_allclose(
            found[:, channel], nnls(columns, wanted[:, channel])[0], atol=2e-3
        )
    assert (found == 0).any() and (found > 0).any()


def test_what_is_no_picture_of_all_directions_is_said(scene, tmp_path: Path) -> None:
    import bpy

    from facestage_blender.scene.stage import new_stage

    new_stage(scene)
    act = bpy.ops.facestage.light_from_picture
    refused(act, "does not exist", filepath=str(tmp_path / "none.exr"))
    assert cv2.imwrite(str(tmp_path / "eight.png"), np.full((8, 16, 3), 9, np.uint8))
    refused(act, "8 bits a channel", filepath=str(tmp_path / "eight.png"))
    square = save(np.ones((8, 8, 3)), tmp_path / "square.exr")
    refused(act, "twice as wide as high", filepath=str(square))
    black = save(np.zeros((8, 16, 3)), tmp_path / "black.exr")
    refused(act, "black or damaged", filepath=str(black))
    assert not [image for image in bpy.data.images if image.users == 0 and image.filepath]


def test_the_picture_is_the_world_and_the_world_comes_back(scene, tmp_path: Path) -> None:
    import bpy

    from facestage_blender.scene.obstacles import world_shines
    from facestage_blender.scene.stage import build_stage, read_stage
    from facestage_blender.scene.surroundings import world_picture

    own = scene.world = bpy.data.worlds.new("My World")
    empty = build_stage(scene, fibonacci_stage(6, radiance=2.0))
    picture = lamp(np.array([0.0, 0.4, 1.0]), [30.0, 30.0, 30.0], 40.0)
    path = save(picture, tmp_path / "a.exr")
    act = bpy.ops.facestage.light_from_picture
    for _ in range(2):  # a second time: not the first one's world is given back
        assert act(filepath=str(path), turn=np.radians(40.0), as_world=True) == {"FINISHED"}
    seen, degrees = world_picture(scene)
    np.testing.assert_allclose(seen, picture, rtol=1e-3, atol=1e-4)
    assert degrees == pytest.approx(40.0, abs=1e-3)
    assert not read_stage(empty).radiance.any() and not world_shines(scene)
    for back in (
        lambda: bpy.ops.facestage.relight(direction="fitted"),
        lambda: bpy.ops.facestage.relight(direction="left"),
        lambda: bpy.ops.facestage.next_light(),
        lambda: act(filepath=str(path)),
    ):
        act(filepath=str(path), as_world=True)
        assert back() == {"FINISHED"}
        assert scene.world == own and len(bpy.data.worlds) == 1
        assert read_stage(empty).radiance.any()
    scene.world = None
    act(filepath=str(path), as_world=True)
    bpy.ops.facestage.relight(direction="fitted")
    assert scene.world is None


def test_the_world_is_as_bright_as_the_lights_were(scene, tmp_path: Path) -> None:
    """Irradiance on a card that faces the camera, of the same light from lamps and as a world."""
    from facestage_blender.scene.picture_light import (
        light_by_world,
        light_from_picture,
        picture_angles,
    )
    from facestage_blender.scene.stage import build_stage, read_stage

    stage = fibonacci_stage(40, radiance=2.0)
    empty = build_stage(scene, stage)
    towards = directions(64, 128)
    picture = np.repeat(np.maximum(towards[..., 2:], 0.05), 3, axis=2)
    path = save(picture, tmp_path / "a.exr")

    def on_card() -> float:
        lit = read_stage(empty)
        square = np.linalg.norm(lit.position, axis=1) ** 2
        cosine = np.maximum(lit.position[:, 2], 0.0) / np.sqrt(square)
        return float(lit.radiance.mean(axis=1) @ (cosine * lit.side**2 / square))

    fitted = on_card()
    light_from_picture(scene, path)
    lamps = on_card()
    light_by_world(scene, path)
    strength = scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value
    flux = picture_angles(64, 128) * picture[..., 0].ravel()
    world = strength * float(flux @ np.maximum(towards.reshape(-1, 3)[:, 2], 0.0))
    print(fitted, lamps, world)
    assert lamps == pytest.approx(world, rel=0.05)
    assert fitted == pytest.approx(world, rel=0.25)

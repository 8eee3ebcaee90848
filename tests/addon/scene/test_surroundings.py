"""The world's picture as the stage's lights."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from facestage.contract.environment import directions, environment_stage
from facestage.contract.errors import InputError
from facestage.contract.light_stage import FROZEN


@pytest.fixture
def picture() -> np.ndarray:
    """Dim, with a lamp in front, at the right and above (stage frame)."""
    towards = directions(32, 64)
    lamp = np.array([0.6, 0.48, 0.64])
    return np.where((towards @ lamp > 0.98)[..., None], [80.0, 60, 40], 0.3).astype(np.float32)


def with_world(scene, picture: np.ndarray, folder: Path, degrees: float) -> None:
    from facestage_blender.pictures.render import save_exr
    from facestage_blender.synthetic.scans.light import light_world, read_surroundings

    save_exr(folder / "sky.exr", picture)
    light_world(scene, read_surroundings(f"{folder / 'sky.exr'}@{degrees}"), vertical="Z")


@pytest.mark.parametrize("degrees", [0, 110])
def test_the_lights_are_where_the_picture_is_bright(
    scene, picture: np.ndarray, tmp_path: Path, degrees: float
) -> None:
    from facestage_blender.scene.stage import new_stage, read_stage
    from facestage_blender.scene.surroundings import light_as_world

    with_world(scene, picture, tmp_path, degrees)
    empty = new_stage(scene)
    assert scene.facestage.exposure_known
    light_as_world(scene)
    found, wanted = read_stage(empty), environment_stage(picture, degrees)
    np.testing.assert_allclose(found.position, wanted.position, atol=1e-5)
    np.testing.assert_allclose(found.radiance, wanted.radiance, rtol=1e-4)
    assert (found.state == FROZEN).all() and not scene.facestage.exposure_known
    new_stage(scene)
    assert scene.facestage.exposure_known


def test_a_turned_stage_sees_the_same_world(scene, picture: np.ndarray, tmp_path: Path) -> None:
    from facestage_blender.scene.stage import new_stage, stage_lights
    from facestage_blender.scene.surroundings import light_as_world

    with_world(scene, picture, tmp_path, 0)
    empty = new_stage(scene)
    places = []
    for turn in ((0, 0, 0), (0.3, -0.2, 1.1)):
        empty.rotation_euler = turn
        light_as_world(scene)
        scene.view_layers[0].update()
        lights = stage_lights(empty)
        places.append(np.array([light.matrix_world.translation for light in lights]))
    np.testing.assert_allclose(places[0], places[1], atol=1e-5)


def test_worlds_that_show_no_map_are_refused(scene, picture: np.ndarray, tmp_path: Path) -> None:
    from facestage_blender.pictures.images import load_image
    from facestage_blender.pictures.render import save_png
    from facestage_blender.scene.stage import new_stage
    from facestage_blender.scene.surroundings import light_as_world

    new_stage(scene)
    scene.world = None
    with pytest.raises(InputError, match="Environment Texture"):
        light_as_world(scene)
    with_world(scene, picture, tmp_path, 0)
    nodes = {node.type: node for node in scene.world.node_tree.nodes}
    nodes["MAPPING"].inputs["Rotation"].default_value = (0.5, 0, 0)
    with pytest.raises(InputError, match="about Z alone"):
        light_as_world(scene)
    nodes["MAPPING"].inputs["Rotation"].default_value = (0, 0, 0)
    nodes["TEX_ENVIRONMENT"].projection = "MIRROR_BALL"
    with pytest.raises(InputError, match="Equirectangular"):
        light_as_world(scene)
    nodes["TEX_ENVIRONMENT"].projection = "EQUIRECTANGULAR"
    save_png(tmp_path / "sky.png", np.clip(picture, 0, 1))
    nodes["TEX_ENVIRONMENT"].image = load_image(tmp_path / "sky.png")
    with pytest.raises(InputError, match="8 bits"):
        light_as_world(scene)

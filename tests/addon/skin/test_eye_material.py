"""The eyes' own picture in the material of the eyes."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from facestage.contract.face_model import FaceModel

UV_BOX = (0.25, 0.5, 0.75, 0.75)
PLAIN = {"roughness": 0.4}


@pytest.fixture
def eyed(scene, head: FaceModel):
    """The egg, whose second part, the eyes, is given an upright box of the UV square."""
    from facestage_blender.rig.face_rig import build_rig
    from facestage_blender.scene.stage import new_stage

    rig = build_rig(scene, head, "default", new_stage(scene))
    layer = rig.data.uv_layers.active.uv
    corners = [
        at for face in rig.data.polygons if face.material_index == 1 for at in face.loop_indices
    ]
    left, bottom, right, top = UV_BOX
    for number, at in enumerate(corners):
        layer[at].vector = (left, bottom) if number % 2 else (right, top)
    return rig


def images() -> dict[str, Any]:
    from facestage_blender.pictures.images import texture_image

    made = {name: texture_image(name, np.full((4, 4, 3), 0.5)) for name in ("albedo", "eyes")}
    return made | {"specular": texture_image("specular", np.full((4, 4), 0.5))}


def nodes(rig, part: str):
    material = next(each for each in rig.data.materials if part in each.name)
    return material.node_tree.nodes


def looked_up(rig, uv: tuple[float, float]) -> np.ndarray:
    """Where in the picture of the eyes' material a UV point is looked up."""
    place = nodes(rig, "Eyes")["Eyes"]
    assert place.outputs["Vector"].links[0].to_node == nodes(rig, "Eyes")["Albedo"]
    scale, shift = (np.array(place.inputs[name].default_value) for name in ("Scale", "Location"))
    return (scale * [*uv, 0.0] + shift)[:2]


def test_the_box_of_the_eyes_fills_the_picture(eyed) -> None:
    from facestage_blender.skin.material import set_textures

    given = images()
    set_textures(eyed, given, PLAIN)
    assert nodes(eyed, "Eyes")["Albedo"].image == given["eyes"]
    assert nodes(eyed, "Skin")["Albedo"].image == given["albedo"]
    np.testing.assert_allclose(looked_up(eyed, UV_BOX[:2]), [0, 0], atol=1e-6)
    np.testing.assert_allclose(looked_up(eyed, UV_BOX[2:]), [1, 1], atol=1e-6)


def test_an_older_result_shows_its_albedo_there(eyed) -> None:
    import bpy

    from facestage_blender.skin.material import set_textures

    older = images()
    del older["eyes"]
    set_textures(eyed, older, PLAIN)
    assert "Eyes" not in nodes(eyed, "Eyes")
    given = images()
    given["eyes"].name = "a picture of eyes"
    set_textures(eyed, given, PLAIN)
    again = images()
    del again["eyes"]
    set_textures(eyed, again, PLAIN)
    assert nodes(eyed, "Eyes")["Albedo"].image == again["albedo"]
    np.testing.assert_allclose(looked_up(eyed, (0.3, 0.6)), [0.3, 0.6], atol=1e-6)
    assert "a picture of eyes" not in bpy.data.images  # used no more


def test_a_result_with_a_picture_of_the_eyes_loads(scene, head: FaceModel, tmp_path: Path) -> None:
    import os
    from types import SimpleNamespace

    os.environ["OPENCV_IO_ENABLE_OPENEXR"] = "1"
    import bpy
    import cv2

    from facestage_blender.exchange.result_textures import loading_steps

    for name in ("albedo", "specular", "eyes"):
        pixels = np.full((8, 16 if name == "eyes" else 8, 3), 0.25, np.float32)
        assert cv2.imwrite(str(tmp_path / f"{name}.exr"), pixels)
    loaded: dict[str, Any] = {}

    def load():
        loaded.update((yield from loading_steps(cast(Any, SimpleNamespace(folder=tmp_path)))))

    assert len(list(load())) == 3  # one picture a step
    assert sorted(loaded) == ["albedo", "eyes", "specular"]
    assert tuple(loaded["eyes"].size) == (16, 8)
    given_up = loading_steps(cast(Any, SimpleNamespace(folder=tmp_path)))
    before = len(bpy.data.images)
    next(given_up)
    assert len(bpy.data.images) == before + 1
    given_up.close()
    assert len(bpy.data.images) == before

"""Close-ups: what each shows, and that the scene is left as it was."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.face_model import FaceModel


@pytest.fixture
def rig(scene, head: FaceModel):
    """The egg with a red eye on its left, and a face."""
    from facestage_blender.rig.face_rig import build_rig
    from facestage_blender.scene.stage import new_stage

    front = np.flatnonzero((head.vertices[:, 2] > 0) & (np.abs(head.vertices[:, 1]) < 0.07))
    at_eye = np.array([0.03, 0.03])
    eye = front[np.linalg.norm(head.vertices[front, :2] - at_eye, axis=1) < 0.011]
    albedo = np.full_like(head.albedo_mean, 0.3)
    albedo[eye] = (0.6, 0.05, 0.05)
    regions = {"narrow_face": front.astype(np.int32), "eye_left": eye.astype(np.int32)}
    model = replace(head, regions=regions, albedo_mean=albedo)
    return build_rig(scene, model, "default", new_stage(scene))


def test_they_show_what_they_are_called(scene, rig) -> None:
    from facestage_blender.headless.close_ups import SHOTS, close_ups

    rig.location = (0.3, -0.2, 1.1)
    rig.rotation_euler = (0.2, -0.4, 2.0)
    pictures = close_ups(scene, 24, 4)
    assert list(pictures) == [shot.caption for shot in SHOTS]
    red = {name: (each[..., 0] - each[..., 1] > 0.2) for name, each in pictures.items()}
    assert red["eye"][8:16, 8:16].mean() > 0.8  # in the middle, whatever the head's pose
    assert 0 < red["three-quarter"].mean() < 0.1
    assert not red["back"].any()
    skin = {name: (each.max(axis=2) > 0.3).mean() for name, each in pictures.items()}
    assert skin["mouth"] > 0.6
    assert 0.1 < skin["back"] < 0.9


def test_raking_light_is_from_the_side(scene, rig) -> None:
    from facestage_blender.headless.close_ups import SHOTS, close_ups

    raking = next(shot for shot in SHOTS if "raking" in shot.caption)
    picture = close_ups(scene, 24, 4)[raking.caption]
    assert picture[:, :8].mean() > 1.3 * picture[:, -8:].mean()


def test_the_scene_stays_as_it_was(scene, rig) -> None:
    import bpy

    from facestage_blender.headless.close_ups import close_ups

    def left() -> tuple[object, ...]:
        render = scene.render
        hidden = [each.name for each in scene.objects if each.hide_render]
        size = render.resolution_x, render.resolution_y, render.use_border
        data = len(bpy.data.cameras), len(bpy.data.lights), len(bpy.data.worlds)
        return (
            scene.camera,
            scene.world,
            sorted(each.name for each in scene.objects),
            hidden,
            size,
            data,
        )

    before = left()
    close_ups(scene, 8, 1)
    assert left() == before


def test_a_rig_without_regions_has_none(scene, head: FaceModel) -> None:
    from facestage_blender.headless.close_ups import close_ups
    from facestage_blender.rig.face_rig import build_rig
    from facestage_blender.scene.stage import new_stage

    build_rig(scene, head, "default", new_stage(scene))
    assert close_ups(scene, 8, 1) == {}


def test_the_batch_saves_them(scene, rig, tmp_path: Path) -> None:
    from facestage_blender.headless.batch import _extra_pictures
    from facestage_blender.headless.close_ups import SHOTS

    asked: dict[str, object] = {
        "resolution": None,
        "samples": 1,
        "relight": [],
        "expression": [],
        "close_ups": 16,
    }
    saved = _extra_pictures(scene, Namespace(**asked), tmp_path)
    assert sorted(saved) == sorted(tmp_path.iterdir())
    assert len(saved) == len(SHOTS)
    assert tmp_path / "close_ear_and_neck.png" in saved

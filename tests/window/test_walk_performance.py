"""A performance in Blender's window: its panel, and a refit around a key that was corrected."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from addon import stand_in_results
from facestage.contract.camera import Camera
from facestage.contract.job import Job
from facestage.contract.light_stage import fibonacci_stage
from facestage.contract.person import Person
from facestage.contract.result import CONVERGED, Result
from facestage.contract.sequence import KEYFRAMES, SEEN, Sequence, SequenceFrame
from facestage.models.registry import load_model
from window.blender import Blender

SETTINGS = "bpy.context.scene.facestage"
STATE = "bpy.context.window_manager.facestage"
FRAMES, RATE, WIDTH, HEIGHT = 24, 24.0, 64, 48
KEY = 12  # a frame of the scene
REFIT = "Refit Around Corrected Keys"


@pytest.fixture(scope="module")
def folder(blender: Blender, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The default head, whose jaw opens in grey pictures that show no face."""
    film, folder = blender.out / "film", blender.out / "track"
    for each in (film, folder):
        shutil.rmtree(each, ignore_errors=True)
        each.mkdir()
    for number in range(1, FRAMES + 1):
        assert cv2.imwrite(str(film / f"{number:04}.png"), np.full((HEIGHT, WIDTH, 3), 90.0))
    model, scratch = load_model("default"), tmp_path_factory.mktemp("performance")
    model.save(scratch / "model.npz")
    os.environ["STAND_IN_MODEL"] = str(scratch / "model.npz")
    camera = Camera.default(WIDTH, HEIGHT)
    Job(image=film / "0001.png", model="default", camera=camera, stage=fibonacci_stage()).save(
        scratch / "job"
    )
    stand_in_results.fit_person([scratch / "job", scratch / "job"], folder / KEYFRAMES)
    expression = np.zeros((FRAMES, len(model.expression_names)))
    expression[:, model.expression_names.index("jawOpen")] = np.linspace(0, 0.6, FRAMES)
    pose = np.eye(4)
    pose[2, 3] = -0.6
    Sequence(
        CONVERGED,
        "All is well.",
        str(film),
        "default",
        camera,
        RATE,
        tuple(
            SequenceFrame(index + 1, index / RATE, f"{index + 1:04}.png", SEEN)
            for index in range(FRAMES)
        ),
        (1, FRAMES),
        model.identity_names,
        model.expression_names,
        Result.load(folder / KEYFRAMES / Person.load(folder / KEYFRAMES).photos[0].folder).identity,
        expression,
        np.tile(pose, (FRAMES, 1, 1)),
        {},
        {},
        {},
        {},
    ).write_into(folder)
    return folder


def test_a_performance_is_imported_and_its_panel_has_the_refit(blender: Blender, folder: Path):
    blender.do("bpy.ops.wm.read_homefile(app_template='')")
    blender.do(
        "bpy.context.preferences.view.show_splash = False\n"
        "bpy.context.area.spaces.active.show_region_ui = True\n"
        "bpy.ops.facestage.build_stage()\n"
        "bpy.ops.facestage.clear_stage()\n"
        "bpy.ops.facestage.build_rig('INVOKE_DEFAULT')\n"
    )
    blender.idle()
    blender.press(1000, 800)
    blender.open_tab()
    blender.do(f"bpy.ops.facestage.import_performance('EXEC_DEFAULT', directory={str(folder)!r})")
    blender.scroll(40)
    blender.click("Expression")
    blender.scroll(40)
    blender.shot("performance")
    blender.find("Import Performance")
    blender.click(REFIT)
    blender.until(f"'No key differs' in {STATE}.failure")
    blender.move(500, 600)  # away from the message, which goes then
    blender.shot("nothing-to-refit")
    blender.find("No key differs from the")


def test_a_refit_moves_the_frames_beside_a_key(blender: Blender):
    jaw = f"{SETTINGS}.rig.data.shape_keys.key_blocks['jawOpen']"
    weights = (
        f"answer = []\nfor frame in range(1, {FRAMES + 1}):\n"
        f"    bpy.context.scene.frame_set(frame)\n    answer.append({jaw}.value)\n"
    )
    before = np.array(blender.do(weights))
    blender.do(
        f"bpy.context.scene.frame_set({KEY})\nkey = {jaw}\nkey.value += 0.2\n"
        "key.keyframe_insert('value')\n"
    )
    blender.click(REFIT)
    blender.until(f"{STATE}.task")
    blender.shot("refitting")
    blender.idle()
    assert blender.ask(f"{STATE}.failure") == ""
    changed = np.array(blender.do(weights)) - before
    blender.shot("refitted")
    assert changed[KEY - 1] == pytest.approx(0.2, abs=1e-4)
    assert (changed[[KEY - 2, KEY]] > 0.05).all(), "its neighbours stay behind"
    assert changed.max() < 0.25

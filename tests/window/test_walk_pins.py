"""Pins in Blender's window: the face is dragged over the photo by the mouse."""

from __future__ import annotations

import shutil
import time
from pathlib import Path

import numpy as np
import pytest

from window.blender import HEIGHT, Blender

SETTINGS = "bpy.context.scene.facestage"
MODULE = "bl_ext.user_default.facestage_blender"
PLACES = f"""
import json, numpy as np
from {MODULE}.ui.pins import photo_on_screen
from {MODULE}.pins.record import Record
region = next(each for each in bpy.context.area.regions if each.type == "WINDOW")
with bpy.context.temp_override(region=region):
    screen = photo_on_screen(bpy.context)
origin = region.x, region.y
"""
PINS = f"""
import numpy as np
from {MODULE}.pins.pinning import Pinning
pinning = Pinning(bpy.context.scene)
answer = [pinning.pins.points.tolist(), pinning.shown.tolist(), pinning.guess.sliders.tolist()]
"""


def place(blender: Blender, pixel: np.ndarray) -> tuple[int, int]:
    """Where the screen shows a pixel (2,) of the photo."""
    x, y = blender.do(
        PLACES + f"found = screen.to_region(np.array([{pixel.tolist()}]))[0]\n"
        "answer = [origin[0] + found[0], origin[1] + found[1]]"
    )
    return round(x), HEIGHT - round(y)


def pins(blender: Blender) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pins (p, 2), where the face shows them, and the sliders."""
    points, shown, sliders = (np.array(each) for each in blender.do(PINS))
    return points.reshape(-1, 2), shown.reshape(-1, 2), sliders


@pytest.fixture(scope="module")
def landmarks(blender: Blender) -> np.ndarray:
    """(478, 2) of the portrait; the rig is built, and nothing fitted."""
    import skimage

    blender.do("bpy.ops.wm.read_homefile(app_template='')")
    photo = blender.out / "my photos" / "to pin.png"
    photo.parent.mkdir(exist_ok=True)
    shutil.copyfile(Path(skimage.__file__).parent / "data" / "astronaut.png", photo)
    blender.do(
        "bpy.context.area.spaces.active.show_region_ui = True\n"
        f"bpy.ops.facestage.choose_photo(filepath={str(photo)!r})\n"
        "bpy.ops.facestage.build_stage()\n"
        "bpy.ops.facestage.clear_stage()\n"
        "bpy.ops.facestage.detect_landmarks('INVOKE_DEFAULT')\n"
    )
    blender.idle()
    blender.do("bpy.ops.facestage.done_landmarks()")
    blender.do("bpy.ops.facestage.build_rig('INVOKE_DEFAULT')")
    blender.idle()
    blender.press(1000, 800)
    blender.open_tab()
    return np.array(
        blender.do(
            "import json\n"
            f"answer = json.load(open(bpy.path.abspath({SETTINGS}.landmarks)))['points']"
        )
    )


def test_the_face_is_put_where_the_landmarks_are(blender: Blender, landmarks: np.ndarray):
    blender.do("bpy.context.preferences.view.show_splash = False")
    blender.shot("before-pins")
    blender.click("Pin Face")
    blender.until(f"{SETTINGS}.pinning")
    blender.shot("wireframe")
    blender.find("Drag the wireframe")


def test_the_wireframe_is_dragged(blender: Blender, landmarks: np.ndarray):
    corner, by = landmarks[291], np.array([8.0, -4.0])  # of the mouth
    before = pins(blender)[2]
    at, to = place(blender, corner), place(blender, corner + by)
    blender.drag(at, ((at[0] + to[0]) // 2, (at[1] + to[1]) // 2), to, let_go=False)
    blender.shot("dragging")
    blender.let_go()
    points, shown, after = pins(blender)
    blender.shot("dragged")
    assert np.abs(points - (corner + by)).max() < 1.0
    assert np.abs(shown - points).max() < 0.5
    assert np.abs(after - before).max() > 0.1
    blender.find("1 pin for the next fit")


def test_esc_and_undo_put_the_face_back(blender: Blender, landmarks: np.ndarray):
    tip = landmarks[4]
    before = pins(blender)
    at, to = place(blender, tip), place(blender, tip + np.array([6.0, 0.0]))
    blender.drag(at, to, let_go=False)
    assert len(pins(blender)[0]) == 2
    blender.key("Escape")
    blender.let_go()
    np.testing.assert_allclose(pins(blender)[2], before[2], atol=1e-5)
    assert len(pins(blender)[0]) == 1
    blender.drag(at, to)
    assert len(pins(blender)[0]) == 2
    blender.key("ctrl+z")
    time.sleep(1.0)
    blender.shot("undone")
    assert len(pins(blender)[0]) == 1
    np.testing.assert_allclose(pins(blender)[2], before[2], atol=1e-5)


def test_a_pin_is_removed_by_the_right_button_and_by_x(blender: Blender, landmarks: np.ndarray):
    for key in ("", "x"):
        here = place(blender, pins(blender)[0][0])
        blender.move(*here)
        if key:
            blender.key(key)
        else:
            blender.press(*here, button=3)
        blender.until(f"{SETTINGS}.pins == ''")
        blender.drag(here, here)
        blender.until(f"{SETTINGS}.pins != ''")
    blender.do("bpy.ops.facestage.clear_pins()")
    blender.click("Pin Face")
    blender.until(f"not {SETTINGS}.pinning")
    blender.shot("pinned-no-more")


def test_the_tool_of_the_toolbar_shows_the_wireframe_first(blender: Blender, landmarks: np.ndarray):
    blender.do(
        "region = next(each for each in bpy.context.area.regions if each.type == 'WINDOW')\n"
        "with bpy.context.temp_override(region=region):\n"
        "    bpy.ops.wm.tool_set_by_id(name='facestage.pins')\n"
    )
    here = place(blender, landmarks[4])
    blender.press(*here)
    blender.until(f"{SETTINGS}.pinning")
    assert blender.ask(f"{SETTINGS}.pins") == ""
    blender.drag(place(blender, landmarks[4]), place(blender, landmarks[4] + 4.0))
    blender.until(f"{SETTINGS}.pins != ''")
    blender.shot("by-the-tool")
    blender.do("bpy.ops.facestage.clear_pins()\nbpy.ops.facestage.pin_face()")

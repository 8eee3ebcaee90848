"""The README's five minutes in Blender's window, from its default scene: by the mouse where a
person would, a picture after each step.
"""

from __future__ import annotations

import json
import os
import shutil
import struct
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from facestage.contract.files.color import srgb_to_linear
from window.blender import Blender

ADDON = "bpy.context.preferences.addons['bl_ext.user_default.facestage_blender']"
PHOTO = "a portrait.png"  # a name as people have them
SETTINGS = "bpy.context.scene.facestage"
STATE = "bpy.context.window_manager.facestage"
SPACE = "bpy.context.area.spaces.active"
BROWSER = (250, 190, 1100, 625)  # where Blender opens its file browser on this screen
BELOW = 31  # pixels from a panel's title to its first row
PATH_FIELD, ACCEPT = (825, 208), (1280, 790)


@pytest.fixture(scope="module")
def photo(blender: Blender) -> Path:
    """The portrait that scikit-image has, in a folder with a space."""
    import skimage

    path = blender.out / "my photos" / PHOTO
    path.parent.mkdir(exist_ok=True)
    shutil.copyfile(Path(skimage.__file__).parent / "data" / "astronaut.png", path)
    return path


def test_the_sidebar_has_a_tab_with_the_steps(blender: Blender):
    blender.do("bpy.context.area.spaces.active.show_region_ui = True")
    blender.press(1000, 800)  # away from the splash screen
    blender.press(1308, 262)  # the tab, whose letters stand upright
    blender.shot("sidebar")
    for step in ("1 Photo", "2 Light Stage", "3 Face", "4 Fit", "5 Result"):
        blender.find(step)
    blender.find("Still needed: photo, light stage, face")


def test_without_a_backend_the_sidebar_offers_to_install_it(blender: Blender):
    blender.do(f"{ADDON}.preferences.backend = ''")
    blender.shot("no-backend")
    blender.click("Install Backend")
    blender.until(f"'online access is off' in {STATE}.failure")
    blender.move(500, 600)  # away from the message, which goes then
    blender.shot("no-online-access")
    blender.find("Installing needs the network")
    blender.do(f"{ADDON}.preferences.backend = {str(blender.backend)!r}")


def test_the_backend_is_installed_from_a_folder(blender: Blender):
    wheels = os.environ.get("FACESTAGE_WHEELS")
    if not wheels:
        pytest.skip(
            "needs a folder with the backend's wheels for Debian's Python: FACESTAGE_WHEELS"
        )
    folder = blender.out / "wheels"
    shutil.copytree(wheels, folder, dirs_exist_ok=True)
    blender.do(f"{ADDON}.preferences.backend = ''\n{ADDON}.preferences.wheels = {str(folder)!r}\n")
    blender.click("Install Backend")
    blender.until(f"{STATE}.fraction > 0.1", 120)
    blender.shot("installing")
    blender.idle(600)
    blender.shot("installed")
    assert blender.ask(f"{STATE}.failure") == ""
    blender.do("bpy.ops.facestage.check_backend('INVOKE_DEFAULT')")
    blender.idle()
    assert "This machine can fit." in blender.ask(f"{ADDON}.preferences.report")
    # The landmark model is in this machine's cache, not in that of Blender's Debian.
    blender.do(f"{ADDON}.preferences.backend = {str(blender.backend)!r}")


def test_a_photo_is_chosen_and_seen(blender: Blender, photo: Path):
    blender.click("Choose Photo")
    blender.press(*PATH_FIELD)
    blender.press(*PATH_FIELD)
    blender.key("ctrl+a")
    blender.type(f"{photo.parent}/")
    blender.key("Return")
    blender.click(photo.name, BROWSER)
    blender.shot("photo-browser")
    blender.press(*ACCEPT)
    blender.until(f"{SETTINGS}.photo == {str(photo)!r}")
    blender.shot("photo")
    assert blender.ask("bpy.context.scene.render.resolution_x") == 512
    assert blender.ask(f"{SPACE}.region_3d.view_perspective") == "CAMERA"
    blender.find(photo.name)


def test_landmarks_are_detected_dragged_and_kept(blender: Blender):
    blender.click("Detect Landmarks")
    blender.until(f"{SETTINGS}.landmark_plane")
    blender.idle()
    blender.shot("landmarks")
    blender.click("Done")
    blender.until(f"{SETTINGS}.landmarks.endswith('.json')")
    blender.find("478 points, found automatically")


def test_the_stage_names_what_is_in_the_way_and_hides_it(blender: Blender):
    blender.click("Build Light Stage")
    blender.until(f"{SETTINGS}.stage")
    blender.shot("stage")
    blender.find("In the way: Cube, Light, the")
    blender.find("world's light")
    blender.click("Hide What Is in the Way")
    blender.until("bpy.data.objects['Cube'].hide_render")
    blender.shot("stage-cleared")
    blender.find("Give Back")


def test_the_face_rig_is_built(blender: Blender):
    blender.click("Build Face Rig")
    blender.until(f"{SETTINGS}.rig", 200)
    blender.idle()
    blender.shot("rig")
    blender.find("Rebuild Face Rig")


def test_the_fit_shows_its_progress_and_its_result(blender: Blender):
    blender.do(f"{SETTINGS}.quality = 'draft'")
    blender.click("Fit to Photo")
    blender.until(f"{STATE}.task == 'Fitting' and {STATE}.fraction > 0.05", 200)
    blender.shot("fit-running")
    blender.find("s left")
    blender.idle()
    assert blender.ask(f"{STATE}.failure") == ""
    blender.until(f"{SETTINGS}.result")
    blender.shot("fit-done")
    blender.find("Converged: the render explains")


def test_the_lights_are_previewed_and_the_face_is_relit(blender: Blender):
    blender.scroll(10)
    blender.click("Relight Preview")
    blender.until("bpy.context.window_manager.facestage_preview.active")
    blender.shot("relight-preview")
    blender.do("bpy.ops.facestage.relight(direction='left')")
    time.sleep(1.0)  # the preview follows in a moment
    blender.shot("relit-from-the-left")
    blender.click("Before / After")
    blender.shot("before")
    blender.click("Before / After")
    blender.do("bpy.ops.facestage.relight(direction='rembrandt')")
    time.sleep(1.0)
    blender.shot("rembrandt")
    blender.do(
        "folder = bpy.utils.system_resource('DATAFILES', path='studiolights/world')\n"
        "bpy.ops.facestage.light_from_picture(filepath=f'{folder}/sunset.exr')\n"
    )
    time.sleep(1.0)
    blender.shot("light-from-picture")
    blender.click("Light From")
    blender.shot("light-from")
    blender.key("Escape")
    blender.do("bpy.ops.facestage.relight(direction='fitted')")
    blender.do("bpy.ops.facestage.relight_preview()")
    assert not blender.ask("bpy.context.window_manager.facestage_preview.active")


def test_an_expression_changes_the_face(blender: Blender):
    jaw = f"{SETTINGS}.rig.data.shape_keys.key_blocks['jawOpen'].value"
    fitted = blender.ask(jaw)
    blender.do(f"{jaw} = 0.8")
    blender.shot("jaw-open")
    blender.scroll(20)
    blender.click("Expression")
    blender.scroll(20)
    blender.click("Jaw")
    blender.scroll(20)
    blender.shot("expressions")
    blender.find("jawOpen")
    blender.click("Neutral")
    blender.until(f"{jaw} == 0.0")
    blender.click("As Fitted")
    blender.until(f"abs({jaw} - {fitted}) < 1e-6")


def test_handles_move_the_face(blender: Blender):
    smile = f"{SETTINGS}.rig.data.shape_keys.key_blocks['mouthSmileLeft'].value"
    blender.do("bpy.ops.facestage.add_control_rig()")
    blender.do(
        f"rig = {SETTINGS}.rig.facestage_face.control_rig\n"
        "for side in 'LR':\n"
        "    rig.pose.bones[f'lips.{side}'].location.y = 0.006\n"
        "rig.pose.bones['eyes'].location.x = 0.1\n"
    )
    blender.until(f"{smile} > 0.5")
    blender.shot("control-rig")
    blender.do("bpy.ops.facestage.remove_control_rig()")
    blender.do("bpy.ops.facestage.set_expression(to='FITTED')")


def test_eevee_renders_the_face_as_bright_as_the_photo(blender: Blender, photo: Path):
    assert "EEVEE" in blender.ask("bpy.context.scene.render.engine")
    picture = blender.out / "eevee.png"
    blender.do(
        "render = bpy.context.scene.render\n"
        "before, render.resolution_percentage = render.resolution_percentage, 25\n"
        "bpy.context.scene.eevee.taa_render_samples = 4\n"
        f"render.filepath = {str(picture)!r}\n"
        "bpy.ops.render.render(write_still=True)\n"
        "render.resolution_percentage = before\n",
        600,
    )
    landmarks = json.loads(Path(blender.ask(f"{SETTINGS}.landmarks")).read_text(encoding="utf-8"))
    rendered, shown = _cheeks(picture, landmarks), _cheeks(photo, landmarks)
    assert rendered / shown == pytest.approx(1.0, abs=0.15)


def test_the_face_is_exported_with_its_skin(blender: Blender):
    path = blender.out / "face.glb"
    path.unlink(missing_ok=True)
    blender.do(f"bpy.ops.facestage.export(filepath={str(path)!r})")
    content = path.read_bytes()
    length = struct.unpack_from("<I", content, 12)[0]
    described = json.loads(content[20 : 20 + length])
    assert any(
        "baseColorTexture" in each.get("pbrMetallicRoughness", {})
        for each in described["materials"]
    )
    assert "jawOpen" in described["meshes"][0]["extras"]["targetNames"]


def test_a_saved_file_finds_all_again(blender: Blender):
    path = blender.out / "saved" / "a face.blend"
    shutil.rmtree(path.parent, ignore_errors=True)
    path.parent.mkdir()
    blender.do(f"bpy.ops.wm.save_as_mainfile(filepath={str(path)!r})")
    assert blender.ask(f"{STATE}.verdict").startswith("Converged")
    blender.do("bpy.ops.wm.read_homefile(app_template='')")
    assert blender.ask(f"{STATE}.verdict") == ""  # it was another file's
    moved = path.parent.with_name("moved")
    shutil.rmtree(moved, ignore_errors=True)
    path.parent.rename(moved)
    blender.do(f"bpy.ops.wm.open_mainfile(filepath={str(moved / path.name)!r})")
    blender.until(SETTINGS)
    assert blender.ask(f"{SETTINGS}.result").startswith("//")
    blender.do("bpy.ops.facestage.apply_result()")
    blender.shot("saved-and-opened")


def test_light_as_world_takes_the_lights_of_a_picture(blender: Blender):
    blender.do(
        "folder = bpy.utils.system_resource('DATAFILES', path='studiolights/world')\n"
        "world = bpy.data.worlds.new('Sunset')\n"
        "world.use_nodes = True\n"
        "node = world.node_tree.nodes.new('ShaderNodeTexEnvironment')\n"
        "node.image = bpy.data.images.load(f'{folder}/sunset.exr')\n"
        "surface = world.node_tree.nodes['Background'].inputs['Color']\n"
        "world.node_tree.links.new(node.outputs['Color'], surface)\n"
        "bpy.context.scene.world = world\n"
    )
    blender.shot("world")
    blender.scroll(-20)
    blender.click("Light as World")
    blender.until(f"{SETTINGS}.exposure_known == False")
    blender.shot("light-as-world")


def test_photos_of_a_person_are_listed_and_shown_in_turn(blender: Blender, photo: Path):
    other = photo.with_name("closer.png")
    assert cv2.imwrite(str(other), cv2.imread(str(photo))[:400, 60:440])
    files = f"directory={str(other.parent)!r}, files=[{{'name': {other.name!r}}}]"
    blender.do(f"bpy.ops.facestage.add_photos({files})")
    blender.scroll(-20)
    blender.shot("two-photos")
    assert blender.ask("bpy.context.scene.render.resolution_x") == 380
    blender.find("Fit to 2 Photos")
    blender.click(photo.name)
    blender.until(f"{SETTINGS}.photo_number == 1")
    blender.shot("first-of-two-photos")
    assert blender.ask("bpy.context.scene.render.resolution_x") == 512
    assert blender.ask(f"{SETTINGS}.landmarks").endswith(".json")
    blender.do("bpy.ops.facestage.remove_photo(number=2)")
    assert blender.ask(f"len({SETTINGS}.photos)") == 0


def test_esc_does_not_end_a_fit_and_cancel_is_no_error(blender: Blender):
    blender.do("bpy.ops.facestage.build_stage()")
    blender.click("Fit to Photo")
    blender.until(f"{STATE}.task == 'Fitting'")
    blender.move(500, 600)
    blender.key("Escape")
    assert blender.ask(f"{STATE}.task") == "Fitting"
    _, title = blender.find("4 Fit")
    left, _, width, _ = blender.sidebar()
    blender.press(left + width - 20, title + BELOW)  # the cross after the progress
    blender.idle()
    blender.shot("fit-cancelled")
    assert blender.ask(f"{STATE}.failure") == ""
    blender.find("Cancelled")
    assert blender.ask(f"{STATE}.verdict") == ""


def test_closing_the_preferences_ends_their_check(blender: Blender):
    blender.do(
        "bpy.ops.screen.userpref_show()\n"
        "window = bpy.context.window_manager.windows[-1]\n"
        "window.screen.areas[0].ui_type = 'PREFERENCES'\n"
        "bpy.context.preferences.active_section = 'ADDONS'\n"
        "bpy.context.window_manager.addon_search = 'Facestage'\n"
        "bpy.ops.preferences.addon_expand(module='bl_ext.user_default.facestage_blender')\n"
        "with bpy.context.temp_override(window=window):\n"
        "    bpy.ops.facestage.check_backend('INVOKE_DEFAULT')\n"
    )
    blender.shot("preferences")
    blender.do(
        "with bpy.context.temp_override(window=bpy.context.window_manager.windows[-1]):\n"
        "    bpy.ops.wm.window_close()\n"
    )
    blender.idle(60)
    assert len(blender.ask("list(bpy.context.window_manager.windows)")) == 1


def test_a_new_file_ends_the_fit(blender: Blender):
    blender.do("bpy.ops.facestage.fit('INVOKE_DEFAULT')")
    process = blender.do(
        "from bl_ext.user_default.facestage_blender.ui.backend_task import Running\n"
        "answer = Running.process.pid\n"
    )
    assert Path(f"/proc/{process}").exists()
    blender.do("bpy.ops.wm.read_homefile(app_template='')")
    assert blender.ask(f"{STATE}.task") == ""
    blender.wait(lambda: not _runs(process), 60, "the end of the backend")


def _runs(process: int) -> bool:
    """Whether a process is more than an entry that nobody has collected."""
    try:
        status = Path(f"/proc/{process}/stat").read_text(encoding="utf-8")
    except OSError:
        return False
    return status.rpartition(")")[2].split()[0] != "Z"


def _cheeks(picture: Path, landmarks: dict[str, list[list[float]]]) -> float:
    """Mean linear radiance in the middle of the face."""
    image = cv2.imread(str(picture))
    points = np.array(landmarks["points"]) * image.shape[1] / 512
    middle, reach = points.mean(axis=0), 0.25 * np.ptp(points, axis=0)
    (left, top), (right, bottom) = (middle - reach).astype(int), (middle + reach).astype(int)
    return float(srgb_to_linear(image[top:bottom, left:right] / np.float32(255)).mean())

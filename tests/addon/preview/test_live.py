"""The live relight preview: what it shows, when it works, and that nothing of it stays behind."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from facestage.contract.relight_cache import RELIGHT_CACHE, RelightCache
from facestage.contract.result import Result
from reference.fit_scene import fit_scene

GREY = ((128 / 255 + 0.055) / 1.055) ** 2.4  # the photo's, linear


@pytest.fixture
def applied(scene, stand_in, photo: Path, landmark_file: Path, tmp_path: Path) -> Iterator[object]:
    """A scene with an applied result that has no relight cache yet."""

    from facestage_blender.preview import live as preview

    stand_in("works")
    scene.facestage.output = str(tmp_path / "work")
    scene.facestage.light_count = 5
    fit_scene(photo, landmark_file)
    yield scene
    preview.stop()


@pytest.fixture
def live(applied) -> object:
    """The same with the preview on."""
    import bpy

    assert bpy.ops.facestage.prepare_relight() == {"FINISHED"}
    return applied


def shown() -> np.ndarray:
    """(h, w, 3) what the preview's image holds, row 0 at the top."""
    from facestage_blender.pictures.images import image_pixels
    from facestage_blender.preview.live import find_image

    image = find_image()
    assert image is not None and image.is_float
    return image_pixels(image)[..., :3]


def expected(scene) -> np.ndarray:
    """(h, w, 3) the photo times what the scene's lights make of the head over what the fitted ones
    make of it.
    """
    from facestage_blender.preview.relit_photo import BRIGHTEST, FLOOR
    from facestage_blender.scene.paths import absolute
    from facestage_blender.scene.stage import read_stage

    result = Result.load(absolute(scene.facestage.result))
    cache = RelightCache.load(result)
    relit = cache.colors(read_stage(scene.facestage.stage).radiance).astype(float)
    fitted = cache.colors(result.stage.radiance).astype(float)
    picture = np.full((cache.height * cache.width, 3), GREY)
    for channel in range(3):
        now, then = relit[:, channel], fitted[:, channel]
        floor = FLOOR * np.median(then)
        ratio = (now + now.sum() / then.sum() * floor) / (then + floor)
        ratio = np.where(ratio < BRIGHTEST, ratio, BRIGHTEST)
        picture[cache.pixels, channel] = GREY * (1 - cache.coverage + cache.coverage * ratio)
    return picture.reshape(cache.height, cache.width, 3)


def status() -> str:
    import bpy

    return bpy.context.window_manager.facestage_preview.status


def update(scene) -> None:
    """What Blender does after each change of the user's."""
    scene.view_layers[0].update()


def handlers() -> list[object]:
    """Everything of the add-on in Blender's lists of handlers."""
    import bpy

    lists = [item for item in vars(type(bpy.app.handlers)) if not item.startswith("_")]
    return [
        handler
        for name in lists
        if isinstance(entries := getattr(bpy.app.handlers, name, None), list)
        for handler in entries
        if getattr(handler, "__module__", "").startswith("facestage_blender")
    ]


def test_without_a_cache_one_sentence_says_what_to_do(applied) -> None:
    import bpy

    with pytest.raises(RuntimeError, match="no relight cache; make it with Prepare Relight"):
        bpy.ops.facestage.relight_preview()
    assert not bpy.context.window_manager.facestage_preview.active


def test_backend_prepares_the_preview(applied) -> None:
    import bpy

    assert bpy.ops.facestage.prepare_relight() == {"FINISHED"}
    assert (Path(applied.facestage.result) / RELIGHT_CACHE).is_file()
    assert bpy.context.window_manager.facestage_preview.active and not status()
    np.testing.assert_allclose(shown(), expected(applied), rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(shown(), GREY, rtol=1e-4)  # under the fitted lights, the photo


def test_refused_preparation_is_reported(applied, stand_in) -> None:
    import bpy

    stand_in("refuses")
    with pytest.raises(RuntimeError, match="photo is of a cat"):
        bpy.ops.facestage.prepare_relight()
    assert not bpy.context.window_manager.facestage_preview.active


def test_color_power_and_state_of_the_lights_are_followed(live) -> None:
    import bpy

    from facestage_blender.scene.stage import stage_lights

    light, before = stage_lights(live.facestage.stage)[1], shown().copy()
    for owner, name, value in (
        (light.data, "energy", 40.0),
        (light.data, "color", (0.1, 0.9, 0.4)),
        (light.facestage_light, "state", "OFF"),
        (light.facestage_light, "state", "ON"),
    ):
        setattr(owner, name, value)
        update(live)
        after = shown().copy()
        assert np.abs(after - before).max() > 1e-3, name
        np.testing.assert_allclose(after, expected(live), rtol=1e-4, atol=1e-5, err_msg=name)
        before = after
    assert bpy.ops.facestage.light_states(state="OFF") == {"FINISHED"}
    update(live)
    cache = RelightCache.load(Result.load(Path(live.facestage.result)))
    np.testing.assert_allclose(
        shown().reshape(-1, 3)[cache.pixels][:, 0], GREY * (1 - cache.coverage), atol=1e-5
    )


def test_nothing_is_made_when_nothing_changed(live, monkeypatch: pytest.MonkeyPatch) -> None:
    from facestage_blender.preview import live as preview
    from facestage_blender.scene.stage import stage_lights

    made = []
    show = preview._show

    def counted(*arguments: Any) -> None:
        made.append(1)
        show(*arguments)

    monkeypatch.setattr(preview, "_show", counted)
    live.facestage.rig.hide_render = True
    update(live)
    live.facestage.budget = 3.0
    update(live)
    assert not made
    stage_lights(live.facestage.stage)[0].data.energy *= 2
    update(live)
    update(live)
    assert len(made) == 1


@pytest.mark.parametrize(
    "change", ["light moved", "light resized", "head", "slider", "lens", "camera", "cache gone"]
)
def test_what_the_cache_does_not_hold_is_said_and_the_photo_shown(live, change: str) -> None:
    from facestage_blender.scene.stage import stage_lights

    light, rig = stage_lights(live.facestage.stage)[2], live.facestage.rig
    key = rig.data.shape_keys.key_blocks["jawOpen"]
    cache = Path(live.facestage.result) / RELIGHT_CACHE
    kept = cache.read_bytes()
    owner, name, value, sentence = {
        "light moved": (light, "location", light.location + light.location, "Light 3 was moved"),
        "light resized": (light.data, "size", 0.5, "Light 3 was moved, turned or resized"),
        "head": (rig, "location", (0.0, 0.0, 0.1), "head was moved"),
        "slider": (key, "value", key.value + 0.3, "slider was moved"),
        "lens": (live.camera.data, "lens", 20.0, "another lens"),
        "camera": (live.camera, "location", (0.0, -2.0, 0.0), "camera was moved"),
        "cache gone": (light.data, "energy", 5.0, "no relight cache"),
    }[change]
    before = getattr(owner, name)
    before = before.copy() if hasattr(before, "copy") else before
    if change == "cache gone":
        cache.unlink()
    setattr(owner, name, value)
    update(live)
    assert sentence in status()
    np.testing.assert_allclose(shown(), GREY, atol=1e-5)
    setattr(owner, name, before)
    cache.write_bytes(kept)
    live.facestage.stage.update_tag()
    update(live)
    assert not status()
    np.testing.assert_allclose(shown(), expected(live), rtol=1e-4, atol=1e-5)


def test_under_a_softbox_the_photo_is_shown(live) -> None:
    import bpy

    assert bpy.ops.facestage.softbox() == {"FINISHED"}
    update(live)
    assert "softbox" in status()
    np.testing.assert_allclose(shown(), GREY, atol=1e-5)
    assert bpy.ops.facestage.relight(direction="fitted") == {"FINISHED"}
    update(live)
    assert not status()


def test_the_image_lies_over_the_cameras_view_until_turned_off(live) -> None:
    import bpy

    from facestage_blender.preview.live import find_image

    fronts = [item for item in live.camera.data.background_images if item.display_depth == "FRONT"]
    assert [item.image for item in fronts] == [find_image()]
    assert len(live.camera.data.background_images) == 2  # the photo is the other
    assert bpy.ops.facestage.relight_preview() == {"FINISHED"}
    assert find_image() is None and len(live.camera.data.background_images) == 1
    assert not bpy.app.handlers.depsgraph_update_post
    assert not bpy.context.window_manager.facestage_preview.active
    assert bpy.ops.facestage.relight_preview() == {"FINISHED"}
    assert find_image() is not None


def test_undo_and_redo_are_followed(live) -> None:
    import bpy

    from facestage_blender.scene.stage import stage_lights

    bpy.ops.ed.undo_push(message="before")
    bright = shown().copy()
    stage_lights(live.facestage.stage)[0].data.energy *= 3
    update(live)
    changed = shown().copy()
    bpy.ops.ed.undo_push(message="light")
    bpy.ops.ed.undo()
    np.testing.assert_allclose(shown(), bright, atol=1e-5)
    bpy.ops.ed.redo()
    np.testing.assert_allclose(shown(), changed, atol=1e-5)
    assert np.abs(changed - bright).max() > 1e-3


def test_undo_does_not_bring_back_a_preview_that_is_off(live) -> None:
    import bpy

    from facestage_blender.preview.live import find_image

    bpy.ops.ed.undo_push(message="on")
    bpy.ops.facestage.relight_preview()
    bpy.ops.ed.undo_push(message="off")
    bpy.ops.ed.undo()
    assert find_image() is None
    assert len(bpy.context.scene.camera.data.background_images) == 1


def test_the_preview_is_not_saved(live, tmp_path: Path) -> None:
    import bpy

    from facestage_blender.preview.live import find_image

    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"), check_existing=False)
    assert find_image() is not None, "it goes on after saving"
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    assert find_image() is None
    assert len(bpy.context.scene.camera.data.background_images) == 1
    assert not bpy.context.window_manager.facestage_preview.active
    assert not bpy.app.handlers.depsgraph_update_post
    assert bpy.ops.facestage.relight_preview() == {"FINISHED"}
    np.testing.assert_allclose(shown(), expected(bpy.context.scene), rtol=1e-4, atol=1e-5)


def test_nothing_stays_when_the_addon_is_disabled(live) -> None:
    import bpy

    from facestage_blender import registration
    from facestage_blender.preview.live import find_image

    assert handlers()
    registration.unregister()
    try:
        assert not handlers() and find_image() is None
        assert not bpy.app.handlers.depsgraph_update_post
    finally:
        registration.register()


def test_a_deleted_scene_ends_the_preview(live) -> None:
    import bpy

    from facestage_blender.preview import live as preview

    bpy.data.scenes.new("another")
    bpy.data.scenes.remove(live)
    preview.refresh()
    assert preview.Preview.photo is None and preview.find_image() is None


def test_without_its_photo_the_face_alone_is_shown(live) -> None:
    import bpy

    from facestage_blender.scene.stage import read_stage

    assert bpy.ops.facestage.relight_preview() == {"FINISHED"}
    live.facestage.photo = ""
    assert bpy.ops.facestage.relight_preview() == {"FINISHED"}
    cache = RelightCache.load(Result.load(Path(live.facestage.result)))
    wanted = cache.relight(read_stage(live.facestage.stage).radiance)
    np.testing.assert_allclose(shown(), wanted, rtol=1e-4, atol=1e-5)


def test_before_and_after_are_shown_in_turn(live) -> None:
    import bpy

    from facestage_blender.preview.live import MARK

    def state() -> tuple[str, list[bool]]:
        photo, *others = live.camera.data.background_images
        return photo.display_depth, [
            each.show_background_image for each in others if each.image.get(MARK)
        ]

    assert state() == ("BACK", [True])
    assert bpy.ops.facestage.before_after() == {"FINISHED"}
    assert state() == ("FRONT", [False])
    bpy.ops.facestage.relight_preview()
    bpy.ops.facestage.relight_preview()
    assert state() == ("FRONT", [False])  # a preview that begins meanwhile
    assert bpy.ops.facestage.before_after() == {"FINISHED"}
    assert state() == ("BACK", [True])
    live.facestage.pinning = True
    assert not bpy.ops.facestage.before_after.poll()

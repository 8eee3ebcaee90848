"""A phone's recording becomes keyframes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from addon.ui.refusal import refused

NAMES = ("EyeBlinkLeft", "JawOpen", "MouthSmileLeft", "MouthSmileRight", "HeadYaw")
Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Write lines as the app does, behind its head."""

    def recording(lines: Sequence[str], head: str = "Timecode,BlendShapeCount,") -> Path:
        path = tmp_path / "take 1.csv"
        text = "\n".join([head + ",".join(NAMES), *lines, ""])
        path.write_text(text, encoding="utf-8-sig")
        return path

    return recording


@pytest.fixture
def rig(scene, head):
    from facestage_blender.rig.face_rig import build_rig
    from facestage_blender.scene.stage import new_stage

    names = ("jawOpen", "mouthSmile_L", "mouthSmile_R", "AU1")
    return build_rig(scene, replace(head, expression_names=names), "default", new_stage(scene))


def line(time: str, *weights: float) -> str:
    return ",".join([time, "61", *map(str, weights)])


def test_a_recording_plays_in_its_own_time(rig, scene, write: Write) -> None:
    import bpy

    scene.render.fps, scene.frame_end = 24, 30
    path = write(
        [
            line("23:59:59:30.0", 0.9, 0.0, 0.2, 0.4, 9.0),
            line("23:59:59:45.0", 0.9, 0.5, 0.2, 0.4, 9.0),
            line("23:59:59:45.0", 0.9, 0.7, 0.9, 0.9, 9.0),  # the same moment again
            line("00:00:01:00.000", 0.9, 1.0, 0.6, 0.0, 9.0),  # past midnight
        ]
    )
    scene.frame_set(10)
    assert bpy.ops.facestage.import_live_link(filepath=str(path)) == {"FINISHED"}
    keys = rig.data.shape_keys.key_blocks

    def at(frame: int) -> list[float]:
        scene.frame_set(frame)
        return [keys[name].value for name in ("jawOpen", "mouthSmile_L", "mouthSmile_R")]

    assert at(10) == pytest.approx([0.0, 0.2, 0.4])
    assert at(16) == pytest.approx([0.5, 0.2, 0.4])
    assert at(46) == pytest.approx([1.0, 0.6, 0.0])
    assert at(31) == pytest.approx([0.75, 0.4, 0.2])  # in a straight line
    assert scene.frame_end == 46
    assert keys["AU1"].value == 0.0


def test_another_take_replaces_what_it_covers(rig, scene, write: Write) -> None:
    import bpy

    scene.render.fps, scene.frame_current = 60, 1
    lines = [line(f"10:00:00:{frame:02}.0", 0, frame / 40, 0, 0, 0) for frame in range(41)]
    bpy.ops.facestage.import_live_link(filepath=str(write(lines)))
    scene.frame_set(11)
    short = [line(f"10:00:00:{frame:02}.0", 0, 0.9, 0, 0, 0) for frame in range(11)]
    bpy.ops.facestage.import_live_link(filepath=str(write(short)))
    found = []
    for frame in (1, 6, 11, 16, 21, 31, 41):
        scene.frame_set(frame)
        found.append(rig.data.shape_keys.key_blocks["jawOpen"].value)
    assert found == pytest.approx([0.0, 0.125, 0.9, 0.9, 0.9, 0.75, 1.0])


@pytest.mark.parametrize(
    ("lines", "beginning", "sentence"),
    [
        ([], "Timecode,BlendShapeCount,", "it has no frames"),
        (["10:00:00:00.0,61,0,0,0,0,0"], "Time,BlendShapeCount,", "names no Timecode"),
        (["10:00:00:00.0,61,0,0"], "Timecode,BlendShapeCount,", "too short"),
        (["soon,61,0,0,0,0,0"], "Timecode,BlendShapeCount,", "'soon' is no timecode"),
        (["10:00:00:00.0,61,0,wide,0,0,0"], "Timecode,BlendShapeCount,", "is no number"),
        (["10:00:00:00.0,61,0,nan,0,0,0"], "Timecode,BlendShapeCount,", "is not finite"),
    ],
)
def test_what_is_no_recording_is_refused(
    rig, write: Write, lines: list[str], beginning: str, sentence: str
) -> None:
    import bpy

    refused(bpy.ops.facestage.import_live_link, sentence, filepath=str(write(lines, beginning)))
    assert rig.data.shape_keys.animation_data is None


def test_a_picture_is_no_recording(rig, photo: Path) -> None:
    import bpy

    refused(bpy.ops.facestage.import_live_link, "it is no table", filepath=str(photo))


def test_a_face_without_arkits_names_is_refused(scene, head, write: Write) -> None:
    import bpy

    from facestage_blender.rig.face_rig import build_rig
    from facestage_blender.scene.stage import new_stage

    names = ("a", "b", "c", "d")
    build_rig(scene, replace(head, expression_names=names), "default", new_stage(scene))
    path = write([line("10:00:00:00.0", 0, 0, 0, 0, 0)])
    refused(bpy.ops.facestage.import_live_link, "none of ARKit's expressions", filepath=str(path))

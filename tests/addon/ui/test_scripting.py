"""Every operator can be called from Python with plain arguments, and docs/scripting.md says with
which.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from facestage.contract.face_model import FaceModel

# What only a file dialog looks at.
OF_DIALOGS = {"rna_type", "filter_glob", "filter_folder", "check_existing"}
# These would change what Blender's user has installed.
OF_THIS_MACHINE = {"install_backend", "remove_backend"}


@pytest.fixture(scope="module")
def default_head() -> FaceModel:
    from facestage.models.registry import load_model

    return load_model("default")


def operators() -> Iterator[tuple[str, dict[str, str]]]:
    """The add-on's operators with their arguments and defaults, as Python writes them."""
    import bpy

    for name in sorted(dir(bpy.ops.facestage)):
        kind = getattr(bpy.ops.facestage, name).get_rna_type()
        yield (
            name,
            {
                each.identifier: default(each)
                for each in kind.properties
                if each.identifier not in OF_DIALOGS
            },
        )


def default(argument) -> str:
    if argument.type == "COLLECTION":
        return "[...]"
    if getattr(argument, "is_array", False):
        return str(tuple(argument.default_array))
    if argument.type == "FLOAT":
        return repr(round(argument.default, 4))
    return repr(argument.default)


def test_the_table_has_every_operator_with_its_arguments(scene, repository: Path) -> None:
    table = (repository / "docs" / "scripting.md").read_text(encoding="utf-8")
    said = dict(re.findall(r"^\| `(\w+)\((.*)\)` \| [^|]+ \|$", table, re.MULTILINE))
    there = {
        name: ", ".join(f"{argument}={value}" for argument, value in arguments.items())
        for name, arguments in operators()
    }
    assert said == there


def test_what_is_missing_is_said_in_a_sentence_without_a_window(
    scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Called with nothing set up, each acts, or refuses in words; none asks."""
    import bpy

    monkeypatch.setenv("FACESTAGE_BACKEND", "/no/such/program")
    called = 0
    for name, _ in operators():
        if name in OF_THIS_MACHINE:
            continue
        called += 1
        try:
            assert getattr(bpy.ops.facestage, name)() in ({"FINISHED"}, {"CANCELLED"}), name
        except RuntimeError as error:
            words = str(error).strip()
            assert "context is incorrect" not in words, f"{name}: {words}"
            assert "Traceback" not in words and re.search(r"[a-z]", words), name
    assert called > 40


def test_a_landmark_is_marked_by_the_number_of_its_vertex(scene, head) -> None:
    import bpy

    from addon.ui.refusal import refused
    from facestage_blender.rig.face_rig import build_mesh
    from facestage_blender.rig.own_marks import read_marks

    item = bpy.data.objects.new("Alice", build_mesh(head))
    scene.collection.objects.link(item)
    bpy.context.view_layer.objects.active = item
    assert bpy.ops.facestage.mark_landmark(landmark="chin", vertex=17) == {"FINISHED"}
    assert read_marks(item)["chin"].tolist() == [17]
    refused(bpy.ops.facestage.mark_landmark, "no vertex 99999", landmark="chin", vertex=99999)
    assert bpy.ops.facestage.clear_landmark(landmark="chin") == {"FINISHED"}
    assert not read_marks(item)


def test_whatever_can_be_on_or_off_can_be_asked_to_be_so(scene) -> None:
    import bpy

    from facestage_blender.registration import MODULES
    from facestage_blender.ui.action import Toggle

    toggles = {
        cls.bl_idname.partition(".")[2]
        for module in MODULES
        for cls in module.CLASSES
        if issubclass(cls, Toggle)
    }
    assert len(toggles) > 5
    for name, arguments in operators():
        kind = getattr(bpy.ops.facestage, name).get_rna_type()
        assert (name in toggles) == (arguments.get("state") == "'TOGGLE'"), name
        # Whoever adds one that says so in words makes it a Toggle.
        flips = re.search(r"again: (none|back)|[Oo]nce more to|, or off", kind.description)
        assert name in toggles or not flips, name


def test_a_toggle_asked_for_what_is_there_changes_nothing(scene) -> None:
    from types import SimpleNamespace
    from typing import Any

    from facestage_blender.ui.action import Toggle

    class Lamp(Toggle):
        on, turned = False, 0

        def is_on(self, _context: Any) -> bool:
            return self.on

        def turn(self, _context: Any, on: bool) -> None:
            self.on, self.turned = on, self.turned + 1

    lamp: Any = Lamp()
    for state, on, turned in (
        ("OFF", False, 0),
        ("ON", True, 1),
        ("ON", True, 1),
        ("TOGGLE", False, 2),
        ("TOGGLE", True, 3),
        ("OFF", False, 4),
    ):
        lamp.state = state
        lamp.act(SimpleNamespace())
        assert (lamp.on, lamp.turned) == (on, turned)


def test_skin_and_lashes_are_turned_on_and_off_by_argument(scene, default_head) -> None:
    import bpy

    from facestage_blender.rig.face_rig import build_rig
    from facestage_blender.scene.stage import new_stage
    from facestage_blender.skin.lashes import lashes_of
    from facestage_blender.skin.pores import pores_of

    rig = build_rig(scene, default_head, "default", new_stage(scene))
    for turn, there in ((bpy.ops.facestage.lashes, lashes_of), (bpy.ops.facestage.pores, pores_of)):
        for state in ("OFF", "ON", "ON", "OFF"):
            assert turn(state=state) == {"FINISHED"}
            assert (there(rig) is not None) == (state == "ON")


def test_a_light_is_shown_alone_by_its_number(scene) -> None:
    import bpy

    from addon.ui.refusal import refused
    from facestage_blender.scene.stage import build_stage, default_stage, stage_lights

    empty = build_stage(scene, default_stage(5, 1.0, 0.2))
    for number in (4, 2, 2):
        assert bpy.ops.facestage.next_light(number=number) == {"FINISHED"}
        shining = [light.data.energy > 0 for light in stage_lights(empty)]
        assert shining == [place == number for place in range(1, 6)]
    refused(bpy.ops.facestage.next_light, "no light 6", number=6)

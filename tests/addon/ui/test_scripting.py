"""Every operator can be called from Python with plain arguments, and docs/scripting.md says with
which.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

# What only a file dialog looks at.
OF_DIALOGS = {"rna_type", "filter_glob", "filter_folder", "check_existing"}
# These would change what Blender's user has installed.
OF_THIS_MACHINE = {"install_backend", "remove_backend"}


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

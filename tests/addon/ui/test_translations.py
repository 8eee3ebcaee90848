"""Every label, tooltip and plain sentence of the add-on is known to each of its languages."""

from __future__ import annotations

import ast
import string
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

# Of Blender itself, or of file dialogs.
NOT_SHOWN = {"filter_glob", "filter_folder", "check_existing", "rna_type", "bl_idname"}
UNIQUE = "Unique name used in the code and scripting"
BLENDERS_OWN = {
    UNIQUE,
    f"{UNIQUE}, can be re-defined in Python sub-classes if needed",  # Blender 5.2
    "filepath",
    "bl_idname",
}
# What takes words for people, beside a drawing function's text, and in which of its places.
SPEAKING = {
    **dict.fromkeys(("InputError", "said", "poll_message_set"), 0),
    **dict.fromkeys(("report", "draw_wrapped", "_fail"), 1),
}
DRAWN = {"text", "heading"}
OTHER_ROOMS = {"headless", "synthetic", "translations"}  # without a panel


@pytest.fixture
def words(scene, repository: Path) -> set[str]:
    """All that the add-on says in fixed words, from its classes and its code."""
    import bpy

    from facestage_blender import registration

    found: set[str] = set()
    for module in registration.MODULES:
        for kind in module.CLASSES:
            found |= set(of_class(kind))
    found |= set(of_property(bpy.types.Material.bl_rna.properties["facestage_part"]))
    for path in (repository / "addon" / "facestage_blender").rglob("*.py"):
        if not OTHER_ROOMS & set(path.parts):
            found |= set(of_code(ast.parse(path.read_text(encoding="utf-8"))))
    return {each for each in found if any(map(str.isalpha, each))} - BLENDERS_OWN


def of_class(kind: Any) -> Iterator[str]:
    """Labels and tooltips that Blender has of a class."""
    import bpy

    rna = kind.bl_rna
    if issubclass(kind, bpy.types.Operator):
        _, _, name = kind.bl_idname.partition(".")
        rna = getattr(bpy.ops.facestage, name).get_rna_type()
        yield from (kind.bl_label, rna.description)
    elif issubclass(kind, bpy.types.Panel | bpy.types.Menu):
        yield from (getattr(kind, "bl_label", ""), getattr(kind, "bl_description", ""))
        return
    for each in rna.properties:
        if each.identifier in NOT_SHOWN or each.is_hidden:
            continue
        yield from of_property(each)


def of_property(each: Any) -> Iterator[str]:
    yield from (each.name, each.description)
    for item in each.enum_items if each.type == "ENUM" else ():
        yield from (item.name, item.description)


def of_code(tree: ast.AST) -> Iterator[str]:
    """What is drawn or said in fixed words."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        name = getattr(node.func, "id", getattr(node.func, "attr", ""))
        given = [each.value for each in node.keywords if each.arg in DRAWN]
        given += node.args[SPEAKING[name] :][:1] if name in SPEAKING else []
        for value in given:
            for part in alternatives(value):
                if isinstance(part, ast.Constant) and isinstance(part.value, str):
                    yield part.value


def alternatives(value: ast.expr) -> list[ast.expr]:
    if isinstance(value, ast.IfExp):
        return [value.body, value.orelse]
    return value.values if isinstance(value, ast.BoolOp) else [value]


def languages() -> list[str]:
    from facestage_blender.translations import LANGUAGES

    return list(LANGUAGES)


def test_german_is_there(scene) -> None:
    assert "de" in languages()


def test_every_word_has_an_entry(words: set[str]) -> None:
    """A new label wants its line in each module of addon/facestage_blender/translations."""
    from facestage_blender.translations import LANGUAGES

    assert len(words) > 400
    for language, entries in LANGUAGES.items():
        missing = sorted(words - entries.keys())
        assert not missing, "\n".join([language, *missing])


def test_no_entry_is_left_of_words_that_are_gone(words: set[str], repository: Path) -> None:
    from facestage_blender.translations import LANGUAGES

    code = "".join(
        path.read_text(encoding="utf-8")
        for path in (repository / "addon" / "facestage_blender").rglob("*.py")
        if "translations" not in path.parts
    )
    for language, entries in LANGUAGES.items():
        left = [each for each in entries.keys() - words if f'"{each}"' not in code]
        assert not left, "\n".join([language, *sorted(left)])


def test_entries_take_the_same_values_and_say_something(scene) -> None:
    from facestage_blender.translations import LANGUAGES

    for entries in LANGUAGES.values():
        for source, said in entries.items():
            assert said.strip() == said != ""
            assert places(said) == places(source), source
            assert source.endswith("...") == said.endswith("..."), source
            assert (source[-1] == ".") == (said[-1] == "."), source


def places(words: str) -> set[str]:
    return {name for _, name, _, _ in string.Formatter().parse(words) if name}


def test_what_is_said_takes_its_values(scene) -> None:
    from facestage_blender.translations import said

    assert said("{count} points to drag (G)", count=7) == "7 points to drag (G)"
    assert said("A sentence {with} braces") == "A sentence {with} braces"
    assert said("") == ""


def test_options_of_the_command_line_are_called_as_in_the_panel(
    words: set[str], repository: Path
) -> None:
    from facestage_blender.translations import LABELS, OPTION, said

    assert said("a guess (--skin-tone corrects it)") == "a guess (Skin Tone corrects it)"
    assert said("give it by --landmarks FILE.json, or not.") == "give it by Landmarks, or not."
    assert said("{what} is here", what="--resume") == "Resume is here"
    assert said("leave out --same-person -- so") == "leave out --same-person -- so"
    assert set(LABELS.values()) <= words
    # What a fit says to its user.
    advice = repository / "backend" / "facestage" / "fit" / "trust" / "advice.py"
    options = set(OPTION.findall(advice.read_text(encoding="utf-8")))
    assert "--skin-tone" in options and options <= LABELS.keys()

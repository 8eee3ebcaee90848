"""What a person reads in Blender: titles in its style, and a tooltip for everything."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pytest

# In the middle of a title Blender writes these small.
SMALL = {
    *("a", "an", "the", "and", "or", "of", "to", "from", "in", "into", "on", "as", "by", "for"),
    *("with", "at", "mm", "dB"),
}
NOT_OURS = {"rna_type", "name", "bl_idname", "filepath", "directory", "files", "check_existing"}


def described(kind: Any) -> Iterator[tuple[str, str, str]]:
    """Where, title and tooltip of an operator, or of the properties of a class."""
    import bpy

    rna = kind.bl_rna
    if issubclass(kind, bpy.types.Operator):
        rna = getattr(bpy.ops.facestage, kind.bl_idname.partition(".")[2]).get_rna_type()
        yield kind.bl_idname, kind.bl_label, rna.description
    where = rna.identifier
    for each in rna.properties:
        if each.identifier in NOT_OURS or each.is_hidden or each.identifier.startswith("filter_"):
            continue
        yield f"{where}.{each.identifier}", each.name, each.description
        for item in each.enum_items if each.type == "ENUM" else ():
            yield f"{where}.{each.identifier}.{item.identifier}", item.name, item.description


@pytest.fixture
def words(scene) -> list[tuple[str, str, str]]:
    """All of them."""
    import bpy

    from facestage_blender import registration

    found = [
        row
        for module in registration.MODULES
        for kind in module.CLASSES
        if issubclass(kind, bpy.types.Operator | bpy.types.PropertyGroup)
        for row in described(kind)
    ]
    part = bpy.types.Material.bl_rna.properties["facestage_part"]
    found.append(("facestage_part", part.name, part.description))
    found += [(item.identifier, item.name, item.description) for item in part.enum_items]
    return found


def test_everything_has_a_tooltip_that_is_a_sentence(words) -> None:
    assert len(words) > 250
    bad = [
        f"{where}: '{tooltip}'"
        for where, _, tooltip in words
        if not re.match(r"[A-Z0-9(]", tooltip) or tooltip.endswith(".") or "\n" in tooltip
    ]
    assert not bad, "\n".join(bad)


def test_titles_are_in_title_case(words) -> None:
    import bpy

    from facestage_blender import registration

    titles = [(where, title) for where, title, _ in words]
    titles += [
        (kind.__name__, kind.bl_label)
        for module in registration.MODULES
        for kind in module.CLASSES
        if issubclass(kind, bpy.types.Panel | bpy.types.Menu)
    ]
    bad = [f"{where}: '{title}'" for where, title in titles if not is_title(title)]
    assert not bad, "\n".join(bad)


def is_title(words: str) -> bool:
    parts = re.findall(r"[^\s/,]+", words)
    return bool(parts) and all(
        not part.islower() or (place > 0 and part in SMALL) for place, part in enumerate(parts)
    )


def test_titles_are_told_from_other_words() -> None:
    assert (
        is_title("Hide What Is in the Way")
        and is_title("2048, as Usual")
        and is_title("glTF Binary")
    )
    assert not is_title("Keep camera") and not is_title("") and not is_title("as Fitted")

"""What the panel says in other languages. Blender itself puts an entry in the place of each label
and tooltip that has one, as far as the user's preferences want that.

May import bpy and the contract, and nothing of the add-on. A new language is a module like :mod:`.german` and
its line in LANGUAGES; what it lacks is shown in English.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import bpy

from .german import GERMAN

NAME = "facestage_blender"
# Of buttons, Blender asks in their own; in Facestage's for words that mean something else to it.
FACESTAGE = "Facestage"
CONTEXTS = ("*", "Operator", FACESTAGE)
LANGUAGES: Mapping[str, Mapping[str, str]] = {"de": GERMAN}
# The panel's names of what the backend's sentences call by its options.
OPTION = re.compile(r"(--[a-z][a-z-]*)(?: [A-Z]+\.json)?")
LABELS: Mapping[str, str] = {
    "--skin-tone": "Skin Tone",
    "--white-balance": "Pick White Balance",
    "--budget": "Budget",
    "--resume": "Resume",
    "--landmarks": "Landmarks",
    "--camera": "Camera",
    "--face": "Face",
    "--model": "Face Model",
    "--out": "Output",
}


def register() -> None:
    """Give Blender the languages."""
    bpy.app.translations.register(
        NAME,
        {
            language: {
                (context, source): words
                for source, words in entries.items()
                for context in CONTEXTS
            }
            for language, entries in LANGUAGES.items()
        },
    )


def unregister() -> None:
    """Undo :func:`register`."""
    bpy.app.translations.unregister(NAME)


def said(source: str, **values: object) -> str:
    """A sentence of the panel in the user's language; ``values`` take the places of their names in
    braces. What the backend says of its options, it says of the panel's buttons and fields.
    """
    words: str = bpy.app.translations.pgettext_iface(source)
    return OPTION.sub(_label, words.format(**values) if values else words)


def _label(option: re.Match[str]) -> str:
    """As it is called in the panel; as it stands where that has none."""
    name = LABELS.get(option[1])
    return option[0] if name is None else str(bpy.app.translations.pgettext_iface(name))

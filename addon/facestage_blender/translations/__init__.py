"""What the panel says in other languages. Blender itself puts an entry in the place of each label
and tooltip that has one, as far as the user's preferences want that.

May import bpy and the contract, and nothing of the add-on. A new language is a module like :mod:`.german` and
its line in LANGUAGES; what it lacks is shown in English.
"""

from __future__ import annotations

from collections.abc import Mapping

import bpy

from .german import GERMAN

NAME = "facestage_blender"
# Of buttons, Blender asks in their own; in Facestage's for words that mean something else to it.
FACESTAGE = "Facestage"
CONTEXTS = ("*", "Operator", FACESTAGE)
LANGUAGES: Mapping[str, Mapping[str, str]] = {"de": GERMAN}


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
    braces.
    """
    words: str = bpy.app.translations.pgettext_iface(source)
    return words.format(**values) if values else words

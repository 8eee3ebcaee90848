"""What was found in somebody's file, as words that fit one line whatever it was."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

SHOWN_MAX = 60  # characters of a value that a sentence repeats
SENTENCE_MAX = 900  # characters of a sentence
_HEAD = 600  # of them from its beginning, the rest from its end


def shown(value: object) -> str:
    """A value from a file for an error message: short, without control characters."""
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return quoted(value)
    if isinstance(value, int):
        # Python refuses to write integers of more than 4300 digits.
        return str(value) if value.bit_length() <= 128 else f"a number of {value.bit_length()} bits"
    if isinstance(value, Mapping):
        return f"an object of {len(value)} keys"
    if hasattr(value, "shape") and hasattr(value, "dtype"):
        return f"an array of shape {value.shape} of {value.dtype}"
    if isinstance(value, list | tuple):
        return f"a list of {len(value)}"
    return escaped(repr(value)[:SHOWN_MAX])


def quoted(text: str) -> str:
    """Text in quotes, its end left out where it is long."""
    if len(text) <= SHOWN_MAX:
        return f"'{escaped(text)}'"
    return f"'{escaped(text[:SHOWN_MAX])}...' ({len(text)} characters)"


def escaped(text: str) -> str:
    """The text with line breaks, control characters and lone surrogates as escapes."""
    if text.isprintable():
        return text
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text
    )


def one_line(sentence: str) -> str:
    """A sentence as one line of bounded length: the middle of a longer one is left out."""
    sentence = " ".join(sentence.split("\n")) if "\n" in sentence else sentence
    if len(sentence) > SENTENCE_MAX:
        sentence = f"{sentence[:_HEAD]} ... {sentence[_HEAD - SENTENCE_MAX :]}"
    return escaped(sentence)


def whole_bytes(count: Any) -> str:
    """A number of bytes in the unit that one would use."""
    value, unit = float(count), "bytes"
    for larger in ("KiB", "MiB", "GiB", "TiB"):
        if value < 1024:
            break
        value, unit = value / 1024, larger
    return f"{value:.4g} {unit}"

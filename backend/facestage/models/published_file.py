"""The file of a published face model: found, and checked to be a file of a plausible size and no web page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from facestage.contract.errors import InputError
from facestage.contract.reading import MIB, open_regular

# The largest published ones: Basel 2019 0.4 GB, FLAME 0.06 GB (as text four times as much), GNM 0.2 GB.
MODEL_LIMIT, PICKLE_LIMIT = 1024 * MIB, 256 * MIB
_START = 200
_WEB_PAGE = (b"<!doctype", b"<html", b"<?xml")
_POINTER = b"version https://git-lfs"


def find_published(path: Path, names: Sequence[str], what: str, expected: str) -> Path:
    """The model's file: ``path``, or the first of ``names`` in the folder ``path``.

    ``what`` names the model in messages, ``expected`` is the clause that says what was expected and from where. Raises
    InputError for anything but a regular file of at most MODEL_LIMIT bytes that starts as no web page does.
    """
    try:
        path = _in_folder(path, names, what, expected) if path.is_dir() else path
        exists = path.exists()
    # A name that is too long, or a folder that may not be entered.
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"The {what} '{path}' cannot be read: {reason}; {expected}") from error
    if not exists:
        raise InputError(f"The {what} '{path}' does not exist; {expected}")
    with open_regular(path, what, MODEL_LIMIT) as stream:
        start = stream.read(_START).lstrip().lower()
    if start.startswith(_WEB_PAGE):
        raise InputError(f"'{path}' is a web page, not the {what}; log in there and download it again; {expected}")
    if start.startswith(_POINTER):
        raise InputError(f"'{path}' is a Git LFS pointer, not the {what} itself; {expected}")
    return path


def _in_folder(folder: Path, names: Sequence[str], what: str, expected: str) -> Path:
    found = next((folder / name for name in names if (folder / name).exists()), None)
    if found is None:
        raise InputError(f"The folder '{folder}' holds no {what}; {expected}")
    return found

"""The file of a published face model: found, and checked to be a file of a plausible size and no
web page.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.files.reading import MIB, open_regular

# The largest published ones: Basel 2019 0.4 GB, FLAME 0.06 GB (as text four times as much), GNM 0.2
# GB.
MODEL_LIMIT, PICKLE_LIMIT = 1024 * MIB, 256 * MIB
_START = 200
# Metres; and what no array of a model exceeds in any unit: their squares are numbers too.
_FACE_HEIGHTS, _EXTENT, NUMBER_LIMIT = (0.05, 1.0), 10.0, 1e10
_WEB_PAGE = (b"<!doctype", b"<html", b"<?xml")
_POINTER = b"version https://git-lfs"


def find_published(path: Path, names: Sequence[str], what: str, expected: str) -> Path:
    """The model's file: ``path``, or the first of ``names`` in the folder ``path``.

    ``what`` names the model in messages, ``expected`` is the clause that says what was expected and
    from where. Raises InputError for anything but a regular file of at most MODEL_LIMIT bytes that
    starts as no web page does.
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
        raise InputError(
            f"'{path}' is a web page, not the {what}; log in there and download it again; "
            f"{expected}"
        )
    if start.startswith(_POINTER):
        raise InputError(f"'{path}' is a Git LFS pointer, not the {what} itself; {expected}")
    return path


def _in_folder(folder: Path, names: Sequence[str], what: str, expected: str) -> Path:
    found = next((folder / name for name in names if (folder / name).exists()), None)
    if found is None:
        raise InputError(f"The folder '{folder}' holds no {what}; {expected}")
    return found


def check_numbers(path: Path, name: str, array: np.ndarray, expected: str) -> None:
    """Raise InputError when the array ``name`` of the file holds anything but plausible numbers."""
    if not np.isfinite(array).all():
        raise InputError(f"'{path}' is damaged: {name} holds NaN or infinity; {expected}")
    if array.size and max(abs(float(array.min())), abs(float(array.max()))) > NUMBER_LIMIT:
        raise InputError(
            f"'{path}' is damaged: {name} holds numbers beyond {NUMBER_LIMIT:g}; {expected}"
        )


def check_head(path: Path, vertices: np.ndarray, what: str, expected: str) -> None:
    """Raise InputError when ``vertices`` (n, 3), metres, +Y up, are not of a head's size."""
    extents = np.ptp(vertices, axis=0)
    if not _FACE_HEIGHTS[0] < extents[1] < _FACE_HEIGHTS[1] or extents.max() > _EXTENT:
        raise InputError(
            f"'{path}' is no {what} as published, its face is {extents[1] * 1e3:.3g} mm high; "
            f"{expected}"
        )

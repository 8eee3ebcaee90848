"""The size of an OpenEXR picture from its header, before any library makes room for its pixels."""

from __future__ import annotations

import struct
from pathlib import Path

from facestage.contract.errors import InputError
from facestage.contract.reading import KIB, open_regular

MAGIC = b"\x76\x2f\x31\x01"
HEADER_MAX = 64 * KIB
_DEEP, _PARTS = 0x800, 0x1000
_BOX = struct.Struct("<4i")


def exr_size(path: Path, what: str, limit: int, side_max: int) -> tuple[int, int]:
    """Width and height of a picture of one part in a regular file of at most ``limit`` bytes.

    Raises InputError for another file, or for a picture with a side of more than ``side_max`` pixels.
    """
    with open_regular(path, what, limit) as stream:
        header = stream.read(HEADER_MAX)
    try:
        boxes = [_BOX.unpack(_attributes(header)[name]) for name in ("dataWindow", "displayWindow")]
    except (ValueError, KeyError, struct.error) as error:
        raise InputError(f"The {what} '{path}' is not a readable OpenEXR picture.") from error
    for left, top, right, bottom in boxes:
        width, height = right - left + 1, bottom - top + 1
        if not (1 <= width <= side_max and 1 <= height <= side_max):
            raise InputError(
                f"The {what} '{path}' says that it has {width} x {height} pixels, expected 1 to {side_max} each."
            )
    left, top, right, bottom = boxes[0]
    return right - left + 1, bottom - top + 1


def _attributes(header: bytes) -> dict[str, bytes]:
    """Name -> value of a header's attributes. Raises ValueError for what is no header of a flat picture."""
    if header[:4] != MAGIC or len(header) < 8:
        raise ValueError("no OpenEXR")
    if int.from_bytes(header[4:8], "little") & (_DEEP | _PARTS):
        raise ValueError("deep, or of several parts")
    found, place = {}, 8
    while header[place : place + 1] != b"\0":
        name_end = header.index(b"\0", place)
        type_end = header.index(b"\0", name_end + 1)
        size = int.from_bytes(header[type_end + 1 : type_end + 5], "little")
        start = type_end + 5
        if start + size > len(header):
            raise ValueError("cut off")
        found[header[place:name_end].decode("latin-1")] = header[start : start + size]
        place = start + size
    return found

"""The size of an OpenEXR picture from its header, before any library makes room for its pixels."""

from __future__ import annotations

import os
import struct
from pathlib import Path
from typing import BinaryIO

from facestage.contract.errors import InputError
from facestage.contract.reading import KIB, open_regular

MAGIC = b"\x76\x2f\x31\x01"
HEADER_MAX = 64 * KIB
_LINES = (1, 1, 1, 16, 32, 16, 32, 32, 32, 256)  # in a block, by the number of the compression
_DEEP, _PARTS = 0x800, 0x1000


def exr_size(path: Path, what: str, limit: int, side_max: int) -> tuple[int, int]:
    """Width and height of a picture of one part in a regular file of at most ``limit`` bytes.

    Raises InputError for another file, or for a picture with a side of more than ``side_max`` pixels.
    """
    with open_regular(path, what, limit) as stream:
        try:
            attributes, end = _attributes(stream.read(HEADER_MAX))
            sizes = [_size(attributes[name]) for name in ("dataWindow", "displayWindow")]
            for width, height in sizes:
                if not (1 <= width <= side_max and 1 <= height <= side_max):
                    raise InputError(
                        f"The {what} '{path}' says that it has {width} x {height} pixels, expected 1 to {side_max}."
                    )
            whole = "tiles" in attributes or _whole(stream, end, sizes[0][1], attributes["compression"])
        except (ValueError, KeyError, IndexError, struct.error, OSError) as error:
            raise InputError(f"The {what} '{path}' is not a readable OpenEXR picture.") from error
    if not whole:
        raise InputError(f"The {what} '{path}' is cut off; write it again.")
    return sizes[0]


def _size(box: bytes) -> tuple[int, int]:
    left, top, right, bottom = struct.unpack("<4i", box)
    return right - left + 1, bottom - top + 1


def _whole(stream: BinaryIO, table: int, lines: int, compression: bytes) -> bool:
    """Whether all blocks of ``lines`` are in the file; their places stand in a ``table`` after the header."""
    size = stream.seek(0, os.SEEK_END)
    count = -(-lines // _LINES[compression[0]])
    stream.seek(table)
    for place in struct.unpack(f"<{count}Q", stream.read(8 * count)):
        if not table < place < size - 8:
            return False
        stream.seek(place + 4)
        if place + 8 + int.from_bytes(stream.read(4), "little") > size:
            return False
    return True


def _attributes(header: bytes) -> tuple[dict[str, bytes], int]:
    """Name -> value of a header's attributes, and where it ends. Raises ValueError unless it is of a flat picture."""
    if header[:4] != MAGIC or len(header) < 8:
        raise ValueError("no OpenEXR")
    if int.from_bytes(header[4:8], "little") & (_DEEP | _PARTS):
        raise ValueError("deep, or of several parts")
    found: dict[str, bytes] = {}
    place = 8
    while header[place : place + 1] != b"\0":
        name_end = header.index(b"\0", place)
        type_end = header.index(b"\0", name_end + 1)
        size = int.from_bytes(header[type_end + 1 : type_end + 5], "little")
        start = type_end + 5
        if start + size > len(header):
            raise ValueError("cut off")
        found[header[place:name_end].decode("latin-1")] = header[start : start + size]
        place = start + size
    return found, place + 1

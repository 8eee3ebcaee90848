"""The header of an OpenEXR file (openexr.com, "OpenEXR File Layout"), read before a decoder
believes it.
"""

from __future__ import annotations

import os
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.errors import InputError
from facestage.contract.files.reading import open_regular

MAGIC = b"\x76\x2f\x31\x01"
HEADER_LIMIT = 1 << 16  # bytes; a picture with fifty channels has 2000
CHANNEL_LIMIT = 64
TILED, LONG_NAMES, DEEP, MULTIPART = 0x200, 0x400, 0x800, 0x1000
# By their numbers in the file.
COMPRESSIONS = ("none", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB")
_LINES = (1, 1, 1, 16, 32, 16, 32, 32, 32, 256)  # in a block, by the number of the compression


@dataclass(frozen=True)
class ExrHeader:
    """What is needed of it."""

    width: int
    height: int
    compression: str
    channels: tuple[str, ...]
    tiled: bool
    chromaticities: Float[np.ndarray, " 8"] | None  # CIE xy of red, green, blue and white
    display: tuple[int, int]  # width and height of the window that is shown
    lines: int  # in a block
    end: int  # bytes


def read_header(content: bytes) -> ExrHeader:
    """The header at the start of ``content``.

    Raises ValueError, in a clause, for what is no flat EXR picture.
    """
    if content[:4] != MAGIC:
        raise ValueError("it is no OpenEXR file")
    attributes, flags, end = _attributes(content[:HEADER_LIMIT])
    if flags & (DEEP | MULTIPART):
        raise ValueError("it has several parts or deep pixels; save it as one flat picture")
    width, height = _size(attributes, "dataWindow")
    code = _value(attributes, "compression", "compression", 1)[0]
    if code >= len(COMPRESSIONS):
        raise ValueError(f"its compression {code} is unknown")
    given = attributes.get("chromaticities")
    chromaticities = None
    if given is not None and given[0] == "chromaticities" and len(given[1]) == 32:
        chromaticities = np.array(struct.unpack("<8f", given[1]), np.float64)
    channels = _channels(_value(attributes, "channels", "chlist", None))
    display = _size(attributes, "displayWindow")
    return ExrHeader(
        width,
        height,
        COMPRESSIONS[code],
        channels,
        bool(flags & TILED),
        chromaticities,
        display,
        _LINES[code],
        end,
    )


def exr_size(path: Path, what: str, limit: int, side_max: int) -> tuple[int, int]:
    """Width and height of a whole picture of one part in a regular file of at most ``limit`` bytes.

    Raises InputError for another file, or for a picture with a side of more than ``side_max``
    pixels.
    """
    with open_regular(path, what, limit) as stream:
        try:
            header = read_header(stream.read(HEADER_LIMIT))
            for width, height in ((header.width, header.height), header.display):
                if not (1 <= width <= side_max and 1 <= height <= side_max):
                    raise InputError(
                        f"The {what} '{path}' says that it has {width} x {height} pixels, "
                        f"expected 1 to {side_max}."
                    )
            whole = header.tiled or _whole(stream, header)
        except (ValueError, struct.error, OSError) as error:
            raise InputError(f"The {what} '{path}' is not a readable OpenEXR picture.") from error
    if not whole:
        raise InputError(f"The {what} '{path}' is cut off; write it again.")
    return header.width, header.height


def _whole(stream: BinaryIO, header: ExrHeader) -> bool:
    """Whether all blocks of lines are in the file; their places stand in a table after the
    header.
    """
    size = stream.seek(0, os.SEEK_END)
    count = -(-header.height // header.lines)
    stream.seek(header.end)
    for place in struct.unpack(f"<{count}Q", stream.read(8 * count)):
        if not header.end < place < size - 8:
            return False
        stream.seek(place + 4)
        if place + 8 + int.from_bytes(stream.read(4), "little") > size:
            return False
    return True


def _size(attributes: dict[str, tuple[str, bytes]], name: str) -> tuple[int, int]:
    left, top, right, bottom = struct.unpack("<4i", _value(attributes, name, "box2i", 16))
    return right - left + 1, bottom - top + 1


def _attributes(content: bytes) -> tuple[dict[str, tuple[str, bytes]], int, int]:
    """Type and value of each attribute, the version's flags, and where the header ends."""
    (version,) = struct.unpack_from("<I", content.ljust(8, b"\0"), 4)
    position = 8
    attributes: dict[str, tuple[str, bytes]] = {}
    while position < len(content) and content[position]:
        name, position = _text(content, position)
        kind, position = _text(content, position)
        (size,) = struct.unpack_from("<i", content.ljust(position + 4, b"\0"), position)
        position += 4
        if not 0 <= size <= len(content) - position:
            break
        attributes[name] = kind, content[position : position + size]
        position += size
    else:
        if position < len(content):
            return attributes, version & ~0xFF, position + 1
    raise ValueError(f"its header is cut, damaged or longer than {HEADER_LIMIT // 1024} KiB")


def _text(content: bytes, position: int) -> tuple[str, int]:
    end = content.find(b"\0", position)
    if end < 0:
        raise ValueError("its header is cut")
    return content[position:end].decode("latin-1"), end + 1


def _value(
    attributes: dict[str, tuple[str, bytes]], name: str, kind: str, size: int | None
) -> bytes:
    found, value = attributes.get(name, ("", b""))
    if found != kind or size not in (None, len(value)):
        raise ValueError(f"its header lacks {name}")
    return value


def _channels(value: bytes) -> tuple[str, ...]:
    names = []
    position = 0
    while position < len(value) and value[position]:
        name, position = _text(value, position)
        names.append(name)
        position += 16  # type, linearity, sampling
        if len(names) > CHANNEL_LIMIT:
            raise ValueError(f"it has more than {CHANNEL_LIMIT} channels")
    return tuple(names)

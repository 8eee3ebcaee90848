"""The header of an OpenEXR file (openexr.com, "OpenEXR File Layout"), read before a decoder believes it."""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

MAGIC = b"\x76\x2f\x31\x01"
HEADER_LIMIT = 1 << 16  # bytes; a picture with fifty channels has 2000
CHANNEL_LIMIT = 64
TILED, LONG_NAMES, DEEP, MULTIPART = 0x200, 0x400, 0x800, 0x1000
# By their numbers in the file.
COMPRESSIONS = ("none", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB")


@dataclass(frozen=True)
class ExrHeader:
    """What is needed of it."""

    width: int
    height: int
    compression: str
    channels: tuple[str, ...]
    tiled: bool
    chromaticities: np.ndarray | None  # (8,) CIE xy of red, green, blue and white


def read_header(content: bytes) -> ExrHeader:
    """The header at the start of ``content``. Raises ValueError, in a clause, for what is no flat EXR picture."""
    if content[:4] != MAGIC:
        raise ValueError("it is no OpenEXR file")
    attributes, flags = _attributes(content[:HEADER_LIMIT])
    if flags & (DEEP | MULTIPART):
        raise ValueError("it has several parts or deep pixels; save it as one flat picture")
    window = _value(attributes, "dataWindow", "box2i", 16)
    left, top, right, bottom = struct.unpack("<4i", window)
    code = _value(attributes, "compression", "compression", 1)[0]
    if code >= len(COMPRESSIONS):
        raise ValueError(f"its compression {code} is unknown")
    given = attributes.get("chromaticities")
    chromaticities = None
    if given is not None and given[0] == "chromaticities" and len(given[1]) == 32:
        chromaticities = np.array(struct.unpack("<8f", given[1]), np.float64)
    return ExrHeader(
        right - left + 1, bottom - top + 1, COMPRESSIONS[code],
        _channels(_value(attributes, "channels", "chlist", None)), bool(flags & TILED), chromaticities,
    )  # fmt: skip


def _attributes(content: bytes) -> tuple[dict[str, tuple[str, bytes]], int]:
    """Type and value of each attribute, and the version's flags."""
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
            return attributes, version & ~0xFF
    raise ValueError(f"its header is cut, damaged or longer than {HEADER_LIMIT // 1024} KiB")


def _text(content: bytes, position: int) -> tuple[str, int]:
    end = content.find(b"\0", position)
    if end < 0:
        raise ValueError("its header is cut")
    return content[position:end].decode("latin-1"), end + 1


def _value(attributes: dict[str, tuple[str, bytes]], name: str, kind: str, size: int | None) -> bytes:
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

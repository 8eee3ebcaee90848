"""Damage to photographs between their chunks and segments, checksums put right, so that it gets
past the first look.
"""

from __future__ import annotations

import struct
import zlib

from fuzz.choice import Choose
from fuzz.damage.bytes import BOUNDARY, mangle_bytes

PNG = b"\x89PNG\r\n\x1a\n"


def mangle_image(choose: Choose, data: bytes) -> bytes:
    if choose.chance(3):
        return mangle_bytes(choose, data)
    if data.startswith(PNG):
        return _png(choose, data)
    if data.startswith(b"\xff\xd8"):
        return _jpeg(choose, data)
    # Headers hold what sizes and offsets there are.
    head = min(len(data), 400)
    return mangle_bytes(choose, data[:head]) + data[head:]


def mangle_profile(choose: Choose, data: bytes) -> bytes:
    """An ICC profile or TIFF directory: numbers of the header and of the table at the ends of their
    ranges.
    """
    if choose.chance(3) or len(data) < 132:
        return mangle_bytes(choose, data)
    start = choose.number(0, min(len(data), 400) // 4 - 1) * 4
    return (
        data[:start]
        + struct.pack(choose.one_of((">I", "<I")), choose.one_of(BOUNDARY) & 0xFFFFFFFF)
        + data[start + 4 :]
    )


def _png(choose: Choose, data: bytes) -> bytes:
    chunks, place = [], len(PNG)
    while place + 12 <= len(data):
        (length,) = struct.unpack(">I", data[place : place + 4])
        chunks.append((data[place + 4 : place + 8], data[place + 8 : place + 8 + length]))
        place += 12 + length
    if not chunks:
        return mangle_bytes(choose, data)
    number = choose.number(0, len(chunks) - 1)
    name, content = chunks[number]
    kind = choose.number(0, 7)
    if kind == 0:
        del chunks[number]
    elif kind == 1:
        chunks.insert(choose.number(0, len(chunks)), (name, content))
    elif kind == 2:
        chunks[number] = (
            choose.one_of((b"IDAT", b"PLTE", b"tRNS", b"iCCP", b"eXIf", b"gAMA", b"acTL", b"zTXt")),
            content,
        )
    elif kind == 3 and name in (b"iCCP", b"IDAT", b"zTXt"):
        chunks[number] = (name, _recompressed(choose, name, content))
    elif kind == 4:
        start = choose.number(0, max(len(content) - 4, 0))
        value = struct.pack(">I", choose.one_of(BOUNDARY) & 0xFFFFFFFF)
        chunks[number] = (name, content[:start] + value + content[start + 4 :])
    else:
        chunks[number] = (name, mangle_bytes(choose, content))
    return PNG + b"".join(png_chunk(*chunk) for chunk in chunks)


def png_chunk(name: bytes, content: bytes) -> bytes:
    return (
        struct.pack(">I", len(content))
        + name
        + content
        + struct.pack(">I", zlib.crc32(name + content))
    )


def _recompressed(choose: Choose, name: bytes, content: bytes) -> bytes:
    start = content.find(b"\0") + 2 if name != b"IDAT" else 0
    try:
        inner = zlib.decompress(content[start:])
    except zlib.error:
        return mangle_bytes(choose, content)
    damaged = mangle_profile(choose, inner) if name == b"iCCP" else mangle_bytes(choose, inner)
    return content[:start] + zlib.compress(damaged, 1)


def _jpeg(choose: Choose, data: bytes) -> bytes:
    """A segment before the picture's data dropped, repeated, or damaged behind a right length."""
    segments, place = [], 2
    while place + 4 <= len(data) and data[place] == 0xFF and data[place + 1] != 0xDA:
        (length,) = struct.unpack(">H", data[place + 2 : place + 4])
        segments.append((data[place + 1], data[place + 4 : place + 2 + length]))
        place += 2 + length
    rest = data[place:]
    if not segments or choose.chance(6):
        return data[:place] + mangle_bytes(choose, rest)
    number = choose.number(0, len(segments) - 1)
    marker, content = segments[number]
    kind = choose.number(0, 4)
    if kind == 0:
        del segments[number]
    elif kind == 1:
        segments.insert(choose.number(0, len(segments)), (marker, content))
    elif kind == 2:
        segments[number] = (
            choose.one_of((0xC0, 0xC2, 0xC4, 0xDB, 0xE1, 0xE2, 0xEE, 0xFE)),
            content,
        )
    else:
        segments[number] = (marker, mangle_bytes(choose, content)[:65000])
    packed = b"".join(
        b"\xff" + bytes([code]) + struct.pack(">H", len(body) + 2) + body for code, body in segments
    )
    return b"\xff\xd8" + packed + rest

"""Damage to files of numbers in text, and to MATLAB files."""

from __future__ import annotations

import re
import struct
import zlib

from fuzz.choice import Choose
from fuzz.damage.bytes import BOUNDARY, mangle_bytes

TOKENS = (
    b"nan",
    b"inf",
    b"-1",
    b"0",
    b"1e999",
    b"99999999999999999999",
    b"x",
    b"",
    b"1.5",
    b"-0",
    b"0x10",
    b"1/2",
    b"1//3",
    b"\xff",
    b"9" * 5000,
    b"1e-320",
    b"1_0",
    b"#",
)
_NUMBER = re.compile(rb"-?[0-9][0-9.e+-]*")
HEADER = 128
COMPRESSED = 15


def mangle_text(choose: Choose, data: bytes) -> bytes:
    """One number of the first or the last lines replaced, or plain damage."""
    if choose.chance(3):
        return mangle_bytes(choose, data)
    start = choose.one_of((0, max(len(data) - 2000, 0)))
    found = list(_NUMBER.finditer(data, start, start + 2000))
    if not found:
        return mangle_bytes(choose, data)
    match = choose.one_of(found)
    return data[: match.start()] + choose.one_of(TOKENS) + data[match.end() :]


def mangle_mat(choose: Choose, data: bytes) -> bytes:
    """A number of the element tree at the end of its range, behind the compression where there is
    one.
    """
    if choose.chance(4) or len(data) < HEADER + 16:
        return mangle_bytes(choose, data)
    starts, place = [], HEADER
    while place + 8 <= len(data):
        kind, size = struct.unpack("<II", data[place : place + 8])
        starts.append((place, kind, size))
        place += 8 + size
    place, kind, size = choose.one_of(starts)
    content = data[place + 8 : place + 8 + size]
    if kind != COMPRESSED:
        return (
            data[:place] + _word(choose, data[place : place + 8 + size]) + data[place + 8 + size :]
        )
    try:
        inner = zlib.decompress(content)
    except zlib.error:
        return mangle_bytes(choose, data)
    packed = zlib.compress(_word(choose, inner), 1)
    return (
        data[:place]
        + struct.pack("<II", COMPRESSED, len(packed))
        + packed
        + data[place + 8 + size :]
    )


def _word(choose: Choose, element: bytes) -> bytes:
    """One of the first words: types, sizes, flags and dimensions are there."""
    start = 4 * choose.number(0, max(min(len(element), 96) // 4 - 1, 0))
    value = (
        choose.one_of((*BOUNDARY, 5, 6, 7, 9, 12, 14, 15, 16, 17, 18, 96, 0x10, 0x0400, 0x0206))
        & 0xFFFFFFFF
    )
    return element[:start] + struct.pack("<I", value) + element[start + 4 :]

"""Damage to bytes of any format: flipped, cut, repeated, moved, and numbers at the ends of their
ranges.
"""

from __future__ import annotations

import struct

from fuzz.choice import Choose

BOUNDARY = (
    0,
    1,
    2,
    0x7F,
    0x80,
    0xFF,
    0x7FFF,
    0x8000,
    0xFFFF,
    2**31 - 1,
    2**31,
    2**32 - 1,
    2**63 - 1,
    2**64 - 1,
)
SIZES = {1: "B", 2: "H", 4: "I", 8: "Q"}
FOREIGN = (
    b"",
    b"\0",
    b"\n",
    b"{}",
    b"[]",
    b"null",
    b"<!doctype html><title>Log in</title>",
    b"PK\x05\x06" + bytes(18),
    b"\x89HDF\r\n\x1a\n",
    b"\x93NUMPY\x01\x00",
    b"\x80\x04.",
    b"\xfd7zXZ\x00",
    b"\x1f\x8b\x08\x00",
    b"\xff\xd8\xff\xe0",
    b"\x76\x2f\x31\x01",
    b"version https://git-lfs.github.com/spec/v1\n",
    b"\xef\xbb\xbf{}",
    b"\xff" * 64,
)


def mangle_bytes(choose: Choose, data: bytes) -> bytes:
    """``data`` with one piece of damage."""
    if not data or choose.chance(60):
        return choose.one_of(FOREIGN)
    return choose.one_of(
        (_flip, _flip, _number, _number, _delete, _repeat, _move, _cut, _append, _fill)
    )(choose, data)


def _span(choose: Choose, data: bytes) -> tuple[int, int]:
    start = choose.number(0, len(data) - 1)
    longest = min(len(data) - start, choose.one_of((4, 64, 1024, len(data))))
    return start, start + choose.number(1, max(longest, 1))


def _flip(choose: Choose, data: bytes) -> bytes:
    changed = bytearray(data)
    for _ in range(choose.number(1, 6)):
        changed[choose.number(0, len(changed) - 1)] ^= 1 << choose.number(0, 7)
    return bytes(changed)


def _number(choose: Choose, data: bytes) -> bytes:
    size = choose.one_of((1, 2, 4, 8))
    if len(data) < size:
        return b""
    start = choose.number(0, len(data) - size)
    value = choose.one_of(BOUNDARY) & (256**size - 1)
    return (
        data[:start] + struct.pack(choose.one_of("<>") + SIZES[size], value) + data[start + size :]
    )


def _delete(choose: Choose, data: bytes) -> bytes:
    start, end = _span(choose, data)
    return data[:start] + data[end:]


def _repeat(choose: Choose, data: bytes) -> bytes:
    start, end = _span(choose, data)
    return data[:end] + data[start:end] * choose.one_of((1, 1, 2, 30)) + data[end:]


def _move(choose: Choose, data: bytes) -> bytes:
    start, end = _span(choose, data)
    to = choose.number(0, len(data) - 1)
    return data[:to] + data[start:end] + data[to + end - start :]


def _cut(choose: Choose, data: bytes) -> bytes:
    return data[: choose.number(0, len(data) - 1)]


def _append(choose: Choose, data: bytes) -> bytes:
    return data + choose.raw(choose.number(1, 64))


def _fill(choose: Choose, data: bytes) -> bytes:
    start, end = _span(choose, data)
    return data[:start] + choose.one_of((b"\0", b"\xff", b"A")) * (end - start) + data[end:]

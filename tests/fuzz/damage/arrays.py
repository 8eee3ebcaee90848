"""Damage to .npy members: wrong shapes, types, orders and values behind a right header, and wrong
headers.
"""

from __future__ import annotations

import io
import re
import struct
import tokenize
from collections.abc import Callable

import numpy as np

from fuzz.choice import Choose
from fuzz.damage.bytes import mangle_bytes
from fuzz.damage.json import mangle_json

VALUES = (
    float("nan"),
    float("inf"),
    -float("inf"),
    1e300,
    -1e300,
    1e-300,
    -1.0,
    0.0,
    2.0**31,
    -(2.0**63),
    1e38,
    7e4,
)
TYPES = (
    "f8",
    "f4",
    "f2",
    "i8",
    "i4",
    "u1",
    "?",
    "c16",
    "U3",
    "S3",
    "M8[s]",
    "m8[s]",
    ">f8",
    "u8",
    "V4",
    "i4,f8",
)
SHAPES = (
    "()",
    "(0,)",
    "(1,)",
    "(-1,)",
    "(99999999999,)",
    "(4294967296, 4294967296)",
    "(0, 0, 0)",
    "(1, 1, 1, 1)",
    "(True,)",
    "(3.5,)",
    "('a',)",
    "3",
    "(1,) * 9",
    "(2147483648, 3)",
    "(0, 9223372036854775807)",
    "(" + "1, " * 40 + ")",
)
DESCRIPTIONS = (
    "'|O'",
    "'<f16'",
    "'<U999999999'",
    "'|V0'",
    "'|S0'",
    "'>f8'",
    "'<M8'",
    "'object'",
    "'<f8' * 3",
    "None",
    "5",
    "[]",
    "[('a', '<f8'), ('a', '<f8')]",
    "[('a', '<f8')]",
    "('<f8', (3,))",
    "('<f8', (99999, 99999))",
    "'\\x00'",
    "''",
    "'<f8,<f8'",
    "'<i4'",
    "'|b1'",
)


def npy_bytes(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array(stream, np.asanyarray(array), allow_pickle=True)
    return stream.getvalue()


def mangle_npy(choose: Choose, data: bytes) -> bytes:
    """An .npy file with another array, another header, or plain damage."""
    kind = choose.number(0, 9)
    if kind == 0:
        return mangle_bytes(choose, data)
    if kind <= 3:
        return _header(choose, data)
    try:
        array = np.load(io.BytesIO(data), allow_pickle=False)
    except (
        ValueError,
        TypeError,
        EOFError,
        OSError,
        MemoryError,
        SyntaxError,
        tokenize.TokenError,
    ):
        return mangle_bytes(choose, data)
    if array.dtype.kind == "U" and array.ndim == 0:
        try:
            text = str(array).encode()
        # Letters that Python has not; numpy finds them where it shows them.
        except (SystemError, ValueError):
            return mangle_bytes(choose, data)
        # A text of JSON.
        return npy_bytes(np.array(mangle_json(choose, text).decode("utf-8", "replace")))
    return npy_bytes(mangle_array(choose, array))


def mangle_array(choose: Choose, array: np.ndarray) -> np.ndarray:
    actions: tuple[Callable[[Choose, np.ndarray], np.ndarray], ...] = (
        _values,
        _values,
        _shape,
        _shape,
        _type,
        _order,
    )
    with np.errstate(all="ignore"):
        return choose.one_of(actions)(choose, array)


def _values(choose: Choose, array: np.ndarray) -> np.ndarray:
    changed = np.array(array)
    if not changed.size:
        return changed
    flat = changed.reshape(-1)
    many = choose.chance(4)
    where = slice(None) if many else choose.number(0, flat.size - 1)
    if changed.dtype.kind in "iu":
        limits = np.iinfo(changed.dtype)
        flat[where] = choose.one_of((limits.min, limits.max, 0, 1, limits.max - 1))
    elif changed.dtype.kind == "f":
        flat[where] = choose.one_of(VALUES)
    elif changed.dtype.kind == "b":
        flat[where] = choose.chance(2)
    elif changed.dtype.kind == "U":
        flat[where] = choose.one_of(("", "x", "\n", str(flat[-1])))
    return flat.reshape(changed.shape)


def _shape(choose: Choose, array: np.ndarray) -> np.ndarray:
    kind = choose.number(0, 8)
    if kind == 0:
        return array[..., None]
    if kind == 1:
        return array[None]
    if kind == 2:
        return array.reshape(-1)
    if kind == 3:
        return array[:0] if array.ndim else array
    if kind == 4:
        return array[:-1] if array.ndim else array
    if kind == 5:
        return np.concatenate([array, array[-1:]]) if array.ndim and len(array) else array
    if kind == 6:
        return array.T
    if kind == 7:
        return np.zeros((), array.dtype)
    return array[..., :-1] if array.ndim > 1 else np.zeros((0, 3), array.dtype)


def _type(choose: Choose, array: np.ndarray) -> np.ndarray:
    name = choose.one_of(TYPES)
    try:
        return array.astype(name)
    except (ValueError, TypeError, OverflowError):
        return np.zeros(array.shape, name)


def _order(choose: Choose, array: np.ndarray) -> np.ndarray:
    if array.ndim < 2 or choose.chance(3):
        return array[::-1] if array.ndim else array
    return np.asfortranarray(array)


def _header(choose: Choose, data: bytes) -> bytes:
    """The text of the header changed, its length put right or not."""
    if len(data) < 12 or not data.startswith(b"\x93NUMPY"):
        return mangle_bytes(choose, data)
    (length,) = struct.unpack("<H", data[8:10])
    text, rest = data[10 : 10 + length].decode("latin-1"), data[10 + length :]
    kind = choose.number(0, 5)
    if kind == 0:
        text = re.sub(r"\([^)]*\)", lambda _: choose.one_of(SHAPES), text, count=1)
    elif kind == 1:
        text = re.sub(r"'[<>|=][^']*'", lambda _: choose.one_of(DESCRIPTIONS), text, count=1)
    elif kind == 2:
        text = text.replace("False", choose.one_of(("True", "5", "None", "[]")))
    elif kind == 3:
        text = choose.one_of(
            (
                "{}",
                "",
                "{" * 500,
                "[" * 5000 + "]" * 5000,
                "9" * 5000,
                "__import__('os')",
                "{'descr'",
            )
        )
    elif kind == 4:
        text = text + " " * choose.one_of((1, 70, 20_000)) + "\n"
    else:
        return (
            data[:6]
            + bytes([choose.one_of((0, 1, 2, 3, 4, 255)), choose.one_of((0, 1, 255))])
            + data[8:]
        )
    header = text.encode("latin-1", "replace")
    size = len(header) if choose.number(0, 3) else choose.one_of((0, 1, 0xFFFF))
    return data[:8] + struct.pack("<H", min(size, 0xFFFF)) + header + rest

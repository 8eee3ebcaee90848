"""Named arrays in an .npz, read within limits that are checked against its directory before
anything is allocated.

An .npz is a zip of .npy files. numpy's own reader believes the sizes in it, unpacks by any method,
and reads objects when asked to; this one reads plain arrays of numbers and text, stored or
deflated, and nothing else.
"""

from __future__ import annotations

import ast
import math
import re
import zipfile
from collections.abc import Collection
from typing import IO, BinaryIO, cast

import numpy as np

from facestage.contract.files.reading import GIB, KIB, MIB
from facestage.contract.wording import quoted, shown, whole_bytes

ARRAYS_MAX = 1 * GIB  # of all arrays of a file together, unpacked
MEMBERS_MAX = 4096
HEADER_MAX = 4 * KIB  # of one array; numpy writes 118 bytes
DIMENSIONS_MAX = 8
CODE_MAX = 0x10FFFF  # of a character
# The directory is read at once: it is refused beyond this, and arrays are read in pieces of it.
_PIECE = 4 * MIB
# True or false, whole numbers, numbers, text.
_PLAIN = re.compile(r"[<>|=]?[biufU]\d{1,9}")
_LONG = re.compile(r"(?<=\d)L")  # as Python 2 wrote whole numbers
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)


def read_archive(
    stream: BinaryIO, limit: int, names: Collection[str] | None = None
) -> dict[str, np.ndarray]:
    """All arrays of an .npz, or those of the given ``names`` that it has; together at most
    ``limit`` bytes.

    Raises ValueError in a few words, or what :mod:`zipfile` and :mod:`zlib` raise, for anything
    else.
    """
    if stream.read(6) == b"\x93NUMPY":
        raise ValueError("a single array, expected an .npz of named arrays")
    stream.seek(0)
    with zipfile.ZipFile(cast("IO[bytes]", _Pieces(stream))) as archive:
        members = _members(archive, limit, names)
        return {name: _read_array(archive, member) for name, member in members.items()}


def read_single(stream: BinaryIO, limit: int, what: str) -> np.ndarray:
    """The one array of a .npy file, of at most ``limit`` bytes; ``what`` it is, for messages.

    Raises ValueError for anything but a plain array.
    """
    shape, fortran, dtype, _ = _header(stream, what)
    wanted = math.prod(shape) * dtype.itemsize
    if wanted > limit:
        raise ValueError(f"{what} has {whole_bytes(wanted)}, expected at most {whole_bytes(limit)}")
    return _values(stream, what, shape, fortran, dtype)


class _Pieces:
    """A file that hands out no more than a piece at once, however much a damaged directory makes
    its reader ask for.
    """

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self.seek, self.tell, self.seekable = stream.seek, stream.tell, stream.seekable

    def read(self, size: int = -1) -> bytes:
        data = self._stream.read(_PIECE + 1 if size < 0 else min(size, _PIECE + 1))
        if len(data) > _PIECE:
            raise ValueError(f"a directory of more than {whole_bytes(_PIECE)}")
        return data


def _members(
    archive: zipfile.ZipFile, limit: int, names: Collection[str] | None
) -> dict[str, zipfile.ZipInfo]:
    """The members to read by the names of their arrays, all of them checked."""
    entries = archive.infolist()
    if len(entries) > MEMBERS_MAX:
        raise ValueError(f"{len(entries)} arrays, expected at most {MEMBERS_MAX}")
    members: dict[str, zipfile.ZipInfo] = {}
    for entry in entries:
        name = entry.filename.removesuffix(".npy")
        if name == entry.filename:
            raise ValueError(f"{quoted(name)} is no array")
        if name in members:
            raise ValueError(f"{quoted(name)} is there twice")
        if entry.flag_bits & 0x1:
            raise ValueError(f"{quoted(name)} is encrypted")
        if entry.compress_type not in _METHODS:
            raise ValueError(
                f"{quoted(name)} is packed by method {entry.compress_type}, expected stored or "
                "deflated"
            )
        members[name] = entry
    if names is not None:
        members = {name: entry for name, entry in members.items() if name in names}
    total = sum(entry.file_size for entry in members.values())
    if total > limit:
        raise ValueError(
            f"arrays of {whole_bytes(total)} unpacked, expected at most {whole_bytes(limit)}"
        )
    return members


def _read_array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> np.ndarray:
    """One member as an array of this machine's byte order."""
    what = quoted(member.filename.removesuffix(".npy"))
    with archive.open(member) as stream:
        shape, fortran, dtype, start = _header(stream, what)
        wanted = math.prod(shape) * dtype.itemsize
        if wanted != member.file_size - start:
            raise ValueError(
                f"{what} has {whole_bytes(member.file_size - start)}, expected "
                f"{whole_bytes(wanted)} for the shape {shape} of {dtype}"
            )
        return _values(stream, what, shape, fortran, dtype)


def _values(
    stream: IO[bytes], what: str, shape: tuple[int, ...], fortran: bool, dtype: np.dtype
) -> np.ndarray:
    """The values that follow a header, as an array of this machine's byte order."""
    wanted = math.prod(shape) * dtype.itemsize
    data = np.empty(wanted, np.uint8)
    filled = 0
    while filled < wanted:
        piece = stream.read(min(wanted - filled, _PIECE))
        if not piece:
            raise ValueError(f"{what} ends after {filled} of {wanted} bytes")
        data[filled : filled + len(piece)] = np.frombuffer(piece, np.uint8)
        filled += len(piece)
    if dtype.kind == "b" and filled and data.max() > 1:
        raise ValueError(f"{what} holds values that are neither true nor false")
    if (
        dtype.kind == "U"
        and filled
        and data.view(">u4" if dtype.byteorder == ">" else "<u4").max() > CODE_MAX
    ):
        # Python's text would be beyond repair.
        raise ValueError(f"{what} holds characters that no text has")
    array: np.ndarray = np.ndarray(shape, dtype, data.data, order="F" if fortran else "C")
    return array if dtype.isnative else array.astype(dtype.newbyteorder("="))


def _header(stream: IO[bytes], what: str) -> tuple[tuple[int, ...], bool, np.dtype, int]:
    """Shape, order, type and the number of bytes before the values of a .npy file."""
    begin = stream.read(8)
    version = tuple(begin[6:8])
    if begin[:6] != b"\x93NUMPY" or version not in ((1, 0), (2, 0)):
        raise ValueError(f"{what} is no array of plain values")
    size = stream.read(2 if version == (1, 0) else 4)
    length = int.from_bytes(size, "little")
    if length > HEADER_MAX:
        raise ValueError(
            f"{what} has a header of {whole_bytes(length)}, expected at most "
            f"{whole_bytes(HEADER_MAX)}"
        )
    try:
        words = stream.read(length).decode("latin-1")
        entries = ast.literal_eval(_LONG.sub("", words).strip())
        descr, fortran, shape = entries["descr"], entries["fortran_order"], entries["shape"]
    except (ValueError, TypeError, KeyError, SyntaxError, MemoryError, RecursionError) as error:
        raise ValueError(f"{what} has a damaged header") from error
    if not isinstance(descr, str) or not _PLAIN.fullmatch(descr):
        raise ValueError(
            f"{what} holds {shown(descr)} values, expected plain arrays of numbers or text"
        )
    if not isinstance(shape, tuple) or not all(
        type(side) is int and 0 <= side <= ARRAYS_MAX for side in shape
    ):
        raise ValueError(f"{what} has a damaged shape")
    if len(shape) > DIMENSIONS_MAX:
        raise ValueError(f"{what} has {len(shape)} dimensions, expected at most {DIMENSIONS_MAX}")
    try:
        dtype = np.dtype(descr)
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"{what} holds {shown(descr)} values, which this machine does not know"
        ) from error
    if dtype.itemsize == 0 and math.prod(shape) > 1:
        raise ValueError(f"{what} holds {math.prod(shape)} values of no size")
    return shape, bool(fortran), dtype, len(begin) + len(size) + length

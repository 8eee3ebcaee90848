"""What an archive unpacks to, in pieces and never more than is allowed; an archive may promise
anything.
"""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
from typing import IO, BinaryIO, cast

from facestage.contract.files.reading import MIB

# A directory or a header is read at once: none of a published archive has more.
PIECE = 4 * MIB
# What xz -9 needs is 65 MiB; the format lets a file of 32 bytes ask for 4 GiB.
_XZ_MEMORY = 256 * MIB
_GZIP, _BZIP2 = b"\x1f\x8b", b"BZh"
_XZ = (b"\xfd7zXZ\x00", b"\x5d\x00\x00")


class Pieces:
    """A file that hands out no more than a piece at once, whatever a damaged directory makes its
    reader ask for.
    """

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self.seek, self.tell, self.seekable = stream.seek, stream.tell, stream.seekable

    def read(self, size: int = -1) -> bytes:
        """Up to ``size`` bytes. Raises ValueError when they are more than a piece."""
        data = self._stream.read(PIECE + 1 if size < 0 else min(size, PIECE + 1))
        if len(data) > PIECE:
            raise ValueError(f"its directory has more than {PIECE // MIB} MiB")
        return data


class Unpacked:
    """The bytes of a packed stream (xz, gzip, bzip2) or of one that is not, up to a limit in all
    and to a next stop.

    Raises ValueError beyond either.
    """

    def __init__(self, stream: BinaryIO, limit: int) -> None:
        self.position, self.limit, self.stop = 0, limit, PIECE
        start = stream.read(6)
        stream.seek(0)
        self._source: IO[bytes] | io.RawIOBase = stream
        if start.startswith(_XZ):
            self._source = _Xz(stream)
        elif start.startswith(_GZIP):
            self._source = cast("IO[bytes]", gzip.GzipFile(fileobj=stream))
        elif start.startswith(_BZIP2):
            self._source = cast("IO[bytes]", bz2.BZ2File(stream))

    def read(self, size: int) -> bytes:
        """The next bytes, at most ``size``."""
        data = self._source.read(size) or b""
        self.position += len(data)
        if self.position > self.limit:
            raise ValueError(f"it unpacks to more than {self.limit // MIB} MiB")
        if self.position > self.stop:
            raise ValueError(f"one of its headers has more than {PIECE // MIB} MiB")
        return data


class _Xz(io.RawIOBase):
    """The bytes of an .xz or .lzma stream; Python's own file of them sets no limit to the
    memory.
    """

    def __init__(self, stream: BinaryIO) -> None:
        super().__init__()
        self._stream = stream
        self._decompressor = lzma.LZMADecompressor(memlimit=_XZ_MEMORY)

    def read(self, size: int = -1) -> bytes:
        """The next bytes, at most ``size``."""
        while not self._decompressor.eof:
            packed = self._stream.read(64 * 1024) if self._decompressor.needs_input else b""
            if self._decompressor.needs_input and not packed:
                raise EOFError("it is cut")
            data = self._decompressor.decompress(packed, size)
            if data:
                return data
        return b""

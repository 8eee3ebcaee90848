"""Damage to archives: zip and .npz, tar, and what compresses them."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import struct
import tarfile
import warnings
import zipfile
import zlib
from collections.abc import Callable

from fuzz.choice import Choose
from fuzz.damage.arrays import mangle_npy
from fuzz.damage.bytes import BOUNDARY, mangle_bytes
from fuzz.damage.json import mangle_json

Mutator = Callable[[Choose, bytes], bytes]
Members = list[tuple[str, bytes]]
DATE = (1980, 1, 1, 0, 0, 0)
METHODS = (
    *(zipfile.ZIP_STORED,) * 4,
    *(zipfile.ZIP_DEFLATED,) * 2,
    zipfile.ZIP_BZIP2,
    zipfile.ZIP_LZMA,
)
LOCAL, CENTRAL, END = b"PK\x03\x04", b"PK\x01\x02", b"PK\x05\x06"
# Offset and size of the fields of a local and of a central header.
LOCAL_FIELDS = ((4, 2), (6, 2), (8, 2), (14, 4), (18, 4), (22, 4), (26, 2), (28, 2))
CENTRAL_FIELDS = (
    (6, 2),
    (8, 2),
    (10, 2),
    (16, 4),
    (20, 4),
    (24, 4),
    (28, 2),
    (30, 2),
    (32, 2),
    (38, 4),
    (42, 4),
)
END_FIELDS = ((4, 2), (8, 2), (10, 2), (12, 4), (16, 4), (20, 2))
UNPACKED_MAX = 64 << 20  # bytes of an archive that is taken apart
BOMB = 2700  # MiB that a few MiB unpack to


def zip_bytes(members: Members, method: int = zipfile.ZIP_STORED) -> bytes:
    """A zip of ``members``, the same bytes whenever it is made."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of names that are there twice
        for name, content in members:
            info = zipfile.ZipInfo(name, DATE)
            info.compress_type = method
            archive.writestr(info, content, compresslevel=1)
    return stream.getvalue()


def zip_members(data: bytes) -> Members:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        if sum(info.file_size for info in archive.infolist()) > UNPACKED_MAX:
            raise zipfile.BadZipFile("a bomb, which is damaged as it is")
        return [(info.filename, archive.read(info)) for info in archive.infolist()]


def mutator_for(name: str) -> Mutator:
    """The mutator of a file or of a member, by what its name says it holds."""
    suffix = name.rpartition(".")[2].lower()
    return {
        "json": mangle_json,
        "npy": mangle_npy,
        "npz": mangle_zip,
        "zip": mangle_zip,
        "task": mangle_zip,
        "tar": mangle_tar,
        "gz": mangle_tar,
        "xz": mangle_tar,
        "bz2": mangle_tar,
    }.get(suffix, mangle_bytes)


def mangle_zip(choose: Choose, data: bytes) -> bytes:
    """Members damaged and packed again with right sums (mostly), headers changed, or plain
    damage.
    """
    kind = choose.number(0, 9)
    if kind == 0:
        return mangle_bytes(choose, data)
    if kind <= 2:
        return _headers(choose, data)
    try:
        members = zip_members(data)
    except (
        zipfile.BadZipFile,
        NotImplementedError,
        RuntimeError,
        OSError,
        EOFError,
        ValueError,
        lzma.LZMAError,
        zlib.error,
    ):
        return mangle_bytes(choose, data)
    for _ in range(choose.one_of((1, 1, 1, 2))):
        members = _members(choose, members)
    methods = (zipfile.ZIP_STORED,) * 4 + (
        zipfile.ZIP_DEFLATED,
        zipfile.ZIP_DEFLATED,
        zipfile.ZIP_BZIP2,
        zipfile.ZIP_LZMA,
    )
    packed = zip_bytes(members, choose.one_of(methods))
    return _headers(choose, packed) if choose.chance(8) else packed


def _members(choose: Choose, members: Members) -> Members:
    if not members:
        return [("a.npy", b"")]
    place = choose.number(0, len(members) - 1)
    name, content = members[place]
    kind = choose.number(0, 19)
    changed = list(members)
    if kind < 13:
        changed[place] = (name, mutator_for(name)(choose, content))
    elif kind < 15:
        del changed[place]
    elif kind == 15:
        changed.insert(choose.number(0, len(members)), (name, members[-1][1]))
    elif kind == 16:
        other = choose.number(0, len(members) - 1)
        changed[place], changed[other] = (name, members[other][1]), (members[other][0], content)
    elif kind == 17:
        changed[place] = (
            choose.one_of(("", "../../x.npy", "/x.npy", "a\nb.npy", "x" * 3000, choose.text())),
            content,
        )
    elif kind == 18:
        changed.append((choose.one_of(("extra.npy", "extra/.npy", "x")), content))
    else:
        changed += [(f"extra/{k}.npy", content[:200]) for k in range(choose.one_of((10, 300)))]
    return changed


def _headers(choose: Choose, data: bytes) -> bytes:
    """One to three fields of the headers: sizes, sums, flags (encrypted), methods, offsets."""
    changed = bytearray(data)
    for _ in range(choose.number(1, 3)):
        mark, fields = choose.one_of(
            ((LOCAL, LOCAL_FIELDS), (CENTRAL, CENTRAL_FIELDS), (END, END_FIELDS))
        )
        starts = _found(changed, mark)
        if not starts:
            continue
        offset, size = choose.one_of(fields)
        start = choose.one_of(starts) + offset
        value = choose.one_of((*BOUNDARY, 8, 12, 14, 95, 99, 0x41, 0x800)) & (256**size - 1)
        if start + size <= len(changed):
            changed[start : start + size] = struct.pack({2: "<H", 4: "<I"}[size], value)
    return bytes(changed)


def _found(data: bytearray, mark: bytes) -> list[int]:
    starts: list[int] = []
    start = data.find(mark)
    while start >= 0 and len(starts) < 200:
        starts.append(start)
        start = data.find(mark, start + 4)
    return starts


def mangle_tar(choose: Choose, data: bytes) -> bytes:
    """Damage behind the compression, or to it."""
    if choose.chance(3):
        return mangle_bytes(choose, data)
    pack, inner = _unpacked(data)
    if choose.chance(2):
        return pack(mangle_bytes(choose, inner))
    try:
        with tarfile.open(fileobj=io.BytesIO(inner)) as archive:
            members = [
                (info.name, stream.read())
                for info in archive
                if (stream := archive.extractfile(info))
            ]
    except (tarfile.TarError, OSError, EOFError, ValueError):
        return pack(mangle_bytes(choose, inner))
    return pack(tar_bytes(_members(choose, members)))


def tar_bytes(members: Members) -> bytes:
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w") as archive:
        for name, content in members:
            info = tarfile.TarInfo(name.replace("\0", "?"))
            info.size = len(content)
            archive.addfile(info, io.BytesIO(content))
    return stream.getvalue()


def _unpacked(data: bytes) -> tuple[Callable[[bytes], bytes], bytes]:
    try:
        if data.startswith(b"\xfd7zXZ"):
            return (
                lambda inner: lzma.compress(inner, preset=0)
            ), lzma.LZMADecompressor().decompress(data, UNPACKED_MAX)
        if data.startswith(b"\x1f\x8b"):
            return (lambda inner: gzip.compress(inner, 1, mtime=0)), zlib.decompressobj(
                31
            ).decompress(data, UNPACKED_MAX)
        if data.startswith(b"BZh"):
            return bz2.compress, bz2.BZ2Decompressor().decompress(data, UNPACKED_MAX)
    except (OSError, EOFError, lzma.LZMAError, ValueError, zlib.error):
        pass
    return (lambda inner: inner), data


def deflated_zeros(mebibytes: int) -> bytes:
    """A raw deflate stream of so many MiB of zeros: one block that starts afresh, again and
    again.
    """
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    block = packer.compress(bytes(1 << 20)) + packer.flush(zlib.Z_FULL_FLUSH)
    return block * mebibytes + packer.flush()


def bomb_zip(name: str, start: bytes = b"", mebibytes: int = BOMB) -> bytes:
    """A small zip whose one member unpacks to ``start`` and zeros.

    Its sum is wrong, which shows at the end alone.
    """
    stored = b"\x00" + struct.pack("<HH", len(start), len(start) ^ 0xFFFF) + start if start else b""
    content = stored + deflated_zeros(mebibytes)
    size = len(start) + (mebibytes << 20)
    title = name.encode()
    fields = struct.pack("<HHHHHIIIHH", 20, 0, 8, 0, 33, 0, len(content), size, len(title), 0)
    local = LOCAL + fields + title + content
    central = CENTRAL + struct.pack("<H", 20) + fields + bytes(14) + title
    return local + central + END + struct.pack("<HHHHIIH", 0, 0, 1, 1, len(central), len(local), 0)

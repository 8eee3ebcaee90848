"""The files of a model that is published as a folder or as an archive of one, one after the
other.
"""

from __future__ import annotations

import lzma
import tarfile
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path, PurePosixPath
from typing import IO, cast

from facestage.contract.errors import InputError
from facestage.contract.files.reading import MIB, open_regular, read_bytes
from facestage.models.files.bounded_stream import PIECE, Pieces, Unpacked

# ICT-FaceKit as published: 27 MB packed, 387 MB unpacked, 157 files of at most 2.7 MB, one of its
# vertices 0.1 MB.
ARCHIVE_LIMIT, UNPACKED_LIMIT, FILE_LIMIT, COUNT_LIMIT = 1024 * MIB, 1024 * MIB, 8 * MIB, 1000
_ENTRY_LIMIT = 100_000
_METHODS = {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}
_DAMAGED = (
    tarfile.TarError,
    zipfile.BadZipFile,
    lzma.LZMAError,
    zlib.error,
    EOFError,
    OSError,
    ValueError,
    OverflowError,
    NotImplementedError,
    RuntimeError,
)

Wanted = Callable[[str], bool]


def published_files(
    path: Path, folder: str, wanted: Wanted, what: str, source: str
) -> Iterator[tuple[str, bytes]]:
    """Names and contents of the wanted files in ``folder`` of an archive or folder ``path``, in its
    own order.

    A folder may also be ``folder`` itself. Links are not followed in an archive. ``what`` names the
    model in messages, ``source`` is where it is from. Raises InputError for what cannot be read,
    and for more than such a model has.
    """
    count = total = 0
    try:
        found = (
            _in_folder(path, folder, wanted)
            if path.is_dir()
            else _in_archive(path, folder, wanted, what)
        )
        for name, content in found:
            count, total = count + 1, total + len(content)
            if count > COUNT_LIMIT or total > UNPACKED_LIMIT:
                raise ValueError(
                    f"it has more than {COUNT_LIMIT} files or {UNPACKED_LIMIT // MIB} MiB in "
                    f"{folder}"
                )
            yield name, content
    except InputError:
        raise
    except _DAMAGED as error:
        reason = " ".join(str(error).split()).rstrip(".")[:200] or type(error).__name__
        raise InputError(
            f"The {what} '{path}' cannot be read ({reason}); fetch it again from {source}."
        ) from error


def _in_folder(path: Path, folder: str, wanted: Wanted) -> Iterator[tuple[str, bytes]]:
    root = path / folder if (path / folder).is_dir() else path
    for item in sorted(root.iterdir()):
        if wanted(item.name):
            yield item.name, read_bytes(item, "face model file", FILE_LIMIT)


def _in_archive(path: Path, folder: str, wanted: Wanted, what: str) -> Iterator[tuple[str, bytes]]:
    def is_wanted(name: str) -> bool:
        return folder in PurePosixPath(name).parts[:-1] and wanted(PurePosixPath(name).name)

    with open_regular(path, what, ARCHIVE_LIMIT) as stream:
        # As zipfile.is_zipfile does, but a directory that is too large is an error.
        if stream.read(4) in (b"PK\x03\x04", b"PK\x05\x06"):
            stream.seek(0)
            yield from _in_zip(zipfile.ZipFile(cast("IO[bytes]", Pieces(stream))), is_wanted)
        else:
            stream.seek(0)
            yield from _in_tar(Unpacked(stream, UNPACKED_LIMIT), is_wanted)


def _in_zip(archive: zipfile.ZipFile, is_wanted: Wanted) -> Iterator[tuple[str, bytes]]:
    for member in archive.infolist():
        if member.is_dir() or not is_wanted(member.filename):
            continue
        if member.flag_bits & 1:
            raise ValueError("it is encrypted")
        if member.compress_type not in _METHODS:
            raise ValueError(
                f"its files are packed by method {member.compress_type}, expected stored or "
                "deflated"
            )
        _check_size(member.filename, member.file_size)
        with archive.open(member) as stream:
            yield (
                PurePosixPath(member.filename).name,
                _whole(stream, member.filename, member.file_size),
            )


def _in_tar(stream: Unpacked, is_wanted: Wanted) -> Iterator[tuple[str, bytes]]:
    with tarfile.open(fileobj=cast("IO[bytes]", stream), mode="r|") as archive:
        for _ in range(_ENTRY_LIMIT):
            member = archive.next()
            if member is None:
                return
            # What is skipped may be of any size; a header that follows may not.
            stream.stop = member.offset_data + member.size + PIECE
            content = (
                archive.extractfile(member) if member.isreg() and is_wanted(member.name) else None
            )
            if content is not None:
                _check_size(member.name, member.size)
                yield PurePosixPath(member.name).name, _whole(content, member.name, member.size)
            # The archive keeps what it has seen.
            archive.members.clear()  # type: ignore[attr-defined]
    raise ValueError(f"it has more than {_ENTRY_LIMIT} entries")


def _check_size(name: str, size: int) -> None:
    if size > FILE_LIMIT:
        raise ValueError(
            f"{name[-100:]} has {size / MIB:.1f} MiB, expected at most {FILE_LIMIT // MIB}"
        )


def _whole(stream: IO[bytes], name: str, size: int) -> bytes:
    """All of a file that says to have ``size`` bytes, which are not believed."""
    content = stream.read(size + 1)
    if len(content) != size:
        raise ValueError(f"{name[-100:]} does not have the {size} bytes that it should have")
    return content

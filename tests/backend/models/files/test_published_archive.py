"""Archives of a model are read piece by piece; bombs, damage and odd members are refused in a
sentence.
"""

from __future__ import annotations

import bz2
import contextlib
import gzip
import io
import lzma
import os
import struct
import tarfile
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.models.files.published_archive import COUNT_LIMIT, FILE_LIMIT, published_files
from facestage.models.loaders.ict import load_ict
from reference.memory import memory

FOLDER = "Model"
PACKERS: dict[str, Callable[[bytes], bytes]] = {
    "plain": bytes,
    "gz": gzip.compress,
    "xz": lzma.compress,
    "bz2": bz2.compress,
    "lzma": lambda data: lzma.compress(data, lzma.FORMAT_ALONE),
}


def read(path: Path) -> dict[str, bytes]:
    return dict(
        published_files(
            path, FOLDER, lambda name: name.endswith(".obj"), "toy model", "https://toy"
        )
    )


def refusal(path: Path) -> str:
    with pytest.raises(InputError, match=path.name) as caught:
        read(path)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 500
    return str(caught.value)


def tar(entries: dict[str, bytes], **change: object) -> bytes:
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w") as archive:
        for name, content in entries.items():
            info = tarfile.TarInfo(name)
            info.size = len(content)
            for attribute, value in change.items():
                setattr(info, attribute, value)
            archive.addfile(info, io.BytesIO(content))
    return stream.getvalue()


def zipped(entries: dict[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as archive:
        for name, content in entries.items():
            archive.writestr(name, content)
    return stream.getvalue()


FILES = {
    "toy/README": b"no" * 9000,
    f"toy/{FOLDER}/a.obj": b"one",
    f"toy/{FOLDER}/b.obj": b"",
    f"toy/{FOLDER}/c": b"x",
}


@pytest.mark.parametrize("packer", PACKERS)
def test_wanted_files_come_out_of_every_kind_of_tar(tmp_path: Path, packer: str):
    (tmp_path / "a.tar").write_bytes(PACKERS[packer](tar(FILES)))
    assert read(tmp_path / "a.tar") == {"a.obj": b"one", "b.obj": b""}


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_wanted_files_come_out_of_a_zip_and_a_folder(tmp_path: Path, method: int):
    (tmp_path / "a.zip").write_bytes(zipped(FILES, method))
    with zipfile.ZipFile(tmp_path / "a.zip") as archive:
        archive.extractall(tmp_path)
    for path in (tmp_path / "a.zip", tmp_path / "toy", tmp_path / "toy" / FOLDER):
        assert read(path) == {"a.obj": b"one", "b.obj": b""}


@pytest.mark.parametrize("packer", PACKERS)
def test_damaged_archives_are_a_sentence(tmp_path: Path, packer: str):
    random = np.random.default_rng(0)
    content = PACKERS[packer](tar({f"{FOLDER}/{k}.obj": random.bytes(2000) for k in range(5)}))
    for trial in range(60):
        damaged = bytearray(content)
        if trial % 2:
            del damaged[int(random.integers(1, len(content))) :]
        for position in random.integers(0, len(damaged), 3):
            damaged[position] ^= int(random.integers(1, 256))
        path = tmp_path / "damaged.tar"
        path.write_bytes(damaged)
        # Anything else is a failure.
        with contextlib.suppress(InputError):
            read(path)


def test_a_zip_bomb_is_refused_before_it_unpacks(tmp_path: Path):
    (tmp_path / "a.zip").write_bytes(zipped({f"{FOLDER}/a.obj": bytes(200 * 2**20)}))
    assert (tmp_path / "a.zip").stat().st_size < 2**20
    with memory(20e6):
        assert "a.obj has 200.0 MiB, expected at most 8" in refusal(tmp_path / "a.zip")


def test_a_zip_that_says_less_than_it_holds_gives_no_more(tmp_path: Path):
    content = bytearray(zipped({f"{FOLDER}/a.obj": bytes(100 * 2**20)}))
    size = struct.pack("<I", 100 * 2**20)
    while size in content:
        at = content.index(size)
        content[at : at + 4] = struct.pack("<I", 1000)
    (tmp_path / "a.zip").write_bytes(content)
    with memory(20e6):
        assert "cannot be read" in refusal(tmp_path / "a.zip")


@pytest.mark.parametrize("packer", ["gz", "xz", "bz2"])
def test_a_tar_bomb_is_refused_before_it_unpacks(tmp_path: Path, packer: str):
    (tmp_path / "a.tar").write_bytes(PACKERS[packer](tar({f"{FOLDER}/a.obj": bytes(64 * 2**20)})))
    with memory(40e6):
        assert "a.obj has 64.0 MiB, expected at most 8" in refusal(tmp_path / "a.tar")


@pytest.mark.parametrize("kind", [tarfile.GNUTYPE_LONGNAME, tarfile.XHDTYPE])
def test_a_name_that_is_gigabytes_long_is_refused(tmp_path: Path, kind: bytes):
    info = tarfile.TarInfo("././@LongLink")
    info.type, info.size = kind, 600 * 2**20
    block = info.tobuf(tarfile.USTAR_FORMAT) + bytes(64 * 2**20)
    (tmp_path / "a.tar").write_bytes(gzip.compress(block, 1))
    with memory(40e6):
        assert "one of its headers has more than 4 MiB" in refusal(tmp_path / "a.tar")


def test_a_dictionary_of_gigabytes_is_refused(tmp_path: Path):
    # The properties of an .lzma: a byte, the size of the dictionary, the size unpacked.
    content = bytearray(PACKERS["lzma"](tar(FILES)))
    content[1:5] = struct.pack("<I", 2**31)
    (tmp_path / "a.tar").write_bytes(content)
    assert "emory" in refusal(tmp_path / "a.tar")


def test_many_files_are_refused(tmp_path: Path):
    (tmp_path / "a.tar").write_bytes(
        tar({f"{FOLDER}/{k}.obj": b"" for k in range(COUNT_LIMIT + 1)})
    )
    assert f"more than {COUNT_LIMIT} files" in refusal(tmp_path / "a.tar")


def test_a_directory_of_many_megabytes_is_refused(tmp_path: Path):
    (tmp_path / "a.zip").write_bytes(
        zipped({"x" * 60_000 + str(k): b"" for k in range(100)}, zipfile.ZIP_STORED)
    )
    with memory(40e6):
        assert "its directory has more than 4 MiB" in refusal(tmp_path / "a.zip")


def test_encrypted_and_odd_zips_are_refused(tmp_path: Path):
    (tmp_path / "a.zip").write_bytes(zipped(FILES, zipfile.ZIP_LZMA))
    assert "packed by method 14, expected stored or deflated" in refusal(tmp_path / "a.zip")
    content = bytearray(zipped(FILES))
    for mark, offset in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        at = -1
        while (at := content.find(mark, at + 1)) >= 0:
            content[at + offset] |= 1
    (tmp_path / "b.zip").write_bytes(content)
    assert "it is encrypted" in refusal(tmp_path / "b.zip")


@pytest.mark.parametrize(
    "kind", [tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.FIFOTYPE, tarfile.CHRTYPE]
)
def test_links_and_devices_in_an_archive_are_not_files(tmp_path: Path, kind: bytes):
    (tmp_path / "a.tar").write_bytes(
        tar({f"{FOLDER}/a.obj": b""}, type=kind, linkname="/etc/passwd")
    )
    assert read(tmp_path / "a.tar") == {}


@pytest.mark.parametrize("name", ["generic_neutral_mesh.obj", "vertex_indices.json"])
def test_a_pipe_in_a_folder_is_refused_unread(tmp_path: Path, name: str):
    os.mkfifo(tmp_path / name)
    with pytest.raises(InputError, match=f"{name}' is a pipe or a device"):
        load_ict(tmp_path)


def test_a_pipe_and_a_device_are_refused_unread(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", Path("/dev/zero")):
        with pytest.raises(InputError, match="is a pipe or a device"):
            load_ict(path)


def test_a_large_file_in_a_folder_is_refused(tmp_path: Path):
    with (tmp_path / "a.obj").open("wb") as stream:
        stream.truncate(FILE_LIMIT + 1)
    with pytest.raises(InputError, match=r"a\.obj' has .* expected at most 8 MiB"):
        read(tmp_path)

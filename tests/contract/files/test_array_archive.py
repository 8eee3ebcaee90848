"""Archives of arrays as an enemy would write them: refused before anything is allocated."""

from __future__ import annotations

import io
import os
import struct
import zipfile
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.files.reading import MIB
from facestage.contract.files.storage import read_arrays

resource = pytest.importorskip("resource", reason="Windows does not say how much memory was used")
DESCR = "{'descr': '<f8', 'fortran_order': False, 'shape': (4,), }"


def npy(header: str = DESCR, data: bytes = bytes(32), version: bytes = b"\x01\x00") -> bytes:
    words = header.encode("latin-1") + b"\n"
    size = struct.pack("<H" if version == b"\x01\x00" else "<I", len(words))
    return b"\x93NUMPY" + version + size + words + data


def archive(path: Path, *members: tuple[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> Path:
    with zipfile.ZipFile(path, "w", method) as file:
        for name, content in members:
            file.writestr(name, content)
    return path


def patched(path: Path, mark: bytes, offset: int, value: bytes) -> Path:
    content = bytearray(path.read_bytes())
    place = content.rindex(mark) + offset
    content[place : place + len(value)] = value
    path.write_bytes(content)
    return path


HOSTILE: dict[str, tuple] = {
    "LZMA": (lambda p: archive(p, ("a.npy", npy()), method=zipfile.ZIP_LZMA), "method 14"),
    "BZIP2": (lambda p: archive(p, ("a.npy", npy()), method=zipfile.ZIP_BZIP2), "method 12"),
    "encrypted": (
        lambda p: patched(archive(p, ("a.npy", npy())), b"PK\x01\x02", 8, b"\x01"),
        "encrypted",
    ),
    "no array": (lambda p: archive(p, ("a.txt", b"hello")), "no array"),
    "twice": (
        lambda p: patched(archive(p, ("a.npy", npy()), ("b.npy", npy())), b"b.npy", 0, b"a.npy"),
        "twice",
    ),
    "many": (lambda p: archive(p, *((f"{k}.npy", npy()) for k in range(4097))), "4097 arrays"),
    "large directory": (
        lambda p: archive(p, *((f"{k}{'x' * 60_000}", b"") for k in range(80))),
        "directory",
    ),
    "too small": (
        lambda p: archive(p, ("a.npy", npy(data=bytes(24)))),
        "24 bytes, expected 32 bytes",
    ),
    "too large": (
        lambda p: archive(p, ("a.npy", npy(data=bytes(40)))),
        "40 bytes, expected 32 bytes",
    ),
    "a terabyte": (
        lambda p: archive(p, ("a.npy", npy(DESCR.replace("4,", "137438953472,")))),
        "damaged shape|expected 1 TiB",
    ),
    "says a gigabyte": (
        lambda p: patched(archive(p, ("a.npy", npy())), b"PK\x01\x02", 24, b"\xff\xff\xff\x7f"),
        "expected at most",
    ),
    "bomb": (
        lambda p: archive(p, ("a.npy", npy(DESCR.replace("4,", "33554432,"), bytes(2**28)))),
        "expected at most",
    ),
    "negative": (lambda p: archive(p, ("a.npy", npy(DESCR.replace("4,", "-4,")))), "damaged shape"),
    "no size": (
        lambda p: archive(
            p, ("a.npy", npy(DESCR.replace("<f8", "<U0").replace("4,", "1000000000,"), b""))
        ),
        "no size",
    ),
    "objects": (lambda p: archive(p, ("a.npy", npy(DESCR.replace("<f8", "|O")))), "plain arrays"),
    "records": (
        lambda p: archive(p, ("a.npy", npy(DESCR.replace("'<f8'", "[('x', '<f8')]")))),
        "plain arrays",
    ),
    "dates": (lambda p: archive(p, ("a.npy", npy(DESCR.replace("<f8", "<M8[s]")))), "plain arrays"),
    "complex": (lambda p: archive(p, ("a.npy", npy(DESCR.replace("<f8", "<c16")))), "plain arrays"),
    "unknown number": (
        lambda p: archive(p, ("a.npy", npy(DESCR.replace("<f8", "<f3")))),
        "does not know",
    ),
    "deep header": (lambda p: archive(p, ("a.npy", npy("(" * 4000))), "damaged header"),
    "long header": (lambda p: archive(p, ("a.npy", npy(" " * 9999 + DESCR))), "header of"),
    "header of gigabytes": (
        lambda p: archive(p, ("a.npy", b"\x93NUMPY\x02\x00\xff\xff\xff\x7f")),
        "header of 2 GiB",
    ),
    "code as header": (
        lambda p: archive(p, ("a.npy", npy("__import__('os').abort()"))),
        "damaged header",
    ),
    "version": (
        lambda p: archive(p, ("a.npy", npy(version=b"\x03\x00"))),
        "no array of plain values",
    ),
    "many dimensions": (
        lambda p: archive(p, ("a.npy", npy(DESCR.replace("(4,)", "(1, 1, 1, 1, 1, 1, 1, 1, 4)")))),
        "9 dimensions",
    ),
    "flags": (
        lambda p: archive(p, ("a.npy", npy(DESCR.replace("<f8", "|b1"), b"\x07" * 4))),
        "neither true nor",
    ),
    "no text": (
        lambda p: archive(p, ("a.npy", npy(DESCR.replace("<f8", ">U1"), b"\x7f\xff\xff\xff" * 4))),
        "no text has",
    ),
    "flipped": (
        lambda p: patched(archive(p, ("a.npy", npy()), method=0), b"\n" + bytes(32), 9, b"x"),
        "CRC",
    ),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_archive_is_refused(tmp_path: Path, name: str):
    make, words = HOSTILE[name]
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(
        InputError, match=rf"truth file .*x\.npz' is not a readable .npz.*({words})"
    ) as caught:
        read_arrays(make(tmp_path / "x.npz"), "truth file", 64 * MIB)
    assert str(caught.value).isprintable() and len(str(caught.value)) < 500
    if name != "bomb":  # which is made in memory
        assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 64 * 1024, "KiB"


def test_only_the_wanted_arrays_are_read(tmp_path: Path):
    path = archive(tmp_path / "x.npz", ("a.npy", npy()), ("b.npy", npy(DESCR.replace("<f8", "|O"))))
    assert list(read_arrays(path, "file", names=("a", "c"))) == ["a"]


@pytest.mark.parametrize("dtype", ["<f4", ">f8", ">i2", "|u1", "|b1", "<U5", "<f2"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_what_numpy_writes_is_read(tmp_path: Path, dtype: str, order: Literal["C", "F"]):
    array = np.asarray(np.arange(12).reshape(3, 4) % 2, order=order).astype(dtype)
    np.savez_compressed(tmp_path / "x.npz", a=array, none=np.zeros((0, 3)), one=np.array(3))
    found = read_arrays(tmp_path / "x.npz", "file")
    np.testing.assert_array_equal(found["a"], array)
    assert found["a"].dtype.isnative and found["none"].shape == (0, 3) and found["one"] == 3


def test_headers_of_python_2_are_read(tmp_path: Path):
    path = archive(tmp_path / "x.npz", ("a.npy", npy(DESCR.replace("4,", "4L,"))))
    assert read_arrays(path, "file")["a"].shape == (4,)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes are of Unix")
def test_pipes_devices_and_folders_are_refused_unread(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe")
    for path, words in (
        (tmp_path / "pipe", "a pipe"),
        (Path("/dev/zero"), "a device"),
        (tmp_path, "a folder"),
    ):
        with pytest.raises(InputError, match=words):
            read_arrays(path, "file")


def test_a_single_array_says_so(tmp_path: Path):
    buffer = io.BytesIO()
    np.save(buffer, np.zeros(3))
    (tmp_path / "x.npz").write_bytes(buffer.getvalue())
    with pytest.raises(InputError, match="single array"):
        read_arrays(tmp_path / "x.npz", "file")

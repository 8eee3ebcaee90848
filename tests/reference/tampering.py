"""Every way to spoil a result folder that comes to mind: each array, each key, each file."""

from __future__ import annotations

import json
import os
import shutil
import zipfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from facestage.contract.files.storage import read_arrays
from facestage.contract.texture_maps import TEXTURE_MAPS

Tampering = tuple[str, Callable[[Path], None]]
GONE = object()

ARRAY_CHANGES: dict[str, Callable[[np.ndarray], Any]] = {
    "missing": lambda _: GONE,
    "NaN": lambda array: np.full(array.shape, np.nan),
    "one NaN": lambda array: _one(array.astype(float), np.nan),
    "infinite": lambda array: _one(array.astype(float), np.inf),
    "huge": lambda array: np.full(array.shape, 1e300),
    "beyond single floats": lambda array: _one(array.astype(float), 1e39),
    "negative": lambda array: -1 - np.abs(array.astype(float)),
    "large whole numbers": lambda array: np.full(array.shape, 2**62),
    "zero": lambda array: np.zeros(array.shape),
    "empty": lambda array: np.zeros((0, *array.shape[1:])) if array.ndim else np.zeros(0),
    "one row more": lambda array: np.concatenate([array, array[:1]]) if array.ndim else np.zeros(2),
    "another axis": lambda array: array[None],
    "text": lambda array: np.full(array.shape, "text"),
    "flags": lambda array: np.ones(array.shape, bool),
    "complex": lambda array: array.astype(complex),
    "objects": lambda array: np.full(array.shape, None, object),
}
VALUES: dict[str, Any] = {
    "missing": GONE,
    "null": None,
    "a number": 5,
    "a negative number": -1,
    "a fraction": 0.5,
    "huge": 1e300,
    "too large for floats": 10**400,
    "text": "x",
    "no text": "",
    "long text": "x" * 1_000_000,
    "true": True,
    "a list": [],
    "a list of lists": [[[1]]],
    "an object": {},
    "an object of objects": {"x": {"y": []}},
    "a null character": "a\0b",
    "half a character": "\ud800",
    "lines": "a\nb\x1b[31m",
}
TEXTS: dict[str, bytes] = {
    "nothing": b"",
    "no JSON": b"{",
    "a list": b"[]",
    "deep": b"[" * 100_000,
    "deep and whole": b"[" * 900 + b"]" * 900,
    "deep object": b'{"a":' * 100_000,
    "digits": b'{"schema": ' + b"9" * 10_000 + b"}",
    "NaN": b'{"schema": NaN}',
    "twice": b'{"schema": 1, "schema": 1}',
    "Latin": b'{"schema": "\xe9"}',
    "zeros": bytes(1000),
}
PICTURES = tuple(each.file for each in TEXTURE_MAPS)


def tamperings(folder: Path) -> Iterator[Tampering]:
    """Name and deed of each, for results like the sound one in ``folder``."""
    for name in read_arrays(folder / "result.npz", "arrays"):
        for words, change in ARRAY_CHANGES.items():
            yield f"{name}: {words}", partial(_change_array, name=name, change=change)
    data = json.loads((folder / "result.json").read_text())
    for path in _paths(data):
        for words, value in VALUES.items():
            yield f"{'.'.join(path)}: {words}", partial(_change_value, path=path, value=value)
    for words, content in TEXTS.items():
        yield (
            f"result.json: {words}",
            partial(_at, "result.json", partial(_replace, content=content)),
        )
    for words, deed in ARCHIVES.items():
        yield f"result.npz: {words}", partial(_at, "result.npz", deed)
    for file in ("result.json", "result.npz", *PICTURES):
        for words, deed in FILES.items():
            yield f"{file}: {words}", partial(_at, file, deed)


def _at(name: str, deed: Callable[[Path], object], folder: Path) -> None:
    deed(folder / name)


def copy_of(folder: Path, target: Path) -> Path:
    """A fresh copy of a result folder."""
    shutil.rmtree(target, ignore_errors=True)
    return Path(shutil.copytree(folder, target))


def _one(array: np.ndarray, value: float) -> np.ndarray:
    array = np.array(array)
    if array.size:
        array.flat[array.size // 2] = value
    return array


def _change_array(folder: Path, name: str, change: Callable[[np.ndarray], Any]) -> None:
    arrays = dict(read_arrays(folder / "result.npz", "arrays"))
    changed = change(arrays.pop(name))
    if changed is not GONE:
        arrays[name] = changed
    np.savez(folder / "result.npz", **arrays)


def _paths(data: dict[str, Any]) -> Iterator[tuple[str, ...]]:
    for key, value in data.items():
        yield (key,)
        if isinstance(value, dict) and value and key != "pose":
            yield from ((key, inner) for inner in list(value)[:4])


def _change_value(folder: Path, path: tuple[str, ...], value: Any) -> None:
    file = folder / "result.json"
    data = json.loads(file.read_text())
    owner = data
    for key in path[:-1]:
        owner = owner[key]
    if value is GONE:
        del owner[path[-1]]
    else:
        owner[path[-1]] = value
    file.write_text(json.dumps(data))


def _replace(path: Path, content: bytes) -> None:
    if path.exists():
        path.unlink()
    path.write_bytes(content)


def _pipe(path: Path) -> None:
    path.unlink(missing_ok=True)
    os.mkfifo(path)


def _folder(path: Path) -> None:
    path.unlink(missing_ok=True)
    path.mkdir()


def _halve(path: Path) -> None:
    if path.exists():
        _replace(path, path.read_bytes()[: path.stat().st_size // 2])


def _endless(path: Path) -> None:
    path.unlink(missing_ok=True)
    path.symlink_to("/dev/zero")


def _repacked(method: int) -> Callable[[Path], None]:
    def deed(path: Path) -> None:
        with zipfile.ZipFile(path) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
        with zipfile.ZipFile(path, "w", method) as archive:
            for name, content in members.items():
                archive.writestr(name, content)

    return deed


def _encrypted(path: Path) -> None:
    content = bytearray(path.read_bytes())
    for mark, offset in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        place = content.find(mark)
        while place >= 0:
            content[place + offset] |= 1
            place = content.find(mark, place + 4)
    path.write_bytes(content)


def _lying(path: Path) -> None:
    """The first array says that it holds a terabyte."""
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    first = next(iter(members))
    header = (
        str({"descr": "<f8", "fortran_order": False, "shape": (2**37,)}).encode().ljust(117) + b"\n"
    )
    members[first] = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + bytes(64)
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)


ARCHIVES: dict[str, Callable[[Path], None]] = {
    "LZMA": _repacked(zipfile.ZIP_LZMA),
    "BZIP2": _repacked(zipfile.ZIP_BZIP2),
    "encrypted": _encrypted,
    "a lying header": _lying,
}
FILES: dict[str, Callable[[Path], None]] = {
    "missing": lambda path: path.unlink(missing_ok=True),
    "empty": lambda path: _replace(path, b""),
    "text": lambda path: _replace(path, b"hello " * 99),
    "half": _halve,
    "a folder": _folder,
    "a pipe": _pipe,
    "without end": _endless,
}

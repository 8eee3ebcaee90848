"""JSON objects and named arrays in files, read without executing anything."""

from __future__ import annotations

import json
import math
import zipfile
import zlib
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.files.array_archive import ARRAYS_MAX, read_archive, read_single
from facestage.contract.files.atomic import atomic_file
from facestage.contract.files.json_text import JSON_MAX, decode_json
from facestage.contract.files.reading import MIB, open_regular, read_bytes
from facestage.contract.wording import shown

PACKING_MAX = 16 * MIB  # of an .npz that are no values


def write_json(path: Path, data: Mapping[str, Any]) -> None:
    """Write ``data`` as JSON; NaN and infinity become null, which JSON readers accept."""
    with atomic_file(path) as temporary:
        temporary.write_text(json.dumps(finite(data), indent=1) + "\n", encoding="utf-8")


def finite(value: Any) -> Any:
    """The value with numpy types turned to Python's and non-finite floats to None, recursively."""
    if isinstance(value, Mapping):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return finite(value.tolist())
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    if isinstance(value, np.generic):
        return finite(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Path):
        return str(value)
    return value


def read_json(path: Path, what: str) -> dict[str, Any]:
    """The JSON object in ``path``; ``what`` names the file's role in error messages.

    Raises InputError for anything but a regular file of at most JSON_MAX bytes of strict JSON
    (:mod:`.json_text`).
    """
    content = read_bytes(path, what, JSON_MAX)
    try:
        data = decode_json(content)
    except ValueError as error:
        raise InputError(
            f"The {what} '{path}' is not valid JSON ({error}); write it again."
        ) from error
    if not isinstance(data, dict):
        raise InputError(f"The {what} '{path}' holds {shown(data)}, expected a JSON object.")
    return data


def write_arrays(path: Path, arrays: Mapping[str, np.ndarray], compress: bool = True) -> None:
    """Write named arrays as an .npz; large caches that are read often are faster uncompressed."""
    save = np.savez_compressed if compress else np.savez
    with atomic_file(path) as temporary, temporary.open("wb") as stream:
        save(stream, **{name: np.asarray(array) for name, array in arrays.items()})


def read_arrays(
    path: Path,
    what: str,
    limit: int = ARRAYS_MAX,
    names: Collection[str] | None = None,
    file_limit: int | None = None,
) -> dict[str, np.ndarray]:
    """The arrays of an .npz: plain numbers and text, at most ``limit`` bytes of them; nothing in it
    can execute.

    ``names``: only these, where it has them, out of a file of at most ``file_limit`` bytes. Raises
    InputError for anything else (:mod:`.array_archive`).
    """
    try:
        # What is packed is no larger than what it unpacks to, but for headers and the directory.
        with open_regular(path, what, file_limit or limit + PACKING_MAX) as stream:
            return read_archive(stream, limit, names)
    except (
        OSError,
        ValueError,
        EOFError,
        zipfile.BadZipFile,
        zlib.error,
        NotImplementedError,
        RuntimeError,
    ) as error:
        raise InputError(
            f"The {what} '{path}' is not a readable .npz of plain arrays ({error})."
        ) from error


def read_array(path: Path, what: str, limit: int = ARRAYS_MAX) -> np.ndarray:
    """The array of a .npy file: plain numbers, at most ``limit`` bytes of them.

    Raises InputError for anything else (:mod:`.array_archive`).
    """
    try:
        with open_regular(path, what, limit + PACKING_MAX) as stream:
            return read_single(stream, limit, "the array")
    except (OSError, ValueError, EOFError) as error:
        raise InputError(
            f"The {what} '{path}' is not a readable .npy of a plain array ({error})."
        ) from error

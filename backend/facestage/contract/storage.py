"""JSON objects and named arrays in files, read without executing anything."""

from __future__ import annotations

import json
import math
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from facestage.contract.atomic import atomic_file
from facestage.contract.errors import InputError


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
    """The JSON object in ``path``; ``what`` names the file's role in error messages."""
    path = Path(path)
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise InputError(f"The {what} '{path}' does not exist; check the path.") from error
    except OSError as error:
        raise InputError(f"The {what} '{path}' cannot be read: {error.strerror or error}.") from error
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise InputError(f"The {what} '{path}' is not valid JSON ({error}); write it again.") from error
    if not isinstance(data, dict):
        raise InputError(f"The {what} '{path}' holds a {type(data).__name__}, expected a JSON object.")
    return data


def write_arrays(path: Path, arrays: Mapping[str, np.ndarray], compress: bool = True) -> None:
    """Write named arrays as an .npz; large caches that are read often are faster uncompressed."""
    save = np.savez_compressed if compress else np.savez
    with atomic_file(path) as temporary, temporary.open("wb") as stream:
        save(stream, **{name: np.asarray(array) for name, array in arrays.items()})


def read_arrays(path: Path, what: str) -> dict[str, np.ndarray]:
    """All arrays of an .npz, loaded with ``allow_pickle=False`` so that nothing can execute."""
    path = Path(path)
    try:
        with path.open("rb") as stream:
            data = np.load(stream, allow_pickle=False)
            if not isinstance(data, np.lib.npyio.NpzFile):
                raise InputError(f"The {what} '{path}' holds a single array, expected an .npz of named arrays.")
            with data:
                return {name: data[name] for name in data.files}
    except FileNotFoundError as error:
        raise InputError(f"The {what} '{path}' does not exist; check the path.") from error
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error, NotImplementedError) as error:
        raise InputError(f"The {what} '{path}' is not a readable .npz of plain arrays ({error}).") from error

"""Files written whole or not at all, and arrays read without executing anything."""

from __future__ import annotations

import json
import math
import os
import shutil
import tempfile
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from facestage.contract.errors import InputError


@contextmanager
def atomic_folder(target: Path) -> Iterator[Path]:
    """Yield a temporary folder beside ``target`` that replaces it when the block succeeds.

    A reader sees the old folder or the new one, never half of one. On an exception the
    temporary folder is removed and ``target`` stays as it was.
    """
    target = Path(target)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
    except OSError as error:
        raise InputError(
            f"Cannot write the folder '{target}': {error.strerror or error}; "
            "choose an output folder that you may write to."
        ) from error
    # mkdtemp makes private folders; the result is as readable as any the user creates.
    os.chmod(temporary, 0o777 & ~_umask())
    try:
        yield temporary
        replace_folder(temporary, target)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise


def replace_folder(source: Path, target: Path) -> None:
    """Rename ``source`` to ``target``; an existing ``target`` is removed only once it is replaced."""
    if target.exists():
        retired = Path(tempfile.mkdtemp(prefix=f".{target.name}-old-", dir=target.parent))
        os.replace(target, retired / "old")
        try:
            os.replace(source, target)
        except OSError:
            os.replace(retired / "old", target)
            raise
        finally:
            shutil.rmtree(retired, ignore_errors=True)
    else:
        os.replace(source, target)


@contextmanager
def atomic_file(target: Path) -> Iterator[Path]:
    """Yield a temporary path with ``target``'s suffix that is renamed to ``target`` on success."""
    target = Path(target)
    if target.is_dir():
        raise InputError(f"Cannot write '{target}': it is a folder; choose the name of a file.")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=".facestage-", suffix=target.suffix, dir=target.parent)
    except OSError as error:
        raise InputError(
            f"Cannot write '{target}': {error.strerror or error}; choose a folder that you may write to."
        ) from error
    os.close(handle)
    os.chmod(name, 0o666 & ~_umask())
    temporary = Path(name)
    try:
        yield temporary
        os.replace(temporary, target)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


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

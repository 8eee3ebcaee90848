"""Files and folders that appear whole or not at all."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

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

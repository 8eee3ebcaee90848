"""The place of a fit's output: one run at a time, never over what is somebody else's, no litter
left behind.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from facestage.contract.errors import InputError
from facestage.contract.files.partial import (
    LOCK,
    has_checkpoint,
    make_partial,
    mark_partial,
    partial_folder,
    remove_partial,
)
from facestage.contract.files.temporaries import sweep
from facestage.contract.result_files import is_result_file

TRIES = 100


@contextmanager
def claimed(out: Path, result_file: str) -> Iterator[Path]:
    """Hold the place of ``out`` against other runs; yields its partial folder, which is kept if it
    has a checkpoint.

    Raises InputError at once unless ``out`` is free, or holds an earlier ``result_file``, and
    nobody else writes there.
    """
    if out.exists() and not out.is_dir():
        raise InputError(f"The output '{out}' is a file; expected a folder name.")
    missing = [folder for folder in out.parents if not folder.exists()]
    try:
        partial, lock = _locked(out)
    except InputError:
        _remove_empty([partial_folder(out), *missing])
        raise
    except OSError as error:
        _remove_empty(missing)
        raise InputError(
            f"Cannot write beside '{out}' ({error.strerror or error}); choose a folder that "
            "you may write to."
        ) from error
    try:
        # What an earlier run had moved aside is put back before anybody looks whether it is there.
        sweep(out, is_result_file)
        # The result replaces the folder: never one that holds anything but an earlier result.
        if out.is_dir() and any(out.iterdir()) and not (out / result_file).is_file():
            raise InputError(
                f"The output folder '{out}' holds files that are not a result; choose a new or "
                "empty folder."
            )
        yield partial
    finally:
        if has_checkpoint(partial):
            if os.name != "nt":
                (partial / LOCK).unlink(missing_ok=True)
        else:
            remove_partial(partial)
        lock.release()
        if os.name == "nt":
            _after_release(partial)
        _remove_empty(missing)


def _locked(out: Path) -> tuple[Path, FileLock]:
    """The partial folder of ``out``, and its lock, held.

    Raises InputError when somebody else holds it.
    """
    for _ in range(TRIES):
        # Another run that ends may take lock and folder away at any moment before the lock is held.
        with suppress(FileNotFoundError, FileExistsError):
            partial = make_partial(out)
            lock = FileLock(partial / LOCK, timeout=0)
            try:
                lock.acquire()
            except Timeout:
                if not (partial / LOCK).exists():
                    continue
                raise InputError(
                    f"Another fit is writing into '{out}'; wait until it is done, or choose "
                    "another --out."
                ) from None
            try:
                mark_partial(partial)
            except BaseException:
                (partial / LOCK).unlink(missing_ok=True)
                lock.release()
                raise
            return partial, lock
    raise OSError(f"'{partial_folder(out)}' comes and goes")


def _after_release(partial: Path) -> None:
    """Windows removes no file that is open, a lock among them."""
    with suppress(OSError):
        (partial / LOCK).unlink(missing_ok=True)
        if not has_checkpoint(partial):
            partial.rmdir()


def _remove_empty(folders: list[Path]) -> None:
    """Those that this run made and put nothing into, the deepest first."""
    with suppress(OSError):
        for folder in folders:
            folder.rmdir()

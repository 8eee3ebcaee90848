"""Files and folders that appear whole or not at all."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TypeVar

from facestage.contract.errors import InputError
from facestage.contract.files.durable import exchange, sync_file, sync_folder, sync_tree
from facestage.contract.files.temporaries import (
    RETIRED,
    Ours,
    being_replaced,
    dispose,
    everything,
    new_file,
    new_folder,
    sweep,
    under_construction,
)

T = TypeVar("T")
# How often, and after how many seconds, a folder is read again that was replaced meanwhile.
READ_TRIES, READ_PAUSE = 40, 0.02


@contextmanager
def atomic_folder(target: Path, ours: Ours = everything) -> Iterator[Path]:
    """Yield an empty folder beside ``target`` that replaces it when the block succeeds.

    A reader sees the old folder or the new one, never half of one, and after a power cut the disk
    has one of them. On an exception the new folder is removed and ``target`` stays as it was. Files
    of the old folder that are not ``ours`` go over to the new one. What killed writers of
    ``target`` left behind is removed first.
    """
    target = Path(os.path.realpath(target))
    with _told(f"the folder '{target}'", "choose an output folder that you may write to"):
        target.parent.mkdir(parents=True, exist_ok=True)
        sweep(target, ours)
        content, mark = new_folder(target)
    try:
        yield content
        with _told(f"the folder '{target}'", "make room, close what uses it, and try again"):
            sync_tree(content)
            _put(content, target)
    finally:
        mark.let_go()
        dispose(content.parent, target, ours)


@contextmanager
def atomic_file(target: Path) -> Iterator[Path]:
    """Yield a temporary path with ``target``'s suffix that is renamed to ``target`` on success."""
    target = Path(target)
    if target.is_dir():
        raise InputError(f"Cannot write '{target}': it is a folder; choose the name of a file.")
    with _told(f"'{target}'", "choose a folder that you may write to"):
        target.parent.mkdir(parents=True, exist_ok=True)
        sweep(target)
        temporary = new_file(target)
    try:
        yield temporary.path
        with _told(f"'{target}'", "make room, close what uses it, and try again"):
            # What is within a folder under construction is waited for with all of it.
            alone = not under_construction(target)
            if alone:
                sync_file(temporary.path)
            temporary.let_go()
            os.replace(temporary.path, target)
            if alone:
                sync_folder(target.parent)
    except BaseException:
        temporary.let_go()
        temporary.path.unlink(missing_ok=True)
        raise


def read_consistently(folder: Path, read: Callable[[Path], T]) -> T:
    """``read(folder)``, again if the folder was replaced meanwhile, so that no answer mixes two of
    them.
    """
    for _ in range(READ_TRIES):
        before = _identity(folder)
        if before is None and being_replaced(folder):
            time.sleep(READ_PAUSE)
            continue
        try:
            found = read(folder)
        except (InputError, OSError):
            if _identity(folder) == before:
                raise
        else:
            if _identity(folder) == before:
                return found
        time.sleep(READ_PAUSE)
    if _identity(folder) is None:
        return read(folder)
    raise InputError(
        f"The folder '{folder}' is replaced again and again; read it when its writer has finished."
    )


def _put(content: Path, target: Path) -> None:
    """Let ``content`` be ``target``; what was there before ends as RETIRED beside ``content``."""
    if not os.path.lexists(target):
        content.rename(target)
    else:
        retired = content.with_name(RETIRED)
        # What is retired is looked through for the user's files, what is under construction is not.
        content.rename(retired)
        if not exchange(retired, target):
            retired.rename(content)
            _put_in_two_steps(content, target, retired)
    sync_folder(target.parent)


def _put_in_two_steps(content: Path, target: Path, retired: Path) -> None:
    """For a moment ``target`` is missing; a run that finds it so puts back what is retired."""
    target.rename(retired)
    try:
        content.rename(target)
    except OSError:
        retired.rename(target)
        raise


def _identity(folder: Path) -> tuple[int, ...] | None:
    """Differs between two folders of one path, and before and after a file came or went; None
    without a folder.
    """
    with suppress(OSError):
        status = folder.stat()
        return status.st_dev, status.st_ino, status.st_mtime_ns
    return None


@contextmanager
def _told(what: str, advice: str) -> Iterator[None]:
    """Turn the system's errors into one sentence."""
    try:
        yield
    except OSError as error:
        raise InputError(f"Cannot write {what}: {error.strerror or error}; {advice}.") from error

"""Files and folders under construction: marked as Facestage's, held while somebody writes, else
swept away.

Beside ``NAME`` a file under construction is ``.facestage-new-HASH-RANDOM.SUFFIX``, and a folder the
subfolder ``content`` of ``.facestage-new-HASH-RANDOM``, which holds the mark MARK; what it replaces
becomes the subfolder ``retired``. HASH is that of NAME. Whoever writes keeps a lock on the file, or
on the mark, which the system takes back when the process ends, however it ends. What has such a
name and no lock was left behind.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import secrets
import shutil
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path, PurePath

# On Windows others can neither rename nor remove a file that is open, which is all the lock that it
# takes.
if sys.platform != "win32":
    import fcntl

PREFIX = ".facestage-new-"
MARK = ".facestage-temporary.json"
CONTENT, RETIRED = "content", "retired"
SCHEMA = {"facestage": "temporary folder", "schema": 1}
TRIES = 100

# Whether Facestage writes a file of this path, relative to the folder that is replaced.
Ours = Callable[[PurePath], bool]


def everything(_path: PurePath) -> bool:
    """The folder is Facestage's with all that is in it."""
    return True


@dataclass
class Temporary:
    """A file under construction, or the mark of a folder; ``handle`` holds its lock."""

    path: Path
    handle: int

    @classmethod
    def create(cls, path: Path) -> Temporary | None:
        """A new empty file, held; None when somebody swept it away before it was."""
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
        with suppress(OSError):
            if _lock(handle) is not False and os.path.samestat(os.fstat(handle), path.stat()):
                return cls(path, handle)
        os.close(handle)
        path.unlink(missing_ok=True)
        return None

    def let_go(self) -> None:
        """Give up the lock."""
        if self.handle >= 0:
            os.close(self.handle)
            self.handle = -1


def new_file(target: Path) -> Temporary:
    """An empty file beside ``target``, with its suffix, held until it is let go."""
    for _ in range(TRIES):
        with suppress(FileExistsError):
            found = Temporary.create(_free_path(target, target.suffix))
            if found is not None:
                return found
    raise OSError(f"no name is free beside {target}")


def new_folder(target: Path) -> tuple[Path, Temporary]:
    """An empty folder to fill, in a marked one beside ``target``, and the mark, held until it is
    let go.
    """
    for _ in range(TRIES):
        folder = _free_path(target)
        with suppress(FileExistsError, FileNotFoundError):
            folder.mkdir()
            mark = Temporary.create(folder / MARK)
            if mark is not None:
                os.write(mark.handle, json.dumps(SCHEMA).encode())
                (folder / CONTENT).mkdir()
                return folder / CONTENT, mark
    raise OSError(f"no name is free beside {target}")


def sweep(target: Path, ours: Ours = everything) -> None:
    """Remove what killed writers of ``target`` left beside it.

    A folder that had been moved aside and was not replaced goes back to its place; see
    :func:`dispose` for files that are not ``ours``.
    """
    pattern = f"{PREFIX}{_hash(target)}-"
    with suppress(OSError):
        for entry in list(os.scandir(target.parent)):
            if entry.name.startswith(pattern):
                path = Path(entry.path)
                if entry.is_dir(follow_symlinks=False):
                    _sweep_folder(path, target, ours)
                elif entry.is_file(follow_symlinks=False):
                    _sweep_file(path)


def under_construction(path: Path) -> bool:
    """Whether a path lies in a folder that :func:`new_folder` made."""
    return any(part.startswith(PREFIX) for part in path.parts[:-1])


def being_replaced(target: Path) -> bool:
    """Whether a writer, alive or not, has something beside ``target``."""
    with suppress(OSError):
        return any(True for _ in target.parent.glob(f"{PREFIX}{_hash(target)}-*"))
    return False


def dispose(workshop: Path, target: Path, ours: Ours) -> None:
    """Remove a marked folder; retired files that are not ``ours`` first go to the same place within
    ``target``.

    Where one cannot go there, everything stays for the next time.
    """
    with suppress(OSError):
        if ours is not everything:
            _bring_back(workshop / RETIRED, target, ours)
        for name in (CONTENT, RETIRED):
            shutil.rmtree(workshop / name, ignore_errors=True)
        # Last, so that what is left is still known as ours.
        (workshop / MARK).unlink(missing_ok=True)
        workshop.rmdir()


def _bring_back(old: Path, target: Path, ours: Ours) -> None:
    """Move what is not ``ours`` from ``old`` to ``target``.

    Raises OSError when something there has its name.
    """
    for parent, folders, files in os.walk(old):
        links = [name for name in folders if Path(parent, name).is_symlink()]
        for name in (*files, *links):
            path = Path(parent, name)
            relative = path.relative_to(old)
            if name.startswith(PREFIX) or ours(relative):
                continue
            place = target / relative
            if os.path.lexists(place):
                raise FileExistsError(str(place))
            place.parent.mkdir(parents=True, exist_ok=True)
            path.rename(place)


def _sweep_folder(workshop: Path, target: Path, ours: Ours) -> None:
    mark = workshop / MARK
    if not mark.is_file():
        # Killed before it was marked; one that holds anything stays.
        with suppress(OSError):
            workshop.rmdir()
        return
    handle = _abandoned(mark)
    if handle is None:
        return
    try:
        if (workshop / RETIRED).is_dir() and not os.path.lexists(target):
            (workshop / RETIRED).rename(target)
    finally:
        os.close(handle)
    dispose(workshop, target, ours)


def _sweep_file(path: Path) -> None:
    handle = _abandoned(path)
    if handle is not None:
        os.close(handle)
        with suppress(OSError):
            path.unlink()


def _abandoned(path: Path) -> int | None:
    """An open handle of a file that nobody holds; None when somebody does, when none can tell, or
    when it is gone.
    """
    with suppress(OSError):
        if sys.platform == "win32":
            aside = path.with_name(f"{path.name}.swept")
            path.rename(aside)
            aside.rename(path)
        handle = os.open(path, os.O_RDWR)
        if _lock(handle):
            return handle
        os.close(handle)
    return None


def _lock(handle: int) -> bool | None:
    """Whether the file could be locked; None where the file system has no locks."""
    if sys.platform == "win32":
        return True
    else:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            return False if error.errno in (errno.EAGAIN, errno.EACCES, errno.EWOULDBLOCK) else None
        return True


def _free_path(target: Path, suffix: str = "") -> Path:
    return target.with_name(f"{PREFIX}{_hash(target)}-{secrets.token_hex(6)}{suffix}")


def _hash(target: Path) -> str:
    """Of any name the same few characters, however long it is."""
    return hashlib.sha256(os.fsencode(target.name)).hexdigest()[:12]

"""What is written reaches the disk before it takes another's place, and takes it in one step."""

from __future__ import annotations

import ctypes
import errno
import functools
import os
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

SYNCED_AT_ONCE = 8
# Linux' renameat2 and macOS' renamex_np: "exchange the two names". The flag happens to be the same.
_EXCHANGE, _CURRENT_FOLDER = 2, -100
# What a kernel or a file system says that does not know how to exchange.
_UNKNOWN = (errno.ENOSYS, errno.EINVAL, errno.ENOTSUP, errno.EOPNOTSUPP, errno.EPERM)


def sync_file(path: Path) -> None:
    """Wait until the file's content is on the disk.

    Raises OSError when it does not get there, as on a full disk.
    """
    handle = os.open(path, os.O_RDWR | getattr(os, "O_BINARY", 0))
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def sync_folder(path: Path) -> None:
    """Wait until the folder's names are on the disk, where a system lets one ask for that."""
    if os.name == "nt":
        return
    with suppress(OSError):
        handle = os.open(path, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def sync_tree(folder: Path) -> None:
    """Every file and folder within ``folder``, and itself. Raises OSError as :func:`sync_file`."""
    folders, files = [], []
    for parent, _, names in os.walk(folder):
        folders.append(Path(parent))
        files += [path for path in (Path(parent, name) for name in names) if not path.is_symlink()]
    # A disk that is asked for many files at once writes them in one go.
    with ThreadPoolExecutor(SYNCED_AT_ONCE) as pool:
        list(pool.map(sync_file, files))
    for path in reversed(folders):
        sync_folder(path)


def exchange(one: Path, other: Path) -> bool:
    """Let two existing names trade places in one step; False where the system cannot, and nothing
    has changed.
    """
    call = _exchange_call()
    if call is None:
        return False
    if call(os.fsencode(one), os.fsencode(other)) == 0:
        return True
    number = ctypes.get_errno()
    if number in _UNKNOWN:
        return False
    raise OSError(number, os.strerror(number), str(other))


@functools.cache
def _exchange_call() -> Callable[[bytes, bytes], int] | None:
    """The C library's way to exchange two names, if it has one."""
    if os.name == "nt":
        return None
    library = ctypes.CDLL(None, use_errno=True)
    try:
        if sys.platform == "darwin":
            renamex = library.renamex_np
            renamex.argtypes = (ctypes.c_char_p, ctypes.c_char_p, ctypes.c_uint)
            return lambda one, other: int(renamex(one, other, _EXCHANGE))
        renameat2 = library.renameat2
    except AttributeError:
        return None
    renameat2.argtypes = (
        ctypes.c_int,
        ctypes.c_char_p,
        ctypes.c_int,
        ctypes.c_char_p,
        ctypes.c_uint,
    )
    return lambda one, other: int(
        renameat2(_CURRENT_FOLDER, one, _CURRENT_FOLDER, other, _EXCHANGE)
    )

"""The bytes of a file that somebody gave, never more than are wanted, never from what only looks
like a file.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import BinaryIO

from facestage.contract.errors import InputError
from facestage.contract.wording import whole_bytes

KIB, MIB, GIB = 2**10, 2**20, 2**30


def open_regular(path: Path, what: str, limit: int) -> BinaryIO:
    """The open file ``path``, checked to be a regular file of at most ``limit`` bytes.

    A pipe or a device would hang or never end: it is refused unread. ``what`` names the file's role
    in messages. Raises InputError for anything but such a file.
    """
    try:
        # Without O_NONBLOCK, opening a pipe waits for somebody who writes into it.
        flags = (
            os.O_RDONLY
            | getattr(os, "O_NONBLOCK", 0)
            | getattr(os, "O_BINARY", 0)
            | getattr(os, "O_CLOEXEC", 0)
        )
        handle = os.open(path, flags)
    except FileNotFoundError as error:
        raise InputError(f"The {what} '{path}' does not exist; check the path.") from error
    # A path with a null character in it is a ValueError.
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(
            f"The {what} '{path}' cannot be read: {reason}; check the path."
        ) from error
    try:
        status = os.fstat(handle)
        if not stat.S_ISREG(status.st_mode):
            kind = "a folder" if stat.S_ISDIR(status.st_mode) else "a pipe or a device"
            raise InputError(f"The {what} '{path}' is {kind}, expected a file.")
        if status.st_size > limit:
            raise InputError(
                f"The {what} '{path}' has {whole_bytes(status.st_size)}, expected at most "
                f"{whole_bytes(limit)}; is it the right file?"
            )
        return os.fdopen(handle, "rb")
    except BaseException:
        os.close(handle)
        raise


def read_bytes(path: Path, what: str, limit: int) -> bytes:
    """All bytes of ``path``; see :func:`open_regular`.

    Raises InputError when there are more than ``limit``.
    """
    with open_regular(path, what, limit) as stream:
        # Python reserves what it is asked for, so that is no more than there is.
        limit = min(limit, os.fstat(stream.fileno()).st_size)
        try:
            content = stream.read(limit + 1)
        except OSError as error:
            raise InputError(
                f"The {what} '{path}' cannot be read: {error.strerror or error}."
            ) from error
    if len(content) > limit:
        raise InputError(
            f"The {what} '{path}' grows while it is read; expected at most {whole_bytes(limit)}."
        )
    return content

"""Paths as users write them, checked before the system is asked about them."""

from __future__ import annotations

import errno
import sys
from pathlib import Path

from facestage.contract.errors import InputError
from facestage.contract.wording import quoted

PATH_MAX = 4096  # characters; Linux takes no more


def user_path(text: str | Path, what: str) -> Path:
    """The path that a user wrote, its ``~`` expanded; ``what`` names its role in messages.

    Raises InputError for what can be no path of this machine: too long, with a null character, or
    in the home of a user that there is not. Whether it exists is not asked.
    """
    text = str(text)
    if not text:
        raise InputError(f"The {what} is empty; give a path.")
    if "\0" in text:
        raise InputError(
            f"The {what} {quoted(text)} holds a null character, which no path can have; correct it."
        )
    if len(text) > PATH_MAX:
        raise InputError(
            f"The {what} is {len(text)} characters long, a path has at most {PATH_MAX}; correct it."
        )
    try:
        path = Path(text).expanduser()
    except RuntimeError as error:
        raise InputError(
            f"The {what} {quoted(text)} begins with the home of a user that this machine does not "
            "know; write the whole path."
        ) from error
    try:
        path.lstat()
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            raise InputError(
                f"The {what} {quoted(text)} has a longer name than this system takes."
            ) from error
    except ValueError as error:
        # Characters that the file system's encoding lacks.
        raise InputError(
            f"The {what} {quoted(text)} cannot be written in {sys.getfilesystemencoding()}."
        ) from error
    return path


def is_folder(path: Path) -> bool:
    """Whether the path is a folder that can be looked at; no path makes this fail."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


def is_file(path: Path) -> bool:
    """Whether the path is a regular file that can be looked at; no path makes this fail."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False

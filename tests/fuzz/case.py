"""One input: files by name, and how they are laid into a folder and kept as a regression."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

Case = dict[str, bytes]
# What a name may end in when it stands for something that only looks like a file.
FIFO, ENDLESS, FOLDER, LOOP = "#fifo", "#endless", "#folder", "#loop"
SPECIAL = (FIFO, ENDLESS, FOLDER, LOOP)


def lay_out(case: Case, folder: Path) -> None:
    """Write ``case`` into ``folder``, which is emptied before."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for name, content in case.items():
        path = folder / name
        special = next((mark for mark in SPECIAL if name.endswith(mark)), None)
        path.parent.mkdir(parents=True, exist_ok=True)
        if special is None:
            path.write_bytes(content)
            continue
        path = path.with_name(path.name.removesuffix(special))
        if special == FIFO:
            os.mkfifo(path)
        elif special == ENDLESS:
            path.symlink_to("/dev/zero")
        elif special == FOLDER:
            path.mkdir()
        else:
            path.symlink_to(path.name)


def read_back(folder: Path) -> Case:
    """The case that :func:`keep` wrote into ``folder``."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def keep(case: Case, folder: Path) -> None:
    """Write ``case`` as plain files; what stands for something else is an empty file of its marked
    name.
    """
    shutil.rmtree(folder, ignore_errors=True)
    for name, content in case.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)


def size_of(case: Case) -> int:
    return sum(len(name) + len(content) for name, content in case.items())

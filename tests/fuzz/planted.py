"""Readers with every fault that the fuzzer must find, for the tests of the fuzzer itself."""

from __future__ import annotations

import ctypes
import os
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

from facestage.contract.errors import InputError
from fuzz.case import Case
from fuzz.target import Target


def _seeds() -> list[Case]:
    return [{"a.bin": bytes(range(64))}]


def _fine(_folder: Path) -> None:
    return


def _refuses(folder: Path) -> None:
    raise InputError(f"The file '{folder}' is refused; give another.")


def _traceback(folder: Path) -> None:
    # Only for some inputs, so that there is something to shrink.
    if b"\xff" in (folder / "a.bin").read_bytes():
        raise KeyError("no error of the project's")


def _two_lines(_folder: Path) -> None:
    raise ValueError("One line.\nAnother.")


def _crash(_folder: Path) -> None:
    ctypes.string_at(0)


def _hang(_folder: Path) -> None:
    time.sleep(600)


def _spin(_folder: Path) -> None:
    while True:
        pass


def _leave(_folder: Path) -> None:
    os._exit(0)


def _asks(_folder: Path) -> None:
    np.ones(3 << 28)


def _talks(_folder: Path) -> None:
    os.write(2, b"libpng error: not for the user\n")


def _warns(_folder: Path) -> None:
    warnings.warn("overflow", RuntimeWarning, stacklevel=1)


_FAULTS: dict[str, tuple[Callable[[Path], None], str]] = {
    "fine": (_fine, ""),
    "refuses": (_refuses, ""),
    "traceback": (_traceback, "KeyError"),
    "two-lines": (_two_lines, "sentence"),
    "crash": (_crash, "SIGSEGV"),
    "hang": (_hang, "hang"),
    "spin": (_spin, "hang"),
    "leave": (_leave, "exit code 0"),
    "asks": (_asks, "MemoryError"),
    "talks": (_talks, "noise"),
    "warns": (_warns, "warning"),
}
TARGETS = {
    name: Target(name, (), _seeds, read, 1, (ValueError,), warm=False)
    for name, (read, _) in _FAULTS.items()
}
KINDS = {name: kind for name, (_, kind) in _FAULTS.items()}

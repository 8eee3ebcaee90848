"""The arrays of a file whose reader may crash, read in a child process that may die.

The readers of MATLAB's and of HDF5's files are C that damaged files crash or send into endless
loops. In a child they end as one sentence. The child may not take more memory and time than it is
given; what it answers is a line of JSON and the arrays' bytes, whose types and sizes are checked:
nothing that comes from it is executed.
"""

from __future__ import annotations

import importlib
import json
import math
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.files.reading import GIB, MIB
from facestage.system.child import python_code

# Of the answer's first line, and of what an error of a library may say.
_LINE_BYTES, _REASON_LETTERS = 1 * MIB, 300
_PLAIN_TYPE = re.compile(r"[<|][iufb][1248]")
# The child may wait for the disk or for other processes: only then does it take longer than its
# processor time.
_PATIENCE = 20.0
_START = "import sys; from facestage.system.in_child import main; main(sys.argv[1:])"
# One thread, because each reserves memory; no plugins, which would be foreign code.
_SURROUNDINGS = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "HDF5_PLUGIN_PRELOAD": "::"}

Reader = Callable[[Path, Sequence[str]], Mapping[str, np.ndarray]]


class ReaderFailedError(Exception):
    """The child could not read the file; the message is a clause that says why."""


@dataclass(frozen=True)
class ChildLimits:
    """What a reader may take, and what may come back from it."""

    memory: int  # bytes of address space
    seconds: int  # of processor time, whatever the file's size
    array_bytes: int  # all arrays together

    def seconds_for(self, size: int) -> int:
        """Processor time for a file of ``size`` bytes; the slowest readers take 20 MB a second."""
        return self.seconds + size // (16 * MIB)


def read_in_child(
    reader: Reader, path: Path, names: Sequence[str], limits: ChildLimits
) -> dict[str, np.ndarray]:
    """What ``reader(path, names)`` returns: arrays of numbers by name.

    ``reader`` is a module's own function. Raises InputError when it does, ReaderFailedError for any
    other end.
    """
    path = Path(path).resolve()
    seconds = limits.seconds_for(path.stat().st_size)
    command = python_code(
        _START,
        reader.__module__,
        reader.__qualname__,
        str(limits.memory),
        str(seconds),
        str(path),
        *names,
    )
    with subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**os.environ, **_SURROUNDINGS},
    ) as child:
        watchdog = threading.Timer(_PATIENCE * seconds, child.kill)
        watchdog.daemon = True
        watchdog.start()
        try:
            assert child.stdout is not None
            arrays = _answer(child.stdout, limits.array_bytes)
            if arrays is None:
                # Its ending says why; to kill it first would hide that.
                child.wait()
        finally:
            watchdog.cancel()
            child.kill()
    if arrays is None:
        raise ReaderFailedError(_ending(child.returncode, seconds))
    return arrays


def _answer(stream: IO[bytes], limit: int) -> dict[str, np.ndarray] | None:
    """The arrays that the child sent; None when it ended before its answer did."""
    line = stream.readline(_LINE_BYTES)
    if not line.endswith(b"\n"):
        return None
    try:
        head = json.loads(line)
        if "refused" in head:
            raise InputError(_plain(head["refused"]))
        if "failed" in head:
            raise ReaderFailedError(_plain(head["failed"]))
        described = [
            (str(name), str(kind), tuple(map(int, shape))) for name, kind, shape in head["arrays"]
        ]
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise ReaderFailedError("what reads it gave no sensible answer") from error
    total = 0
    for _, kind, shape in described:
        if not _PLAIN_TYPE.fullmatch(kind) or min(shape, default=0) < 0 or len(shape) > 8:
            raise ReaderFailedError("what reads it gave no sensible answer")
        total += math.prod(shape) * np.dtype(kind).itemsize
    if total > limit:
        raise ReaderFailedError(
            f"its arrays have {total / MIB:.0f} MiB, expected at most {limit / MIB:.0f} MiB"
        )
    arrays = {}
    for name, kind, shape in described:
        array = np.empty(shape, kind)
        if array.nbytes and not _fill(stream, memoryview(array.reshape(-1).view(np.uint8).data)):
            return None
        arrays[name] = array.astype(array.dtype.newbyteorder("="), copy=False)
    return arrays


def _fill(stream: IO[bytes], target: memoryview) -> bool:
    while len(target):
        count = stream.readinto(target)  # type: ignore[attr-defined]
        if not count:
            return False
        target = target[count:]
    return True


def _ending(code: int, seconds: int) -> str:
    if -code in (getattr(signal, "SIGXCPU", None), getattr(signal, "SIGKILL", None)):
        return f"reading it takes more than {seconds} s, or more memory than there is"
    if code < 0:
        return f"it is damaged so that what reads it crashes ({signal.Signals(-code).name})"
    return f"what reads it ended with code {code}"


def _plain(text: Any) -> str:
    return " ".join(
        "".join(letter if letter.isprintable() else " " for letter in str(text)).split()
    )


def main(arguments: Sequence[str]) -> None:
    """The child's part: read, and write the answer on what was standard output."""
    module, function, memory, seconds, path, *names = arguments
    with os.fdopen(os.dup(1), "wb") as answer:
        # What a library prints is no part of the answer.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        _limit(int(memory), int(seconds))
        head, arrays = _read(module, function, Path(path), names, int(memory))
        answer.write(json.dumps(head).encode() + b"\n")
        for array in arrays:
            answer.write(memoryview(array.reshape(-1).view(np.uint8).data))


def _read(
    module: str, function: str, path: Path, names: Sequence[str], memory: int
) -> tuple[dict[str, Any], list[np.ndarray]]:
    try:
        found = getattr(importlib.import_module(module), function)(path, names)
        arrays = {
            name: np.ascontiguousarray(array, array.dtype.newbyteorder("<")).reshape(array.shape)
            for name, array in found.items()
        }
    except InputError as error:
        return {"refused": str(error)}, []
    except MemoryError:
        return {"failed": f"it asks for more than {memory / GIB:.3g} GiB of memory"}, []
    # A damaged file makes the libraries raise almost anything.
    except Exception as error:  # noqa: BLE001
        reason = " ".join(str(error).split()).rstrip(".")[:_REASON_LETTERS]
        return {"failed": reason or type(error).__name__}, []
    return {
        "arrays": [[name, array.dtype.str, array.shape] for name, array in arrays.items()]
    }, list(arrays.values())


def _limit(memory: int, seconds: int) -> None:
    """Keep this process within its memory and time, and let it leave no core file, where the system
    can do that.
    """
    if sys.platform == "win32":
        return
    import resource

    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
    # macOS refuses a limit below what the process has mapped already.
    if sys.platform == "linux":
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))

"""The parent's side of a worker: starts it, listens, and ends it when it hangs; what it died of
becomes a finding.
"""

from __future__ import annotations

import contextlib
import json
import os
import pickle
import re
import selectors
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fuzz.case import Case
from fuzz.worker import FINDING, TABLE

TESTS = Path(__file__).resolve().parent.parent
SECONDS = 5.0  # of an input: of processor time, or of waiting without any
PATIENCE = 60.0  # of an input on a machine that is busy with other things
IDLE = 0.3  # processor seconds in SECONDS below which a process waits for something
START_SECONDS = 180.0  # imports, and seeds that are made


@dataclass(frozen=True)
class Outcome:
    """What came of one input."""

    target: str
    seed: int
    number: int
    verdict: str
    kind: str = ""
    where: str = ""
    text: str = ""
    ms: float = 0.0
    mib: float = 0.0

    @property
    def signature(self) -> tuple[str, str, str]:
        """The same for findings of one cause."""
        return self.target, self.kind, re.sub(r"\d+", "#", self.where)


class Hand:
    """One worker process, started again whenever it is gone."""

    def __init__(self, home: Path, table: str = TABLE, seconds: float = SECONDS) -> None:
        """``table``: the module whose TARGETS are read; ``seconds`` that an input may take."""
        self.table, self.seconds = table, seconds
        self.home, self.seeds = home / f"worker-{os.urandom(4).hex()}", home / "seeds"
        self.home.mkdir(parents=True)
        self.seeds.mkdir(exist_ok=True)
        self.child: subprocess.Popen[bytes] | None = None
        self.pending = b""

    def run(self, target: str, seed: int, numbers: Sequence[int]) -> Iterator[Outcome]:
        """Read these inputs; the process is replaced after each that it did not survive."""
        left = list(numbers)
        while left:
            for outcome in self._ordered(
                {"target": target, "seed": seed, "numbers": left}, target, seed, left[0]
            ):
                left = left[left.index(outcome.number) + 1 :]
                yield outcome

    def read_folder(self, target: str, folder: Path) -> Outcome:
        """Read the input that lies in ``folder``."""
        return next(
            iter(list(self._ordered({"target": target, "folder": str(folder)}, target, 0, 0)))
        )

    def stop(self) -> None:
        if self.child is not None:
            _end(self.child)
            self.child = None
        shutil.rmtree(self.home, ignore_errors=True)

    def _ordered(
        self, order: dict[str, Any], target: str, seed: int, first: int
    ) -> Iterator[Outcome]:
        """Answers until the order is done or the worker is gone; the input that it was at is the
        last finding.
        """
        child = self.child or self._start()
        assert child.stdin is not None
        child.stdin.write(json.dumps(order).encode() + b"\n")
        child.stdin.flush()
        numbers = iter([*order.get("numbers", [first])][1:])
        number: int | None = first
        for answer in self._answers(child):
            if "end" in answer:
                return
            if "ready" in answer:
                continue
            if "number" in answer:
                yield Outcome(target, seed, **answer)
                number = next(numbers, None)
                continue
            self.child = None
            if number is not None:
                yield Outcome(
                    target,
                    seed,
                    number,
                    FINDING,
                    answer["kind"],
                    answer["where"],
                    answer["text"],
                    answer["ms"],
                )
            return

    def _start(self) -> subprocess.Popen[bytes]:
        one_thread = dict.fromkeys(
            ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"
        )
        environment = {
            **os.environ,
            **one_thread,
            "PYTHONPATH": str(TESTS),
            "PYTHONHASHSEED": "0",
            "PYTHONWARNINGS": "",
            "FACESTAGE_CACHE": str(self.home / "cache"),
            "TMPDIR": str(self.home),
            "HOME": str(self.home),
        }
        self.pending = b""
        self.child = subprocess.Popen(
            [sys.executable, "-m", "fuzz.worker", str(self.home), str(self.seeds), self.table],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment,
            cwd=self.home,
            start_new_session=True,
        )
        return self.child

    def _answers(self, child: subprocess.Popen[bytes]) -> Iterator[dict[str, Any]]:
        """The lines that the worker writes; of one that hangs or dies, a last one that says so."""
        assert child.stdout is not None
        selector = selectors.DefaultSelector()
        selector.register(child.stdout, selectors.EVENT_READ)
        since, used, heard = time.monotonic(), _processor_seconds(child.pid), False
        while True:
            if selector.select(0.2):
                chunk = os.read(child.stdout.fileno(), 1 << 16)
                if not chunk:
                    code = child.wait()
                    _end(child)
                    yield self._died(
                        f"exit code {code}" if code >= 0 else signal.Signals(-code).name
                    )
                    return
                *lines, self.pending = (self.pending + chunk).split(b"\n")
                for line in lines:
                    yield json.loads(line)
                since, used, heard = time.monotonic(), _processor_seconds(child.pid), True
                continue
            waited, spent = time.monotonic() - since, _processor_seconds(child.pid) - used
            limit = self.seconds if heard else START_SECONDS
            if spent > limit or waited > max(PATIENCE, limit) or (waited > limit and spent < IDLE):
                child.send_signal(signal.SIGUSR1)
                time.sleep(0.3)
                _end(child)
                yield self._died("hang") | {"ms": 1e3 * spent}
                return

    def _died(self, kind: str) -> dict[str, Any]:
        """What the interpreter printed of where it was."""
        noise = self.home / "noise"
        text = noise.read_text(errors="replace")[-4000:] if noise.is_file() else ""
        frames = re.findall(r'File "([^"]+)", line \d+ in (\S+)', text)
        own = [f"{Path(file).name}:{name}" for file, name in frames if "/facestage/" in file]
        inner = [f"{Path(file).name}:{name}" for file, name in frames[:1]]
        return {"kind": kind, "where": " > ".join([*own[:1], *inner]), "text": text, "ms": 0.0}


def _end(child: subprocess.Popen[bytes]) -> None:
    """End the worker and whatever it started."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child.pid, signal.SIGKILL)
    child.wait()
    for stream in (child.stdin, child.stdout):
        if stream is not None:
            try:
                stream.close()
            except BrokenPipeError:
                continue


def _processor_seconds(leader: int) -> float:
    """User and system time of the processes of a session, and of those of them that ended."""
    ticks = 0
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[3]) == leader:
            ticks += sum(map(int, fields[11:15]))
    return ticks / os.sysconf("SC_CLK_TCK")


def stored_seeds(home: Path, target: str) -> list[Case]:
    """The seeds that a worker has made under ``home``."""
    made: list[Case] = pickle.loads((home / "seeds" / f"{target}.pickle").read_bytes())
    return made


def work_folder() -> Path:
    return Path(tempfile.mkdtemp(prefix="facestage-fuzz-"))

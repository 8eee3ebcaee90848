"""The process that reads damaged inputs, and may die of one: told by lines of JSON what to read,
answers with such.

In:  {"target", "seed", "numbers": [...]}, or {"target", "folder"} for an input that lies in a
folder.
Out: one line for each input: {"number", "verdict", "kind", "where", "text", "ms", "mib"}; then
{"end": true}.
"""

from __future__ import annotations

import contextlib
import faulthandler
import importlib
import json
import os
import pickle
import re
import resource
import signal
import sys
import time
import traceback
import unicodedata
import warnings
from pathlib import Path
from typing import Any

from fuzz.case import Case, lay_out, read_back

ACCEPTED, REFUSED, FINDING, SKIPPED = "accepted", "refused", "finding", "skipped"
TABLE = "fuzz.targets"
MEMORY_LIMIT = 2 << 30
SENTENCE_LIMIT = 2000
FILE_LIMIT = 1 << 30
WARM_UP = 2


class Worker:
    """``home`` holds this worker's folder of the input, and what is printed where nobody should
    print.
    """

    def __init__(self, home: Path, seeds: Path, targets: dict[str, Any]) -> None:
        self.home, self.seeds_folder, self.targets = home, seeds, targets
        self.answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
        self.noise = os.open(home / "noise", os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND)
        os.dup2(self.noise, 1)
        os.dup2(self.noise, 2)
        faulthandler.enable(self.noise, all_threads=False)
        faulthandler.register(signal.SIGUSR1, self.noise, all_threads=False)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_FSIZE, (FILE_LIMIT, FILE_LIMIT))
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        self.loaded: dict[str, list[Case]] = {}

    def serve(self) -> None:
        for line in sys.stdin:
            order = json.loads(line)
            target = self.targets[order["target"]]
            seeds = self.seeds(target)
            self.say({"ready": True})
            if "folder" in order:
                self.answer(target, read_back(Path(order["folder"])), 0)
            else:
                for number in order["numbers"]:
                    case = target.case(seeds, order["seed"], number)
                    self.answer(target, case, number)
            self.say({"end": True})

    def say(self, answer: dict[str, Any]) -> None:
        self.answers.write(json.dumps(answer) + "\n")
        self.answers.flush()

    def seeds(self, target: Any) -> list[Case]:
        """The target's seeds, made by whoever needs them first; the first ones are read, so that
        imports are done.
        """
        if target.name not in self.loaded:
            path = self.seeds_folder / f"{target.name}.pickle"
            if path.is_file():
                made: list[Case] = pickle.loads(path.read_bytes())
            else:
                made = target.seeds()
                temporary = self.home / "seeds"
                temporary.write_bytes(pickle.dumps(made))
                os.replace(temporary, path)
            self.loaded[target.name] = made
            if target.warm:
                for case in made[:WARM_UP]:
                    self.read(target, case, limited=False)
        return self.loaded[target.name]

    def answer(self, target: Any, case: Case | None, number: int) -> None:
        if case is None:
            self.say({"number": number, "verdict": SKIPPED, "ms": 0, "mib": 0})
            return
        self.say({"number": number} | self.read(target, case))

    def read(self, target: Any, case: Case, limited: bool = True) -> dict[str, Any]:
        """Lay ``case`` out, read it within the limits, and judge."""
        folder = self.home / "input"
        lay_out(case, folder)
        os.ftruncate(self.noise, 0)
        before = _reset_peak()
        if limited:
            _limit(_status("VmSize") + MEMORY_LIMIT)
        start = time.process_time()
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            verdict = _judged(target, folder)
        milliseconds = 1e3 * (time.process_time() - start)
        _limit(resource.RLIM_INFINITY)
        mebibytes = max(_status("VmHWM") - before, 0) / 2**20
        children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
        sys.stdout.flush()
        sys.stderr.flush()
        noise = os.pread(self.noise, 400, 0).decode("utf-8", "replace")
        shown = [
            item
            for item in warned
            if not issubclass(item.category, (DeprecationWarning, ResourceWarning))
        ]
        if verdict["verdict"] != FINDING:
            if max(mebibytes, children) > MEMORY_LIMIT / 2**20:
                verdict = _finding("memory", "", f"{max(mebibytes, children):.0f} MiB")
            elif noise.strip():
                verdict = _finding("noise", " ".join(noise.split())[:40], noise)
            elif shown:
                first = shown[0]
                place = f"{Path(first.filename).name}:{first.category.__name__}"
                verdict = _finding(
                    "warning", place, f"{first.filename}:{first.lineno}: {first.message}"
                )
        return verdict | {"ms": round(milliseconds, 1), "mib": round(mebibytes, 1)}


def _judged(target: Any, folder: Path) -> dict[str, Any]:
    from facestage.contract.errors import FacestageError
    from fuzz.consistent import InconsistentError, RefusedError

    try:
        target.read(folder)
    except (FacestageError, RefusedError, *target.refusals) as error:
        problem = sentence_problem(str(error))
        if problem:
            return _finding("sentence", f"{problem} {_where(error)}", str(error)[:500])
        return {"verdict": REFUSED}
    except InconsistentError as error:
        return _finding(
            "inconsistent",
            re.split(" (?:is|has|holds|refers|and) ", str(error))[0][:60],
            str(error)[:500],
        )
    # Whatever else is raised is what this looks for.
    except BaseException as error:  # noqa: BLE001
        text = "".join(traceback.format_exception(error, limit=-6))
        return _finding(type(error).__name__, _where(error), text[-3000:])
    return {"verdict": ACCEPTED}


def sentence_problem(text: str) -> str:
    """What is wrong with an error's sentence; empty when nothing is."""
    if not text.strip():
        return "empty"
    if len(text.splitlines()) > 1:
        return "several lines"
    if len(text) > SENTENCE_LIMIT:
        return "too long"
    if "Traceback (" in text:
        return "a traceback"
    # Escape sequences, halves of surrogates, and what some terminals break a line at.
    if any(unicodedata.category(letter) in ("Cc", "Cs", "Zl", "Zp") for letter in text):
        return "control characters"
    return ""


def _finding(kind: str, where: str, text: str) -> dict[str, Any]:
    return {"verdict": FINDING, "kind": kind, "where": where, "text": text}


def _where(error: BaseException) -> str:
    """The innermost place of the project that it passed through, and the innermost of all."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if "/facestage/" in frame.filename]
    named = [own[-1]] if own else []
    if frames and (not own or frames[-1] is not own[-1]):
        named.append(frames[-1])
    return " > ".join(f"{Path(frame.filename).name}:{frame.name}" for frame in named)


def _limit(size: int) -> None:
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (size, hard))


def _status(name: str) -> int:
    """Bytes of a line of /proc/self/status."""
    with Path("/proc/self/status").open() as status:
        for line in status:
            if line.startswith(name):
                return 1024 * int(line.split()[1])
    return 0


def _reset_peak() -> int:
    """Let the peak of resident memory start again from what is resident now, which is returned."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")
    return _status("VmRSS")


def main() -> None:
    home, seeds, name = sys.argv[1:]
    if name == TABLE:
        # First, so that no module of the table has taken the large one.
        from fuzz.readers.files import install_small_default_model

        install_small_default_model()
    Worker(Path(home), Path(seeds), importlib.import_module(name).TARGETS).serve()


if __name__ == "__main__":
    main()

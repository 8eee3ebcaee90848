"""Kill fits at random moments, resume them, and compare all that they write with the undisturbed
fit.

For developers: ``.venv/bin/python tools/kill_fits.py --kills 100 --seed 0``. Exits with 1 when
anything differs.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

TESTS = Path(__file__).resolve().parent.parent / "tests"
OWN_FILE = "mine.txt"  # of the user, in an earlier result
PATIENCE = 600.0
TRIES = 5
# When a fit is killed: at any time until its last step, between that and the writing of the result,
# or during it.
ANYWHERE, AFTER, WRITING = "anywhere", "after the last step", "while writing"
BEFORE, BETWEEN, DONE = "before the first step", "between steps", "done before"


@dataclass
class Run:
    """A fit in a process of its own, and when it did what, in seconds after it was started."""

    process: subprocess.Popen[str]
    started: float = field(default_factory=time.monotonic)
    last_step: str = ""  # the words of the event, when known
    last_step_at: float | None = None
    events: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Listen."""
        self.reader = threading.Thread(target=self._read, daemon=True)
        self.reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            words = str(json.loads(line).get("message"))
            self.events.append(words)
            if words == self.last_step:
                self.last_step_at = self.seconds()

    def seconds(self) -> float:
        """Since the start."""
        return time.monotonic() - self.started

    def at(self, out: Path) -> str:
        """What it is doing."""
        from facestage.contract.files.temporaries import being_replaced

        if being_replaced(out):
            return WRITING
        if self.last_step_at is not None:
            return AFTER
        return BETWEEN if any("step" in words for words in self.events) else BEFORE

    def end(self) -> int:
        """Wait for it."""
        code = self.process.wait(PATIENCE)
        self.reader.join()
        return code


@dataclass(frozen=True)
class Times:
    """Of the undisturbed fit, in seconds after its start."""

    last_step: float
    writing: float
    end: float


class Fit:
    """One kind of fit and its undisturbed answer."""

    def __init__(self, name: str, arguments: Sequence[str], folder: Path) -> None:
        self.name, self.arguments, self.folder = name, list(arguments), folder
        self.reference = folder / f"{name}-reference" / "out"
        self.reference.parent.mkdir()
        run = self.start(self.reference)
        writing = _when_writing(run, self.reference)
        if run.end() != 0:
            raise SystemExit(f"The undisturbed fit '{name}' fails.")
        self.last_step = [words for words in run.events if "step" in words][-1]
        end = run.seconds()
        run = self.start(self.reference)
        run.last_step = self.last_step
        writing = _when_writing(run, self.reference)
        run.end()
        assert run.last_step_at is not None and writing is not None
        self.times = Times(run.last_step_at, writing, end)

    def start(self, out: Path, resume: bool = False) -> Run:
        """A process that fits into ``out``."""
        command = [
            sys.executable,
            "-I",
            "-m",
            "facestage.cli",
            "fit",
            *self.arguments,
            "--out",
            str(out),
        ]
        process = subprocess.Popen(
            [*command, *(["--resume"] if resume else [])],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        )
        return Run(process)

    def kill(self, out: Path, resume: bool, where: str, chance: random.Random) -> str:
        """Start a fit, kill it at a random moment; what it was at and which signal, or that it was
        done before.
        """
        share, number = (
            chance.random(),
            chance.choice([signal.SIGKILL] * 3 + [signal.SIGTERM, signal.SIGINT]),
        )
        run = self.start(out, resume)
        run.last_step = self.last_step
        moment = share * self.times.last_step
        if where == AFTER:
            _wait(run, lambda: run.last_step_at is not None)
            moment = run.seconds() + share * (self.times.writing - self.times.last_step)
        elif where == WRITING:
            _when_writing(run, out)
            moment = run.seconds() + share * (self.times.end - self.times.writing)
        _wait(run, lambda: run.seconds() > moment)
        at = run.at(out)
        run.process.send_signal(number)
        return DONE if run.end() == 0 else f"{at} {signal.Signals(number).name}"

    def trial(self, number: int, chance: random.Random) -> tuple[list[str], list[str]]:
        """One fit that is killed once or twice; how, and what differs in the end."""
        from reference.same_answer import differences  # type: ignore[import-not-found]

        out = self.folder / f"{self.name}-{number}" / "out"
        out.parent.mkdir()
        earlier = chance.random() < 0.5
        if earlier:
            shutil.copytree(self.reference, out)
            (out / OWN_FILE).write_text("the user's")
        where = ANYWHERE if chance.random() < 2 / 3 else chance.choice([AFTER, WRITING])
        history = [self.kill(out, False, where, chance)]
        while history[-1] == DONE and len(history) < TRIES:
            history.append(self.kill(out, False, where, chance))
        if chance.random() < 0.3:
            history.append(self.kill(out, True, chance.choice([ANYWHERE, AFTER, WRITING]), chance))
        found = []
        if earlier and differences(self.reference, _without_own(out)):
            found.append("the earlier result was gone or changed after the kill")
        code = self.start(out, resume=True).end()
        if code != 0:
            return history, [f"the resumed fit ends with {code}"]
        if earlier and not (out / OWN_FILE).is_file():
            found.append("the user's own file is gone")
        found += differences(self.reference, _without_own(out))
        found += [f"left behind: {path.name}" for path in out.parent.iterdir() if path != out]
        shutil.rmtree(out.parent)
        return history, found


def _without_own(out: Path) -> Path:
    """A copy without the user's file."""
    copy = out.parent.parent / f"{out.parent.name}-copy"
    shutil.rmtree(copy, ignore_errors=True)
    if out.is_dir():
        shutil.copytree(out, copy, ignore=shutil.ignore_patterns(OWN_FILE))
    else:
        copy.mkdir()
    return copy


def _wait(run: Run, until: Callable[[], bool]) -> None:
    while not until() and run.process.poll() is None:
        time.sleep(0.001)


def _when_writing(run: Run, out: Path) -> float | None:
    """Wait until the result folder is begun; when that was."""
    from facestage.contract.files.temporaries import being_replaced

    _wait(run, lambda: being_replaced(out))
    return run.seconds() if run.process.poll() is None else None


def make_fits(folder: Path) -> list[Fit]:
    """One small photo, and two of the same person."""
    from facestage.render.variant import start_renderer
    from reference.synthetic_case import write_case  # type: ignore[import-not-found]
    from reference.synthetic_scene import synthetic_scene  # type: ignore[import-not-found]
    from reference.two_photos import another_photo  # type: ignore[import-not-found]

    start_renderer("cpu")
    scene = synthetic_scene()
    cases = []
    for name, shown in (("first", scene), ("second", another_photo(scene))):
        (folder / name).mkdir()
        cases.append(write_case(folder / name, shown))
    shared = ["--model", cases[0].model_option, "--lights", "4", "--device", "cpu"]

    def files(option: str, name: str) -> list[str]:
        return [word for case in cases for word in (option, str(getattr(case, name)))]

    first = cases[0]
    one = [str(first.photo), "--landmarks", str(first.landmarks), "--camera", str(first.camera)]
    both = [
        *(str(case.photo) for case in cases),
        *files("--landmarks", "landmarks"),
        *files("--camera", "camera"),
    ]
    return [
        Fit("one photo", [*one, "--truth", str(first.truth), *shared], folder),
        Fit("two photos", [*both, "--same-person", *shared], folder),
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the trials and print the table; 1 when one ended differently."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--kills", type=int, default=100, help="how many fits to kill (default 100)"
    )
    parser.add_argument("--jobs", type=int, default=1, help="how many at a time (default 1)")
    parser.add_argument("--seed", type=int, default=0, help="of the moments (default 0)")
    options = parser.parse_args(arguments)
    sys.path.insert(0, str(TESTS))
    began, counts, unequal = time.monotonic(), Counter[tuple[str, bool]](), 0
    with (
        tempfile.TemporaryDirectory(prefix="facestage-kills-") as name,
        ThreadPoolExecutor(options.jobs) as pool,
    ):
        fits = make_fits(Path(name))
        for fit in fits:
            print(
                f"{fit.name}: {fit.times.end:.1f} s undisturbed, the last step after "
                f"{fit.times.last_step:.1f} s"
            )

        def trial(number: int) -> tuple[str, list[str], list[str]]:
            # Each has a seed of its own, so that one can be told apart and done again.
            chance = random.Random(f"{options.seed}/{number}")
            fit = fits[0 if chance.random() < 0.7 else 1]
            return fit.name, *fit.trial(number, chance)

        for number, (fitted, history, found) in enumerate(pool.map(trial, range(options.kills))):
            for how in history:
                counts[f"{fitted}, {how}", not found] += 1
            unequal += bool(found)
            said = "; ".join(found) if found else "equal"
            print(f"{number:4d}  {fitted}: killed {', then '.join(history)}: {said}", flush=True)
    print(f"\n{'killed':48} equal  different")
    for how in sorted({how for how, _ in counts}):
        print(f"{how:48} {counts[how, True]:5d}  {counts[how, False]:9d}")
    print(
        f"{options.kills - unequal} of {options.kills} equal, seed {options.seed}, "
        f"{time.monotonic() - began:.0f} s"
    )
    return 1 if unequal else 0


if __name__ == "__main__":
    sys.exit(main())

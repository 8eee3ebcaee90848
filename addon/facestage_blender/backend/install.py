"""Makes the backend's environment: a program that Blender's Python runs in a process of its own.

python -I install.py FOLDER LOCK WHEEL STAMP FINGERPRINT [WHEELS]

Says where it is as events of the contract, one JSON object per line, and ends as the backend does:
0 done, 2 refused in one sentence, 3 cancelled. Standard library only. Takes no file whose digest
the lock does not name, and builds nothing.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

REFUSED, CANCELLED = 2, 3
LOCKED = ("--require-hashes", "--no-deps", "--only-binary", ":all:")
REMOVING_SECONDS = 3.0
VENV, FETCHED, UNPACKED = 0.05, 0.75, 0.95  # shares of the work when each is done


class RefusedError(Exception):
    """What the user is told, in one sentence."""


def main(arguments: list[str]) -> int:
    """Install, or say why not. Returns the exit code."""
    folder, lock, wheel = (Path(each) for each in arguments[:3])
    stamp, fingerprint, *wheels = arguments[3:]
    signal.signal(signal.SIGTERM, cancel)
    try:
        install(folder, lock, wheel, Path(wheels[0]) if wheels else None)
        (folder / stamp).write_text(f"{fingerprint}\n", encoding="utf-8")
    except KeyboardInterrupt:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        _remove(folder)
        print("facestage: cancelled.", file=sys.stderr)
        return CANCELLED
    except (RefusedError, OSError) as error:
        print(f"facestage: {error}", file=sys.stderr)
        return REFUSED
    say("Done", 1.0)
    return 0


def install(folder: Path, lock: Path, wheel: Path, wheels: Path | None) -> None:
    """Make the environment anew in ``folder``. Raises RefusedError."""
    if wheels is not None and not wheels.is_dir():
        raise RefusedError(
            f"the folder of wheels '{wheels}' does not exist; correct it, or clear it."
        )
    say("Making the environment", 0.0)
    shutil.rmtree(folder, ignore_errors=True)
    folder.parent.mkdir(parents=True, exist_ok=True)
    _make_environment(folder)
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    pip = [str(python), "-I", "-m", "pip", "install", "--disable-pip-version-check", "--no-input"]
    source = [] if wheels is None else ["--no-index", "--find-links", str(wheels)]
    progress = Progress(len(re.findall(r"^\S+==", lock.read_text(encoding="utf-8"), re.MULTILINE)))
    code, lines = run([*pip, *source, *LOCKED, "--requirement", str(lock)], progress.hear)
    if code:
        raise RefusedError(explain(lines, wheels))
    say("Unpacking the backend", UNPACKED)
    code, lines = run([*pip, "--no-index", "--no-deps", str(wheel)])
    if code:
        raise RefusedError(explain(lines, wheels))
    code, lines = run([str(python), "-P", "-m", "facestage", "--help"])
    if code:
        raise RefusedError(f"the backend was installed but does not start ({_last(lines)}).")


class Progress:
    """What pip says, as shares of the work."""

    def __init__(self, packages: int) -> None:
        self.packages, self.found = max(packages, 1), 0

    def hear(self, line: str) -> None:
        """Tell the user of a line that means something to him."""
        line = line.strip()
        found = re.match(r"(?:Collecting (\S+?)==|Processing (.+?\.whl))", line)
        if found:
            self.found += 1
            name = found[1] or Path(found[2]).name.split("-")[0]
            self.say(f"Fetching {name}")
        elif line.startswith("Downloading ") and "(" in line:
            name = line.split()[1].rpartition("/")[2].split("-")[0]
            self.say(f"Fetching {name} ({line.rpartition('(')[2].rstrip(')')})")
        elif line.startswith("Installing collected packages"):
            say("Unpacking the packages, which takes a minute", FETCHED)

    def say(self, stage: str) -> None:
        """Tell the user what is fetched."""
        say(stage, VENV + (FETCHED - VENV) * min(1.0, self.found / self.packages))


def _make_environment(folder: Path) -> None:
    code, _ = run([sys.executable, "-I", "-c", "import ensurepip, venv"])
    if code:
        raise RefusedError(
            f"Blender's Python ({sys.executable}) lacks venv; on Debian and Ubuntu install "
            "python3-venv, or use Blender's own download."
        )
    code, lines = run([sys.executable, "-I", "-m", "venv", str(folder)])
    if code:
        raise RefusedError(f"no environment could be made in '{folder}' ({_last(lines)}).")


def run(command: list[str], hear: Callable[[str], None] | None = None) -> tuple[int, list[str]]:
    """Run a command and hand on its lines; its exit code and its lines. It and all that it started
    end with this program.
    """
    cancel.held = True
    try:
        child = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            encoding="utf-8",
            errors="replace",
            start_new_session=True,
        )
    except OSError:
        cancel.let_go()
        raise
    lines: list[str] = []
    try:
        cancel.let_go()
        assert child.stdout is not None
        with child.stdout:
            for line in child.stdout:
                lines.append(line.rstrip())
                if hear is not None:
                    hear(line)
        return child.wait(), lines
    except BaseException:
        _kill(child)
        raise


class Cancel:
    """What is done when this program is to end. While a child is being started it waits, lest the
    child outlives the program.
    """

    def __init__(self) -> None:
        self.held = self.asked = False

    def __call__(self, _number: int, _frame: object) -> None:
        """A signal came. Raises KeyboardInterrupt unless held."""
        self.asked = True
        if not self.held:
            raise KeyboardInterrupt

    def let_go(self) -> None:
        """The child can be ended now. Raises KeyboardInterrupt where that was asked meanwhile."""
        self.held = False
        if self.asked:
            raise KeyboardInterrupt


cancel = Cancel()


def explain(lines: list[str], wheels: Path | None) -> str:
    """One sentence for what pip said."""
    text = "\n".join(lines)
    missing = re.search(r"No matching distribution found for (\S+?)==", text)
    if missing and wheels is not None:
        return f"the folder '{wheels}' has no wheel of {missing[1]} for this Python and system."
    if "Could not fetch URL" in text or "Retrying (" in text:
        return "PyPI cannot be reached; check the network and press Install Backend to try again."
    if missing:
        return f"PyPI has no wheel of {missing[1]} for this Python and system."
    if "DO NOT MATCH THE HASHES" in text:
        return (
            "a package is not the one that was tested (its digest differs); nothing is used of it."
        )
    errors = [line.removeprefix("ERROR: ") for line in lines if line.startswith("ERROR: ")]
    said = (errors or [_last(lines)])[-1].rstrip(".")
    return f"the packages could not be installed ({said}); press Install Backend to try again."


def say(stage: str, fraction: float) -> None:
    """One event of the contract."""
    event = {"kind": "progress", "stage": stage, "fraction": round(fraction, 3)}
    print(json.dumps(event), flush=True)


def _last(lines: list[str]) -> str:
    return next((line.strip() for line in reversed(lines) if line.strip()), "no words")


def _kill(child: subprocess.Popen[str]) -> None:
    """Venv and pip start programs of their own, which would go on writing."""
    if os.name == "nt":
        child.kill()
    else:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child.pid, signal.SIGKILL)
    child.wait()


def _remove(folder: Path) -> None:
    """Until nothing comes back: what was killed may be amid a write."""
    until = time.monotonic() + REMOVING_SECONDS
    while folder.exists() and time.monotonic() < until:
        shutil.rmtree(folder, ignore_errors=True)
        time.sleep(0.02)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

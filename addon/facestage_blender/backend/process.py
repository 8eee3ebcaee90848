"""Start, watch and cancel the backend: a child process that prints one event per line.

No bpy; never blocks.
"""

from __future__ import annotations

import contextlib
import os
import queue
import signal
import subprocess
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import IO

from facestage.contract.errors import BackendUnavailableError, CancelledError, InputError
from facestage.contract.events import FAILED, Event
from facestage.contract.online import with_online_access

DONE = 0
BAD_INPUT, CANCELLED = InputError.exit_code, CancelledError.exit_code
UNAVAILABLE = BackendUnavailableError.exit_code
KILL_AFTER_SECONDS = 10.0  # a backend that has not stopped by then is killed


@dataclass(frozen=True)
class Outcome:
    """How the backend ended: the contract's exit code (1 for anything unforeseen) and one
    sentence.
    """

    code: int
    message: str

    @property
    def ok(self) -> bool:
        """True when the run did what was asked."""
        return self.code == DONE


class BackendProcess:
    """One run of the backend. Poll it from a timer; every method returns at once."""

    def __init__(
        self, command: Sequence[str], online: bool = True, kill_after: float = KILL_AFTER_SECONDS
    ) -> None:
        """Start ``command``, which may fetch what it lacks when ``online``.

        ``kill_after``: seconds that a cancelled child has to stop by itself. Raises
        BackendUnavailableError when it cannot be started.
        """
        self._kill_after = kill_after
        self.command = list(command)
        self.failure = ""
        self._events: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self._lines: deque[str] = deque(maxlen=50)
        self._errors: deque[str] = deque(maxlen=50)
        self._cancelled_at: float | None = None
        try:
            self._child = subprocess.Popen(
                self.command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                encoding="utf-8",
                errors="replace",
                bufsize=1,
                env=_environment(online),
            )
        except OSError as error:
            raise BackendUnavailableError(
                f"The backend '{self.command[0]}' cannot be started ({error.strerror or error}); "
                "set its path in the add-on's preferences."
            ) from error
        self._readers = [
            threading.Thread(target=self._read_events, args=(self._child.stdout,), daemon=True),
            threading.Thread(target=self._read_errors, args=(self._child.stderr,), daemon=True),
        ]
        for reader in self._readers:
            reader.start()

    @property
    def pid(self) -> int:
        """The child's process id."""
        return self._child.pid

    @property
    def output(self) -> str:
        """The last lines on stdout that were not events."""
        return "\n".join(self._lines)

    def poll(self) -> list[Event]:
        """The events since the last call; also sees to a cancelled child that does not stop."""
        overdue = (
            self._cancelled_at is not None
            and time.monotonic() - self._cancelled_at > self._kill_after
        )
        if overdue and self._child.poll() is None:
            self._child.kill()
        events = []
        with contextlib.suppress(queue.Empty):
            while True:
                events.append(self._events.get_nowait())
        return events

    def cancel(self) -> None:
        """Ask the child to stop; it keeps its last checkpoint."""
        if self._cancelled_at is None and self._child.poll() is None:
            self._cancelled_at = time.monotonic()
            self._child.terminate()

    def outcome(self) -> Outcome | None:
        """How the child ended, or None while it runs or its last words are still on the way."""
        code = self._child.poll()
        if code is None or any(reader.is_alive() for reader in self._readers):
            return None
        return explain(code, list(self._errors), self.failure, self._cancelled_at is not None)

    def wait(
        self, on_event: Callable[[Event], None] | None = None, interval: float = 0.05
    ) -> Outcome:
        """Block until the child ends (for scripts without a window), handing every event to
        ``on_event``.
        """
        while True:
            outcome = self.outcome()
            for event in self.poll():
                if on_event is not None:
                    on_event(event)
            if outcome is not None:
                return outcome
            time.sleep(interval)

    def _read_events(self, stream: IO[str]) -> None:
        with stream:
            for line in stream:
                event = Event.from_line(line)
                if event is None:
                    self._lines.append(line.rstrip())
                    continue
                if event.kind == FAILED:
                    self.failure = event.message
                self._events.put(event)

    def _read_errors(self, stream: IO[str]) -> None:
        with stream:
            self._errors.extend(line.strip() for line in stream if line.strip())


def _environment(online: bool) -> dict[str, str]:
    """What the backend is told beside its command line."""
    # A backend given as "python -m facestage" must not import what lies in the folder that Blender
    # was started in.
    return with_online_access({**os.environ, "PYTHONSAFEPATH": "1"}, online)


def explain(code: int, errors: Sequence[str], failure: str, cancelled: bool) -> Outcome:
    """The sentence for an exit code, from the backend's own words where it left any."""
    said = errors[-1] if errors else failure
    if code == DONE:
        return Outcome(DONE, "Done.")
    if cancelled or code == CANCELLED:
        return Outcome(CANCELLED, _cancelled(said))
    if code in (BAD_INPUT, UNAVAILABLE) and said:
        return Outcome(code, said.removeprefix("facestage: ").removeprefix("error: "))
    if code < 0:
        try:
            name = signal.Signals(-code).name
        except ValueError:
            name = f"signal {-code}"
        hint = ", perhaps for lack of memory" if name == "SIGKILL" else ""
        return Outcome(
            1,
            f"The backend was killed ({name}{hint}); the scene is unchanged, press Resume to "
            "go on.",
        )
    detail = f": {said}" if said else ""
    return Outcome(1, f"The backend stopped unexpectedly (exit code {code}){detail}")


def _cancelled(said: str) -> str:
    """What a cancelled run leaves, by the backend's own words; one that had to be killed left
    none.
    """
    if "--resume" in said:
        return "Cancelled; the last checkpoint is kept, press Resume to go on from it."
    if said:
        return "Cancelled before there was a checkpoint; start again."
    return "Cancelled; press Resume to go on from the last checkpoint, if there is one."

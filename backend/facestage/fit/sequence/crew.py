"""Processes that look at frames, one on each core.

Most of a look is one thread's work, so several frames are looked at at once, each process with a
scene of its own that it keeps. Answers come in the order of the questions, and are the same
whoever looks.
"""

from __future__ import annotations

import os
import pickle
import queue
import signal
import subprocess
import time
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import suppress
from typing import Self

from facestage.fit.result.memory import machine_memory
from facestage.fit.sequence.looking import Answer, Looker, Question
from facestage.render.threads import use_threads
from facestage.render.variant import start_renderer
from facestage.system.child import python_code

# A process takes as long to begin as for a dozen looks.
LOOKS_EACH = 48
MOST = 32
# A process needs about so many bytes, and half of the machine's memory is left to others.
BYTES_EACH, SHARE = 600 << 20, 0.5
# Questions that wait for each process, so that none is idle.
AHEAD = 2
ENDS_IN, LISTENS_EVERY = 5.0, 0.2  # seconds
# Threads of linear algebra would fight with those of the other processes.
SURROUNDINGS = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
_START = "from facestage.fit.sequence.crew import main; main()"


def cores() -> int:
    """How many this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def crew_size(looks: int, cores: int, memory: int | None) -> int:
    """How many processes are worth their beginning; 1: this one alone. ``memory`` bytes of the
    machine.
    """
    most = min(cores, looks // LOOKS_EACH, MOST)
    if memory is not None:
        most = min(most, int(SHARE * memory) // BYTES_EACH)
    return max(most, 1)


class EndedError(Exception):
    """A process has died, or was killed."""


class Crew:
    """Processes with copies of one ``looker``. Leaving it ends them."""

    def __init__(self, looker: Looker, count: int) -> None:
        """Raises OSError where no process can be started."""
        self._looker = looker
        copy = pickle.dumps(looker, pickle.HIGHEST_PROTOCOL)
        self.members: list[Member] = []
        self._idle: queue.SimpleQueue[Member] = queue.SimpleQueue()
        self._threads = ThreadPoolExecutor(count)
        try:
            for _ in range(count):
                self.members.append(Member(copy))
                self._idle.put(self.members[-1])
        except BaseException:
            self.end()
            raise

    @classmethod
    def of(cls, looker: Looker, looks: int) -> Crew | None:
        """As large as ``looks`` are worth; None: they are for this process, or no other one can
        be started.
        """
        count = crew_size(looks, cores(), machine_memory())
        if count == 1:
            return None
        try:
            return cls(looker, count)
        except OSError:
            return None

    @property
    def seconds(self) -> float:
        """Of processor time so far."""
        return sum(member.seconds for member in self.members)

    def answers(self, questions: Iterable[Question]) -> Iterator[Answer]:
        """In the order of the ``questions``, of which few are asked ahead."""
        waiting: deque[tuple[Question, Future[Answer]]] = deque()
        for question in questions:
            waiting.append((question, self._threads.submit(self._asked, question)))
            if len(waiting) >= AHEAD * len(self.members):
                yield self._answered(*waiting.popleft())
        while waiting:
            yield self._answered(*waiting.popleft())

    def _asked(self, question: Question) -> Answer:
        member = self._idle.get()
        try:
            return member.ask(question)
        finally:
            self._idle.put(member)

    def _answered(self, question: Question, future: Future[Answer]) -> Answer:
        """What a process found; what one left that is gone, this one looks at."""
        # A signal is heard between waits, on every system.
        while not wait([future], LISTENS_EVERY).done:
            pass
        try:
            return future.result()
        except EndedError:
            return self._looker.answer(question)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.end()

    def end(self) -> None:
        """Let all go."""
        for member in self.members:
            member.end()
        self._threads.shutdown(cancel_futures=True)


class Member:
    """A process of the crew, as seen from here."""

    def __init__(self, looker: bytes) -> None:
        self.seconds = 0.0  # of processor time
        self.process = subprocess.Popen(
            python_code(_START),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, **SURROUNDINGS},
        )
        self._looker: bytes | None = looker

    def ask(self, question: Question) -> Answer:
        """Its answer. Raises what it raised, and EndedError where it is gone."""
        tell, listen = self.process.stdin, self.process.stdout
        assert tell is not None
        assert listen is not None
        try:
            if self._looker is not None:
                tell.write(self._looker)
                self._looker = None
            pickle.dump(question, tell, pickle.HIGHEST_PROTOCOL)
            tell.flush()
            answer, self.seconds = pickle.load(listen)  # noqa: S301 - from this program's own child
        except (OSError, EOFError, ValueError, pickle.UnpicklingError) as error:
            raise EndedError from error
        if isinstance(answer, BaseException):
            raise answer
        assert isinstance(answer, Answer)
        return answer

    def end(self) -> None:
        """Let it go, wherever it is."""
        with suppress(OSError):
            self.process.kill()
        self.process.wait(ENDS_IN)
        for pipe in (self.process.stdin, self.process.stdout):
            assert pipe is not None
            with suppress(OSError, ValueError):
                pipe.close()


def main() -> None:
    """A member's part: answer what comes in, until nothing does."""
    # Ctrl+C goes to all processes of a terminal; the one that leads ends this one.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with os.fdopen(os.dup(1), "wb") as tell, os.fdopen(0, "rb", closefd=False) as listen:
        # What a library prints is no part of an answer.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        start_renderer("cpu")
        use_threads(1)
        with suppress(EOFError, BrokenPipeError):
            looker = pickle.load(listen)  # noqa: S301 - from the process that started this one
            while True:
                question = pickle.load(listen)  # noqa: S301
                answer = _tried(looker, question), time.process_time()
                pickle.dump(answer, tell, pickle.HIGHEST_PROTOCOL)
                tell.flush()


def _tried(looker: Looker, question: Question) -> Answer | Exception:
    try:
        return looker.answer(question)
    except Exception as error:  # noqa: BLE001 - raised again where it was asked
        return error

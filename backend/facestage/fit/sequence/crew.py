"""Processes that look at frames, one on each core.

Most of a look is one thread's work, so several frames are looked at at once, each process with a
scene of its own that it keeps. Answers come in the order of the questions, and are the same
whoever looks.
"""

from __future__ import annotations

import os
import queue
import signal
import time
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import suppress
from multiprocessing import current_process, get_context
from multiprocessing.connection import Connection
from typing import Self

from facestage.fit.result.memory import machine_memory
from facestage.fit.sequence.looking import Answer, Looker, Question
from facestage.render.threads import use_threads
from facestage.render.variant import start_renderer
from facestage.system.child import apart
from facestage.system.cores import cores
from facestage.system.freed_memory import keep_freed_memory

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
SPAWN = get_context("spawn")


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
        self.members: list[Member] = []
        self._idle: queue.SimpleQueue[Member] = queue.SimpleQueue()
        self._threads = ThreadPoolExecutor(count)
        try:
            for _ in range(count):
                self.members.append(Member())
                # A process takes a while until it listens.
                self._threads.submit(self._begun, self.members[-1])
        except BaseException:
            self.end()
            raise

    @classmethod
    def of(cls, looker: Looker, looks: int) -> Crew | None:
        """As large as ``looks`` are worth; None: they are for this process, or no other one can
        be started.
        """
        count = crew_size(looks, cores(), machine_memory())
        # A worker of a pool may start no process.
        if count == 1 or current_process().daemon:
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

    def _begun(self, member: Member) -> None:
        try:
            member.begin(self._looker)
        except Exception:  # noqa: BLE001 - whoever asks it hears that it is gone
            member.end()
        self._idle.put(member)

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

    def __init__(self) -> None:
        self.seconds = 0.0  # of processor time
        self._line, end = SPAWN.Pipe()
        self.process = SPAWN.Process(target=answer_all, args=(end,), daemon=True)
        try:
            with apart(**SURROUNDINGS):
                self.process.start()
        finally:
            # Open here as well, it would never be heard that the process is gone.
            end.close()

    def begin(self, looker: Looker) -> None:
        """Say who it is. Raises OSError where it is gone."""
        self._line.send(looker)

    def ask(self, question: Question) -> Answer:
        """Its answer. Raises what it raised, and EndedError where it is gone."""
        try:
            self._line.send(question)
            answer, self.seconds = self._line.recv()
        except (OSError, EOFError) as error:
            raise EndedError from error
        if isinstance(answer, BaseException):
            raise answer
        assert isinstance(answer, Answer)
        return answer

    def end(self) -> None:
        """Let it go, wherever it is."""
        self.process.kill()
        self.process.join(ENDS_IN)
        self._line.close()


def answer_all(line: Connection) -> None:
    """A member's part: answer what comes in by the ``line``, until the process that asks is gone,
    however it ended.
    """
    # Ctrl+C goes to all processes of a terminal; the one that leads ends this one.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # What a library prints is nothing that the program says.
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    start_renderer("cpu")
    use_threads(1)
    keep_freed_memory()
    with suppress(EOFError, OSError):
        looker = line.recv()
        while True:
            answer = _tried(looker, line.recv())
            line.send((answer, time.process_time()))


def _tried(looker: Looker, question: Question) -> Answer | Exception:
    try:
        return looker.answer(question)
    except Exception as error:  # noqa: BLE001 - raised again where it was asked
        return error

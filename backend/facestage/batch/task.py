"""One row of a batch, in the process that fits it."""

from __future__ import annotations

import hashlib
import time
from argparse import Namespace
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from facestage.contract.batch import FAILED, BatchRow
from facestage.contract.errors import FacestageError, InputError
from facestage.contract.files.partial import has_checkpoint, partial_folder
from facestage.contract.files.paths import is_folder
from facestage.contract.job import Job

if TYPE_CHECKING:
    from facestage.fit.sequence.request import Request

ReadJobs = Callable[[Namespace], list[Job]]
ReadRequest = Callable[[Namespace], "Request"]


@dataclass(frozen=True)
class Readers:
    """What makes the jobs of a row's options, or the request where the row is a film; each is
    called where the row is fitted.
    """

    jobs: ReadJobs
    request: ReadRequest


@dataclass(frozen=True)
class Task:
    """A row to fit: ``options`` are those of a fit of its photos, or of following its film."""

    number: int
    name: str
    photos: tuple[Path, ...]  # of a film: its video or folder
    options: Namespace
    film: bool = False

    @property
    def asked(self) -> str:
        """A digest of the options, and of the photos as they are now."""
        said = [repr(sorted(vars(self.options).items()))]
        for photo in self._files():
            try:
                status = photo.stat()
                said.append(f"{photo} {status.st_size} {status.st_mtime_ns}")
            except (OSError, ValueError):
                said.append(f"{photo} missing")
        return hashlib.sha256("\n".join(said).encode("utf-8", "backslashreplace")).hexdigest()[:16]

    def _files(self) -> Iterator[Path]:
        for photo in self.photos:
            yield photo
            if self.film and is_folder(photo):
                yield from sorted(photo.iterdir())

    def failed(self, sentence: str, seconds: float = 0.0) -> BatchRow:
        """The row of a fit that gave no result."""
        return self.row(FAILED, sentence, seconds, {})

    def row(self, status: str, sentence: str, seconds: float, errors: dict[str, float]) -> BatchRow:
        """What came of it."""
        photos = tuple(map(str, self.photos))
        return BatchRow(
            self.number, self.name, photos, status, sentence, self.asked, seconds, errors
        )


def fit_row(task: Task, read: Readers, out: Path, threads: int) -> BatchRow:
    """Fit the photos of ``task`` into the folder ``out``; what is wrong with them is in the row.
    What the photos are not to blame for is raised.
    """
    from facestage.render.threads import use_threads

    started = time.monotonic()
    use_threads(threads)
    try:
        status, advice, errors = _fitted(read.jobs(task.options), task, out)
    except FacestageError as error:
        return task.failed(str(error), time.monotonic() - started)
    return task.row(status, advice, time.monotonic() - started, errors)


def _fitted(jobs: Sequence[Job], task: Task, out: Path) -> tuple[str, str, dict[str, float]]:
    """Status, advice and errors of the fit, which goes on from the checkpoint of one that died."""
    if has_checkpoint(partial_folder(out)):
        try:
            return _fit(jobs, task, out, resume=True)
        except InputError:
            pass  # it may be of other options, or damaged: the fit itself says what is wrong
    return _fit(jobs, task, out, resume=False)


def _fit(
    jobs: Sequence[Job], task: Task, out: Path, resume: bool
) -> tuple[str, str, dict[str, float]]:
    from facestage.fit.result.person import fit_person
    from facestage.fit.result.run import fit_job

    finder = task.options.landmark_model
    if len(jobs) == 1:
        result = fit_job(jobs[0], out, resume, landmark_model=finder)
        return result.status, result.advice, result.errors
    person = fit_person(jobs, out, resume, landmark_model=finder)
    names = {name for photo in person.photos for name in photo.errors}
    means = {
        name: float(np.mean([each.errors[name] for each in person.photos if name in each.errors]))
        for name in sorted(names)
    }
    return person.status, person.advice, means

"""What a person hears of a run: events of one scale and one set of words, and a preview."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from facestage.contract.events import DONE, PROGRESS, STARTED, Event
from facestage.contract.face_model import FaceModel
from facestage.contract.files.partial import PREVIEW
from facestage.fit.runs.progress import FITTED, Progress, drawing, painting
from facestage.report import write_preview

PREVIEW_INTERVAL = 2.0  # seconds


class Teller:
    """Tells ``emit`` how a run over so many ``photos`` goes; the run begins now."""

    def __init__(self, emit: Callable[[Event], None], photos: int = 1) -> None:
        self._emit, self._photos = emit, photos
        self._began = time.monotonic()
        self._folder: Path | None = None
        self._preview: str | None = None
        self._last_preview = -np.inf

    @property
    def seconds(self) -> float:
        """How long the run has been going on."""
        return time.monotonic() - self._began

    def previews_into(self, folder: Path) -> None:
        """From now on, steps come with a picture in ``folder``."""
        self._folder = folder

    def tell(self, event: Event) -> None:
        """An event of someone else's."""
        self._emit(replace(event, seconds=self.seconds))

    def reading(self, what: str) -> None:
        """The first words."""
        self._emit(Event(STARTED, message=f"Reading {what}"))

    def model(self, model: FaceModel) -> None:
        """Which face model is fitted, and whose work it is."""
        words = f"Face model: {model.name}; licence: {model.license}; {model.source}"
        self.tell(Event(PROGRESS, "reading", message=words))

    def step(self, progress: Progress) -> None:
        """A step of the fit."""
        self._show(progress)
        self.tell(
            Event(
                PROGRESS,
                progress.phase,
                progress.iteration,
                progress.photo_rms,
                seconds_left=progress.seconds_left,
                fraction=progress.fraction,
                preview=self._preview,
                message=self._words(progress),
            )
        )

    def finishing(self) -> None:
        """Textures and pictures of the only photo are made."""
        self._say("pictures", FITTED, "Drawing textures and pictures")

    def painting(self, number: int) -> None:
        """The textures that photo ``number`` of several shows are made."""
        words = f"Painting the skin that photo {number} of {self._photos} shows"
        self._say("texture", painting(number, self._photos), words)

    def drawing(self, number: int) -> None:
        """The pictures of photo ``number`` of several are drawn."""
        words = f"Drawing the pictures of photo {number} of {self._photos}"
        self._say("pictures", drawing(number, self._photos), words)

    def done(self, advice: str) -> None:
        """The last words."""
        self.tell(Event(DONE, "done", seconds_left=0.0, fraction=1.0, message=advice))

    def _say(self, stage: str, fraction: float, words: str) -> None:
        self.tell(Event(PROGRESS, stage, fraction=fraction, message=words))

    def _words(self, progress: Progress) -> str:
        step = f"{progress.phase}, step {progress.iteration}"
        if self._photos == 1:
            return f"Fitting: {step}"
        if progress.together:
            return (
                f"Fitting {self._photos} photos together: {step} (photo {progress.number} is shown)"
            )
        return f"Fitting photo {progress.number} of {self._photos}: {step}"

    def _show(self, progress: Progress) -> None:
        """Draw the preview, if there is something to see and the last one is old."""
        if self._folder is None or progress.photo is None or progress.evaluation is None:
            return
        now = time.monotonic()
        if now - self._last_preview > PREVIEW_INTERVAL:
            self._last_preview, file = now, self._folder / PREVIEW
            self._preview = str(file)
            write_preview(file, progress.photo, progress.photo + progress.evaluation.residual)

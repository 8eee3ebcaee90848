"""What every contender leaves behind, and how all of them are judged alike, off the clock."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import binary_erosion

from facestage.contract.light_stage import LightStage
from facestage.fit.face.state import State
from facestage.fit.forward.shading import ForwardModel, pixel_rays
from facestage.fit.given.metrics import psnr
from facestage.fit.given.problem import FINE_FACE_PX, Problem
from facestage.fit.given.truth import Truth
from facestage.fit.runs.trace import DETAIL
from facestage.images.image_io import resize
from facestage.render.tracer import RayTracer

JUDGE_SAMPLES = 4


@dataclass(frozen=True)
class Snapshot:
    """Where a contender was after so many seconds of optimisation."""

    seconds: float
    stage: str
    state: State
    lit: bool  # the state has lights: it can be rendered


@dataclass(frozen=True)
class Track:
    """One contender's run over one case."""

    snapshots: list[Snapshot]
    forward: ForwardModel  # what its lights mean
    stage: LightStage  # camera frame
    # where a state has its lights, if not all have them there
    placed: Callable[[State], LightStage] | None = None
    # of the finished result: "albedo", "light", against a scan "covered_mm" and the like
    errors: dict[str, float] = field(default_factory=dict)
    # (h, w, 3) the finished render at the photo's size, albedo detail included
    picture: np.ndarray | None = None
    picture_seconds: float = 0.0  # when its textures were done


@dataclass(frozen=True)
class Row:
    """A line of the bench's trace. ``psnr`` is None before there are lights."""

    case: str
    family: str
    contender: str
    seconds: float
    stage: str
    psnr: float | None
    similarity_mm: float
    rigid_mm: float


class Judge:
    """Errors of any contender's states: the same pixels, the same resolution, the same measures."""

    def __init__(self, problem: Problem, truth: Truth) -> None:
        self.problem, self.truth = problem, truth
        self._factor = problem.scale(FINE_FACE_PX)
        self._photo = problem.photo_at(self._factor)
        self.mask = self._photo.usable & self._true_face()

    def _true_face(self) -> np.ndarray:
        """(h, w) bool: pixels whose whole neighbourhood shows the fitted part of the true face."""
        vertices, triangles, face = self.truth.seen()
        tracer = RayTracer(triangles, len(vertices))
        centre = vertices.mean(0)
        tracer.update(vertices - centre)
        height, width = self._photo.usable.shape
        y, x = np.mgrid[:height, :width]
        pixels = np.stack([x.ravel(), y.ravel()], axis=1) + 0.5
        hits = tracer.first_hits(
            -centre, pixel_rays(self.problem.camera.scaled(self._factor), pixels)
        )
        seen = (hits.triangle >= 0) & face[hits.triangle]
        return np.asarray(binary_erosion(seen.reshape(height, width)))

    def rows(self, case: str, family: str, contender: str, track: Track) -> list[Row]:
        """The trace of a run, the finished picture last."""
        rows = []
        for item in track.snapshots:
            quality = self._psnr(item.state, track) if item.lit else None
            rows.append(
                self._row(case, family, contender, item.seconds, item.stage, quality, item.state)
            )
        if track.picture is not None:
            height, width = self.mask.shape
            picture = track.picture
            if picture.shape[:2] != (height, width):
                picture = resize(picture, width, height)
            quality, last = (
                psnr(picture, self._photo.color, self.mask, self.problem.white),
                track.snapshots[-1].state,
            )
            rows.append(
                self._row(case, family, contender, track.picture_seconds, DETAIL, quality, last)
            )
        return rows

    def _row(
        self,
        case: str,
        family: str,
        contender: str,
        seconds: float,
        stage: str,
        quality: float | None,
        state: State,
    ) -> Row:
        errors = self.truth.geometry_errors(state)
        return Row(
            case,
            family,
            contender,
            seconds,
            stage,
            quality,
            errors["similarity_mm"],
            errors["rigid_mm"],
        )

    def _psnr(self, state: State, track: Track) -> float:
        """Where the face should be seen and is not, the render is black."""
        scaled = State(**{**vars(state), "camera": state.camera.scaled(self._factor)})
        y, x = np.nonzero(self.mask)
        surface = track.forward.surface(scaled, np.stack([x, y], axis=1) + 0.5)
        stage = track.stage if track.placed is None else track.placed(state)
        terms = track.forward.light_terms(scaled, surface, stage, JUDGE_SAMPLES, seed=1)
        color = np.zeros_like(self._photo.color)
        column, row = surface.pixels.astype(int).T
        color[row, column] = track.forward.shade(scaled, surface, terms).color
        return psnr(color, self._photo.color, self.mask, self.problem.white)

"""A row of the trace: what is measured after each accepted step."""

from __future__ import annotations

from typing import Any

import numpy as np

from facestage.fit.face.state import State
from facestage.fit.given.metrics import psnr
from facestage.fit.given.problem import Problem
from facestage.fit.given.truth import Truth
from facestage.fit.stages.phases import Phase
from facestage.fit.stages.stage import Iteration, Stage


def trace_row(
    problem: Problem,
    phase: Phase,
    item: Iteration,
    stage: Stage,
    state: State,
    seconds: float,
    truth: Truth | None,
) -> dict[str, Any]:
    """Energy, damping and errors after step ``item``; ``state`` is the step's at the photo's full
    size.
    """
    row: dict[str, Any] = {
        "seconds": seconds,
        "stage": phase.name,
        "iteration": item.number,
        "energy": item.energy,
        "condition": item.condition,
        "damping": item.damping.value,
    }
    if item.evaluation is not None and stage.energy.photo is not None:
        used = item.evaluation.base_weight > 0
        photo = stage.energy.photo.photo.color
        row["photo_rms"] = (
            float(np.sqrt((item.evaluation.residual[used] ** 2).mean())) if used.any() else None
        )
        row["psnr"] = psnr(photo + item.evaluation.residual, photo, used, problem.white)
    if truth is not None:
        row |= truth.geometry_errors(state)
    return row

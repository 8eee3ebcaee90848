"""A row of the trace: what is measured after each accepted step."""

from __future__ import annotations

from typing import Any

from facestage.fit.given.metrics import psnr
from facestage.fit.given.truth import Truth
from facestage.fit.stages.passage import Passage
from facestage.fit.stages.photo_descent import Iteration

# What the trace calls the phases: those of the schedule by their titles, and at the end this.
DETAIL = "albedo detail"


def trace_row(
    passage: Passage, item: Iteration, seconds: float, truth: Truth | None
) -> dict[str, Any]:
    """Energy, damping and errors after step ``item``, which led to where ``passage`` is."""
    row: dict[str, Any] = {
        "seconds": seconds,
        "stage": passage.phase.title,
        "iteration": item.number,
        "energy": item.energy,
        "condition": item.condition,
        "damping": item.damping.value,
    }
    photo = passage.photo
    if item.evaluation is not None and photo is not None:
        residual, used = item.evaluation.residual, item.evaluation.counted
        row["photo_rms"] = item.evaluation.rms
        row["psnr"] = psnr(photo + residual, photo, used, passage.view.problem.white)
    if truth is not None and truth.cheap:
        row |= truth.geometry_errors(passage.state)
    return row

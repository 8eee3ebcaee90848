"""What came of a case, read from the result folder itself, and the verdict on it."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from facestage.contract.files.storage import read_json, write_json
from facestage.contract.result import CONVERGED, PICTURES, Result
from facestage.contract.result_files import RESULT, TRACE
from facestage.images.image_io import read_photograph
from facestage.stress.case import DOUBT, FIT, REFUSAL, SLACK_MM, Case

ADVISED, REFUSED, CRASHED, HUNG = "advised", "refused", "crashed", "hung"


@dataclass(frozen=True)
class Outcome:
    """One row of the table. ``sentence`` is the advice, the refusal or the crash."""

    name: str
    kind: str  # CONVERGED, ADVISED, REFUSED, CRASHED or HUNG
    sentence: str
    seconds: float = 0.0
    iterations: int = 0
    mm: float | None = None  # similarity-aligned
    start_mm: float | None = None  # the same after the landmark stage
    psnr: float | None = None
    condition: float | None = None
    not_finite: tuple[str, ...] = ()  # names of what holds NaN or infinity
    warnings: tuple[str, ...] = ()  # numerical warnings on the way

    def save(self, path: Path) -> None:
        """Write the outcome as JSON."""
        write_json(path, asdict(self))

    @classmethod
    def load(cls, path: Path) -> Outcome:
        """Read what :meth:`save` wrote."""
        data = read_json(path, "stress outcome")
        values = {field.name: data[field.name] for field in fields(cls)}
        return cls(**values | {name: tuple(values[name]) for name in ("not_finite", "warnings")})


@dataclass(frozen=True)
class Verdict:
    """An outcome and what is wrong with it; nothing is, when ``faults`` is empty."""

    case: Case
    outcome: Outcome
    faults: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """True when the engine converged honestly, advised, or refused as it should."""
        return not self.faults


def judge(case: Case, outcome: Outcome) -> Verdict:
    """The faults of an outcome: crash, hang, NaN, or a claim to have converged that the truth
    denies.
    """
    faults = []
    if outcome.kind in (CRASHED, HUNG):
        faults.append(outcome.kind)
    if outcome.not_finite:
        faults.append(f"not finite: {', '.join(outcome.not_finite)}")
    if case.right == REFUSAL and outcome.kind in (CONVERGED, ADVISED):
        faults.append("should have been refused")
    if case.right == DOUBT and outcome.kind == CONVERGED:
        faults.append("silently wrong: claims to have converged on what cannot be fitted")
    if case.right == FIT and outcome.kind == REFUSED:
        faults.append("should not have been refused")
    if not outcome.sentence.strip():
        faults.append("no sentence says what happened")
    if outcome.kind == CONVERGED:
        faults += _lies(case, outcome)
    return Verdict(case, outcome, tuple(faults))


def _lies(case: Case, outcome: Outcome) -> list[str]:
    faults = []
    if case.worst_mm is not None and not _at_most(outcome.mm, case.worst_mm):
        faults.append(
            f"silently wrong: {_said(outcome.mm)} mm, at most {case.worst_mm:g} mm is right"
        )
    if case.worst_psnr is not None and not _at_most(case.worst_psnr, outcome.psnr):
        faults.append(
            f"silently wrong: {_said(outcome.psnr)} dB, at least {case.worst_psnr:g} dB is right"
        )
    if (
        outcome.mm is not None
        and outcome.start_mm is not None
        and not outcome.mm <= outcome.start_mm + SLACK_MM
    ):
        faults.append(
            f"worse than its start: {_said(outcome.mm)} mm from {_said(outcome.start_mm)} mm"
        )
    return faults


def _at_most(small: float | None, large: float | None) -> bool:
    return small is not None and large is not None and small <= large


def _said(value: float | None) -> str:
    return "none" if value is None else f"{value:.2f}"


def read_outcome(
    name: str, result: Result, folder: Path, seconds: float, warnings: tuple[str, ...]
) -> Outcome:
    """The outcome of a fit that wrote ``folder``, from its files: what a user would see."""
    trace = [json.loads(line) for line in (folder / TRACE).read_text(encoding="utf-8").splitlines()]
    errors = result.errors
    condition = float(result.arrays.get("condition", np.array(math.nan)))
    return Outcome(
        name=name,
        kind=CONVERGED if result.status == CONVERGED else ADVISED,
        sentence=result.advice,
        seconds=seconds,
        iterations=len(trace),
        mm=_number(errors.get("similarity_mm")),
        start_mm=_number(errors.get("landmark_stage_similarity_mm")),
        psnr=_number(errors.get("psnr")),
        condition=_number(condition),
        not_finite=not_finite(folder, trace),
        warnings=warnings,
    )


def _number(value: Any) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)


def not_finite(folder: Path, trace: list[dict[str, Any]]) -> tuple[str, ...]:
    """Names of the numbers of a result folder that are NaN or infinite, pictures included."""
    result = Result.load(folder)
    bad = [name for name, array in _arrays(result).items() if not np.isfinite(array).all()]
    data = read_json(folder / RESULT, "result file")
    # A result's JSON has null in the place of NaN.
    for group in ("errors", "energy", "timings"):
        bad += [f"{group}.{name}" for name, value in data[group].items() if value is None]
    if any(value is None for row in trace for value in row["energy"].values()):
        bad.append("trace energy")
    bad += [name for name in PICTURES if not read_photograph(folder / name).mask.all()]
    return tuple(bad)


def _arrays(result: Result) -> dict[str, np.ndarray]:
    named = {
        name: getattr(result, name) for name in ("vertices", "model_to_camera", "camera_to_stage")
    }
    named |= result.parameters
    named |= {"lights": result.stage.radiance, "light positions": result.stage.position}
    named |= {"focal": np.array(result.camera.focal_px)}
    # A standard deviation may be infinite, where nothing is known.
    return named | {
        name: np.where(np.isposinf(value), 0.0, value) if name.startswith("deviation") else value
        for name, value in result.arrays.items()
    }

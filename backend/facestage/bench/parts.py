"""What each part of the light's model costs a step, and gains, against the fit without it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from facestage.bench.settings import DEFAULT, PARTS
from facestage.bench.table import Final
from facestage.bench.trace import Row
from facestage.fit.stages.phases import PhaseName


@dataclass(frozen=True)
class PartGain:
    """One part over all cases: means of the fit with it less, or over, that without it."""

    words: str
    cases: int
    step_ratio: float  # seconds of a step of the last phase
    similarity_mm: float
    psnr: float  # dB
    albedo: float  # RMS; NaN where no truth says it


def part_gains(rows: Sequence[Row], finals: Sequence[Final]) -> list[PartGain]:
    """The parts that a bench left out, in their order."""
    whole = {item.case: item for item in finals if item.contender == DEFAULT.name}
    result = []
    for words in PARTS.values():
        pairs = [(whole[item.case], item) for item in finals if item.contender == words]
        if pairs:
            result.append(
                PartGain(
                    words,
                    len(pairs),
                    float(np.mean([_step(rows, one) / _step(rows, other) for one, other in pairs])),
                    _mean_change(pairs, "similarity_mm"),
                    _mean_change(pairs, "psnr"),
                    _mean_change(pairs, "albedo"),
                )
            )
    return result


def part_lines(gains: Sequence[PartGain]) -> list[str]:
    """The table, as text; nothing where no part was left out."""
    if not gains:
        return []
    head = (
        f"{'beside a fit with':30}{'cases':>6}{'a step':>9}{'shape mm':>10}{'dB':>7}{'albedo':>9}"
    )
    return [
        head,
        "-" * len(head),
        *(
            f"{each.words:30}{each.cases:>6}{each.step_ratio:>8.2f}x{each.similarity_mm:>+10.3f}"
            f"{each.psnr:>+7.1f}{each.albedo:>+9.4f}"
            for each in gains
        ),
    ]


def _step(rows: Sequence[Row], run: Final) -> float:
    """Median seconds between two steps of a run's last phase."""
    seconds = [
        row.seconds
        for row in rows
        if (row.case, row.contender, row.stage) == (run.case, run.contender, PhaseName.JOINT)
    ]
    return float(np.median(np.diff(seconds))) if len(seconds) > 1 else float("nan")


def _mean_change(pairs: Sequence[tuple[Final, Final]], name: str) -> float:
    """With the part less without it."""
    values = [(getattr(one, name), getattr(other, name)) for one, other in pairs]
    known = [(one, other) for one, other in values if one is not None and other is not None]
    return float(np.mean([one - other for one, other in known])) if known else float("nan")

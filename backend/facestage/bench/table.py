"""Seconds to reach an error, and ratios against the alternative of the same run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from facestage.bench.settings import ADAM, HARMONICS, OURS
from facestage.bench.trace import Row
from facestage.fit.runs.trace import DETAIL
from facestage.fit.stages.phases import PhaseName

# Errors people ask for: mm after similarity alignment (lower is better), dB in the photo (higher is
# better).
MILLIMETRES = (3.0, 2.5, 2.0, 1.75, 1.5, 1.3, 1.2, 1.1, 1.0)
DECIBELS = (
    20.0,
    22.0,
    23.0,
    24.0,
    25.0,
    26.0,
    27.0,
    28.0,
    29.0,
    30.0,
    31.0,
    32.0,
    34.0,
    36.0,
    38.0,
    40.0,
)


@dataclass(frozen=True)
class Measure:
    """A column of the trace and which way is better."""

    column: str
    label: str
    unit: str
    lower_is_better: bool
    thresholds: tuple[float, ...]

    def values(self, rows: Sequence[Row]) -> np.ndarray:
        """(n,) of the rows, NaN where a row has none."""
        found = [getattr(row, self.column) for row in rows]
        return np.array([np.nan if value is None else value for value in found], float)


SIMILARITY = Measure(
    "similarity_mm", "Shape error after similarity alignment", "mm", True, MILLIMETRES
)
PSNR = Measure("psnr", "Peak signal-to-noise ratio on the face", "dB", False, DECIBELS)
MEASURES = (SIMILARITY, PSNR)


@dataclass(frozen=True)
class Reach:
    """When each family was first at an error or better for good; None: never in its run."""

    case: str
    measure: Measure
    threshold: float
    seconds: dict[str, float | None]  # by family, the fastest contender of it
    ran: dict[str, float]  # by family, how long its longest contender ran

    @property
    def ratio(self) -> float | None:
        """How many times longer the alternative took; a lower bound when it never got there."""
        ours, theirs = self.seconds.get(OURS), self.seconds.get(ADAM)
        if ours is None or ADAM not in self.ran:
            return None
        ratio = (theirs if theirs is not None else self.ran[ADAM]) / max(ours, 1e-9)
        # That the alternative needs at least a part of our time says nothing.
        return ratio if theirs is not None or ratio >= 1 else None

    @property
    def is_bound(self) -> bool:
        """The alternative never got there: the ratio is at least this."""
        return self.ratio is not None and self.seconds.get(ADAM) is None


def seconds_to_reach(rows: Sequence[Row], measure: Measure, threshold: float) -> float | None:
    """Seconds from which a run's error stays at ``threshold`` or better until its end; None: it
    does not.
    """
    values = measure.values(rows)
    good = values <= threshold if measure.lower_is_better else values >= threshold
    if not len(rows) or not good[-1]:
        return None
    bad = np.flatnonzero(~good)
    return rows[int(bad[-1]) + 1 if len(bad) else 0].seconds


def reach_table(rows: Sequence[Row], main: Sequence[str]) -> list[Reach]:
    """For each case and measure, the thresholds that someone reaches and the common start does not.

    The start is the last row without lights: the landmark stage, which is the same for everyone; in
    dB, the worst of the first renders. The albedo detail does not count: whoever stops can add it,
    in the same closed form at the same cost. ``main`` names the contenders of our own fit and of
    the harmonics that count; of the alternative, each threshold takes whichever of its variants was
    fastest.
    """
    result = []
    for case in dict.fromkeys(row.case for row in rows):
        of_case = [row for row in rows if row.case == case and row.stage != DETAIL]
        runs = {
            (family, name): [
                row for row in of_case if (row.family, row.contender) == (family, name)
            ]
            for family, name in dict.fromkeys((row.family, row.contender) for row in of_case)
            if family == ADAM or name in main
        }
        ran: dict[str, float] = {}
        for (family, _), run in runs.items():
            ran[family] = max(ran.get(family, 0.0), run[-1].seconds)
        start = [row.similarity_mm for row in next(iter(runs.values())) if row.psnr is None]
        first_lit = [
            next((row.psnr for row in run if row.psnr is not None), -np.inf)
            for run in runs.values()
        ]
        for measure in MEASURES:
            for threshold in measure.thresholds:
                if measure is SIMILARITY and start and threshold >= start[-1]:
                    continue
                if measure is PSNR and threshold <= min(first_lit):
                    continue
                seconds: dict[str, float | None] = {
                    family: None for family in (OURS, ADAM, HARMONICS) if family in ran
                }
                for (family, _), run in runs.items():
                    found, best = seconds_to_reach(run, measure, threshold), seconds[family]
                    if found is not None:
                        seconds[family] = found if best is None else min(best, found)
                if any(value is not None for value in seconds.values()):
                    result.append(Reach(case, measure, threshold, seconds, ran))
    return result


@dataclass(frozen=True)
class Final:
    """Where a contender ended.

    ``psnr`` is of its parameters, ``detail_psnr`` with the albedo detail.
    """

    case: str
    family: str
    contender: str
    seconds: float
    similarity_mm: float
    rigid_mm: float
    psnr: float | None
    detail_psnr: float | None
    albedo: float | None
    light: float | None
    start_mm: float | None = None  # where its landmark stage ended
    total_seconds: float = 0.0  # with the albedo detail
    # Of a scan's points that the mesh covers: where the landmark stage and the fit ended.
    start_covered_mm: float | None = None
    covered_mm: float | None = None
    # Shares within one and two of the fit's own standard deviations.
    within_1: float | None = None
    within_2: float | None = None
    # Of the face's median albedo: individual typology angle in degrees, found and true, and the
    # distance of the shares of red, green and blue from the true ones.
    ita: float | None = None
    true_ita: float | None = None
    chromaticity: float | None = None
    # Degrees between found normals and true ones: the mesh's, and with the normal map.
    mesh_normal: float | None = None
    normal: float | None = None


def final(rows: Sequence[Row], errors: dict[str, float]) -> Final:
    """The end of one contender's run on one case."""
    fitted = [row for row in rows if row.stage != DETAIL]
    detail = [row for row in rows if row.stage == DETAIL]
    last = fitted[-1]
    start = [row for row in rows if row.stage == PhaseName.LANDMARKS]
    return Final(
        last.case,
        last.family,
        last.contender,
        last.seconds,
        last.similarity_mm,
        last.rigid_mm,
        last.psnr,
        detail[-1].psnr if detail else None,
        errors.get("albedo"),
        errors.get("light"),
        start[-1].similarity_mm if start else None,
        (detail or fitted)[-1].seconds,
        errors.get("landmark_stage_covered_mm"),
        errors.get("covered_mm"),
        errors.get("within_1_sigma"),
        errors.get("within_2_sigma"),
        errors.get("skin_tone"),
        errors.get("true_ita"),
        errors.get("chromaticity"),
        errors.get("mesh_normal_degrees"),
        errors.get("normal_degrees"),
    )


def final_lines(finals: Sequence[Final]) -> list[str]:
    """Where each contender ended, as text."""
    width = max([len(item.contender) for item in finals] + [9]) + 2
    head = (
        f"{'case':20}{'contender':{width}}{'seconds':>8}{'start mm':>10}"
        f"{'sim. mm':>9}{'rigid mm':>10}{'dB':>7}{'dB detail':>11}{'albedo':>8}{'light':>7}"
        f"{'mesh deg.':>11}{'with map':>10}"
    )
    lines = [head, "-" * len(head)]
    lines += [
        f"{item.case[:19]:20}{item.contender:{width}}{item.seconds:>8.1f}"
        f"{_fixed(item.start_mm, 2):>10}{item.similarity_mm:>9.2f}{item.rigid_mm:>10.2f}"
        f"{_fixed(item.psnr, 1):>7}{_fixed(item.detail_psnr, 1):>11}"
        f"{_fixed(item.albedo, 3):>8}{_fixed(item.light, 3):>7}"
        f"{_fixed(item.mesh_normal, 2):>11}{_fixed(item.normal, 2):>10}"
        for item in finals
    ]
    return lines


def reach_lines(table: Sequence[Reach]) -> list[str]:
    """Seconds to reach each error, as text."""
    head = (
        f"{'case':12}{'error':>10}{'Facestage s':>13}{'Adam s':>9}{'ratio':>9}{'harmonics s':>13}"
    )
    lines = [head, "-" * len(head)]
    for item in table:
        error = f"{item.threshold:g} {item.measure.unit}"
        lines.append(
            f"{item.case[:11]:12}{error:>10}{_fixed(item.seconds.get(OURS), 1):>13}"
            f"{adam_text(item):>9}{ratio_text(item):>9}{_fixed(item.seconds.get(HARMONICS), 1):>13}"
        )
    return lines


def adam_text(item: Reach) -> str:
    """Seconds of the alternative, or that its whole run was not enough."""
    seconds = item.seconds.get(ADAM)
    return f"> {item.ran[ADAM]:.0f}" if seconds is None and ADAM in item.ran else _fixed(seconds, 1)


def ratio_text(item: Reach) -> str:
    """The ratio, with a sign when it is a lower bound."""
    if item.ratio is None:
        return "-"
    return f"{'> ' if item.is_bound else ''}{item.ratio:.1f}x"


def _fixed(value: float | None, digits: int) -> str:
    return "-" if value is None or not np.isfinite(value) else f"{value:.{digits}f}"

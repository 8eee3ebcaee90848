"""Error against run time as curves, and where each setting ends, as pictures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from facestage.bench.settings import ADAM, FAMILIES, HARMONICS, OURS
from facestage.bench.table import MEASURES, Final, Measure
from facestage.bench.trace import Row
from facestage.fit.runs.trace import DETAIL
from facestage.fit.stages.phases import PhaseName
from facestage.report.figure import LIGHT, Canvas

COLORS = {OURS: LIGHT.series[0], ADAM: LIGHT.series[1], HARMONICS: "#3d7d55"}
WIDTH, PANEL_HEIGHT, LEFT, RIGHT, TOP, GAP, BOTTOM = 1080, 320, 64, 230, 92, 72, 54
LABEL_STEP, LABEL_WIDTH = 15.0, 210.0  # pixels between labels, and of the widest
FIRST_STAGES = (PhaseName.POSE, PhaseName.LANDMARKS)
CURVES, SETTINGS = "curves", "settings"  # kinds of pictures

HEADROOM = 0.45  # of the values' range, above the points


def draw_curves(path: Path, case: str, rows: Sequence[Row], main: Sequence[str]) -> None:
    """Each main contender's error of ``case`` against seconds on a logarithmic axis: mm, and dB."""
    canvas = Canvas(WIDTH, TOP + 2 * PANEL_HEIGHT + GAP + BOTTOM, LIGHT)
    canvas.text(LEFT, 28, f"{case}: error against run time", 14, weight="bold")
    _legend(canvas, [family for family in FAMILIES if any(row.family == family for row in rows)])
    for number, measure in enumerate(MEASURES):
        top = TOP + number * (PANEL_HEIGHT + GAP)
        axes = _axes(canvas, top, measure)
        ends = []
        for name in main:
            run = [row for row in rows if row.case == case and row.contender == name]
            values = measure.values(run)
            keep = np.isfinite(values)
            if not keep.any():
                continue
            seconds = np.array([row.seconds for row in run])[keep]
            color = COLORS[run[0].family]
            axes.plot(seconds, values[keep], color=color, lw=2, marker="o", ms=3.5, zorder=3)
            detail = np.array([row.stage == DETAIL for row in run])[keep]
            if measure.column == "psnr" and detail.any():
                axes.plot(
                    seconds[detail],
                    values[keep][detail],
                    ls="",
                    marker="o",
                    ms=9,
                    mfc="none",
                    mec=color,
                    mew=1.5,
                    clip_on=False,
                    zorder=4,
                )
            ends.append((seconds[-1], values[keep][-1], f"{values[keep][-1]:.2f} {name}", color))
        _leave_out_the_first_guess(
            axes, measure, [row for row in rows if row.case == case and row.contender in main]
        )
        _log_seconds(
            axes,
            [
                row.seconds
                for row in rows
                if row.case == case and row.contender in main and row.stage != FIRST_STAGES[0]
            ],
        )
        _label(axes, ends)
        if number == len(MEASURES) - 1:
            axes.set_xlabel(
                "seconds of optimisation (logarithmic); ring: with the albedo detail",
                color=LIGHT.muted,
                fontsize=10,
            )
    canvas.save(path)


def draw_settings(path: Path, case: str, finals: Sequence[Final]) -> None:
    """Where every contender of ``case`` ended: error against seconds, and the front that none is
    better than.
    """
    canvas = Canvas(WIDTH, TOP + 2 * PANEL_HEIGHT + GAP + BOTTOM, LIGHT)
    canvas.text(LEFT, 28, f"{case}: where each setting ends", 14, weight="bold")
    shown = [item for item in finals if item.case == case]
    _legend(canvas, [family for family in FAMILIES if any(item.family == family for item in shown)])
    for number, measure in enumerate(MEASURES):
        axes = _axes(canvas, TOP + number * (PANEL_HEIGHT + GAP), measure)
        points = [(item.seconds, getattr(item, measure.column), item) for item in shown]
        points = [point for point in points if point[1] is not None and np.isfinite(point[1])]
        for seconds, value, item in points:
            axes.plot(seconds, value, "o", ms=7, color=COLORS[item.family], zorder=3, clip_on=False)
        front = pareto_front(
            [(seconds, value) for seconds, value, _ in points], measure.lower_is_better
        )
        axes.plot(*zip(*front, strict=True), color=LIGHT.muted, lw=1, ls="--", zorder=2)
        _log_seconds(axes, [seconds for seconds, _, _ in points])
        # Labels of points that lie close together are stacked upward: not into the title.
        low, high = axes.get_ylim()
        axes.set_ylim(low, high + HEADROOM * (high - low))
        _label(
            axes,
            [(s, v, item.contender, COLORS[item.family]) for s, v, item in points],
            beside=True,
        )
        if number == len(MEASURES) - 1:
            axes.set_xlabel(
                "seconds of optimisation (logarithmic); dashed: nobody is both faster and better",
                color=LIGHT.muted,
                fontsize=10,
            )
    canvas.save(path)


def pareto_front(
    points: Sequence[tuple[float, float]], lower_is_better: bool
) -> list[tuple[float, float]]:
    """The points (seconds, value) than which no other is at most as slow and better, by seconds."""
    best, front = np.inf, []
    for seconds, value in sorted(
        points, key=lambda point: (point[0], point[1] if lower_is_better else -point[1])
    ):
        cost = value if lower_is_better else -value
        if cost < best:
            best = cost
            front.append((seconds, value))
    return front


def _axes(canvas: Canvas, top: float, measure: Measure) -> Any:
    direction = "lower" if measure.lower_is_better else "higher"
    canvas.text(
        LEFT,
        top - 12,
        f"{measure.label}, {measure.unit} ({direction} is better)",
        11,
        weight="bold",
    )
    axes = canvas.axes(LEFT, top, WIDTH - LEFT - RIGHT, PANEL_HEIGHT)
    axes.grid(axis="both", color=LIGHT.grid, lw=1, zorder=0)
    axes.set_axisbelow(True)
    return axes


def _leave_out_the_first_guess(axes: Any, measure: Measure, rows: Sequence[Row]) -> None:
    """The mean face is so far off that nothing else could be told apart: the axis begins where
    shape is fitted.
    """
    values = measure.values([row for row in rows if row.stage not in FIRST_STAGES])
    values = values[np.isfinite(values)]
    if measure.lower_is_better and values.size:
        axes.set_ylim(None, values.max() + 0.1 * np.ptp(values) + 1e-3)


def _legend(canvas: Canvas, families: Sequence[str]) -> None:
    x = float(LEFT)
    for family in families:
        canvas.text(x, 56, "●", 11, COLORS[family])
        canvas.text(x + 16, 56, FAMILIES[family], 10.5, LIGHT.muted)
        x += 40 + 8.2 * len(FAMILIES[family])


def _log_seconds(axes: Any, seconds: Sequence[float]) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

    axes.set_xscale("log")
    positive = [value for value in seconds if value > 0] or [1.0]
    axes.set_xlim(min(positive) / 1.15, max(positive) * 1.05)
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_major_locator(MaxNLocator(6))


def _label(axes: Any, ends: Sequence[tuple[float, float, str, str]], beside: bool = False) -> None:
    """Texts at the right of points; kept apart from each other, all of them or only close ones
    (``beside``).
    """
    placed: list[tuple[float, float]] = []
    for x, y, text, color in sorted(ends, key=lambda end: end[1]):
        across, height = (float(value) for value in axes.transData.transform((x, y)))
        wanted = free_height(
            height,
            [
                other
                for other_across, other in placed
                if not beside or abs(other_across - across) < LABEL_WIDTH
            ],
        )
        placed.append((across, wanted))
        axes.annotate(
            text,
            (x, y),
            xytext=(10, 0.72 * (wanted - height)),
            textcoords="offset points",
            color=color,
            fontsize=9.5,
            va="center",
            annotation_clip=False,
            arrowprops={"arrowstyle": "-", "color": color, "lw": 0.6}
            if wanted > height + 1
            else None,
        )


def free_height(height: float, taken: Sequence[float]) -> float:
    """The lowest place from ``height`` upward where a label is LABEL_STEP away from those
    ``taken``, in pixels.
    """
    # From the lowest upward, each once: what moves the label up cannot bring it near a lower one,
    # however the sum is rounded.
    for other in sorted(taken):
        if abs(other - height) < LABEL_STEP:
            height = other + LABEL_STEP
    return height


def picture_name(kind: str, case: str) -> str:
    """File name of a picture of a case."""
    return f"{kind}_{case}.png"


def has_sweep(finals: Sequence[Final], case: str, main: Sequence[str]) -> bool:
    """Whether contenders beside the main ones ran on ``case``."""
    return any(item.case == case and item.contender not in main for item in finals)

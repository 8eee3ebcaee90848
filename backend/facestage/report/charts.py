"""Error against run time, and the largest weights, as charts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from facestage.contract.result import Result
from facestage.report.figure import LIGHT, Canvas, Theme

WIDTH = 1080
LARGEST = 12
BAR_LABEL = 50  # pixels beside a bar for its value
_LEFT, _RIGHT = 70, 130


@dataclass(frozen=True)
class Panel:
    """One chart of the trace: a heading and the columns drawn in it."""

    heading: str
    columns: tuple[tuple[str, str], ...]  # (column of the trace, label)
    logarithmic: bool
    number_format: str


PANELS = (
    Panel("Photo residual, RMS, linear (lower is better)", (("photo_rms", ""),), True, "{:.3g}"),
    Panel("Peak signal-to-noise ratio, dB (higher is better)", (("psnr", ""),), False, "{:.1f}"),
    Panel(
        "Distance to the true vertices, mm (lower is better)",
        (("rigid_mm", "rigid"), ("similarity_mm", "similarity")),
        False,
        "{:.2f}",
    ),
)


def draw_trace(path: Path, trace: Sequence[Mapping[str, Any]]) -> None:
    """Each error of the trace against seconds on a logarithmic axis, the stages as shaded bands."""
    theme = LIGHT
    shown = [
        panel
        for panel in PANELS
        if any(np.isfinite(_column(trace, name)).any() for name, _ in panel.columns)
    ]
    if not shown:
        canvas = Canvas(WIDTH, 120, theme)
        canvas.text(WIDTH / 2, 66, "No iteration was recorded.", 12, theme.muted, ha="center")
        canvas.save(path)
        return
    seconds = _positive(_column(trace, "seconds"))
    bands = stage_bands([str(row.get("stage", "")) for row in trace], seconds)
    slanted = not _labels_fit(bands)
    names, height, gap = (76 if slanted else 18), 170, 56
    canvas = Canvas(WIDTH, names + len(shown) * (height + gap) + 36, theme)
    for number, panel in enumerate(shown):
        top = 38 + names + number * (height + gap)
        canvas.text(
            _LEFT, top - 12 - (names if number == 0 else 0), panel.heading, 11, weight="bold"
        )
        axes = canvas.axes(_LEFT, top, WIDTH - _LEFT - _RIGHT, height)
        _draw_panel(axes, panel, trace, seconds, theme)
        _draw_bands(axes, bands, theme)
        if number == 0:
            _label_bands(axes, bands, slanted, theme)
        if number == len(shown) - 1:
            axes.set_xlabel("seconds (logarithmic)", color=theme.muted, fontsize=10.5, labelpad=6)
    canvas.save(path)


def stage_bands(stages: Sequence[str], seconds: np.ndarray) -> list[tuple[str, float, float]]:
    """(stage, from, to) of each run of equal names; a band starts where the one before ended."""
    bands = []
    start, row = float(seconds[0]) / 1.25, 0
    for stage, run in groupby(stages):
        row += len(list(run))
        end = max(float(seconds[row - 1]), start * 1.0001)
        bands.append((stage, start, end))
        start = end
    return bands


def _column(trace: Sequence[Mapping[str, Any]], name: str) -> np.ndarray:
    values = [row.get(name) for row in trace]
    return np.array([np.nan if value is None else float(value) for value in values])


def _positive(seconds: np.ndarray) -> np.ndarray:
    """Seconds as a logarithmic axis can show them: what is not positive moves to just before the
    first that is.
    """
    usable = seconds[np.isfinite(seconds) & (seconds > 0)]
    first = float(usable.min()) if usable.size else 1.0
    cleaned = np.where(np.isfinite(seconds) & (seconds > 0), seconds, first / 1.5)
    return np.maximum.accumulate(cleaned)


def _draw_panel(
    axes: Any, panel: Panel, trace: Sequence[Mapping[str, Any]], seconds: np.ndarray, theme: Theme
) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

    axes.set_xscale("log")
    ends = []
    for (name, label), color in zip(panel.columns, theme.series, strict=False):
        values = _column(trace, name)
        good = np.isfinite(values) & ((values > 0) | (not panel.logarithmic))
        if not good.any():
            continue
        axes.plot(
            seconds[good],
            values[good],
            color=color,
            lw=2,
            marker="o",
            ms=4,
            zorder=3,
            clip_on=False,
        )
        ends.append((float(seconds[good][-1]), float(values[good][-1]), label, color))
    if panel.logarithmic and ends:
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.yaxis.set_minor_locator(NullLocator())
    else:
        axes.yaxis.set_major_locator(MaxNLocator(5))
    axes.set_xlim(seconds[0] / 1.25, seconds[-1] * 1.05)
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.grid(axis="y", color=theme.grid, lw=1, zorder=0)
    axes.set_axisbelow(True)
    _label_ends(axes, panel, ends)


def _label_ends(axes: Any, panel: Panel, ends: list[tuple[float, float, str, str]]) -> None:
    """The last value of each line at its right, kept apart where lines end close together."""
    least = 16.0  # pixels
    order = sorted(ends, key=lambda end: end[1])
    shift, previous = 0.0, -np.inf
    for x, y, label, color in order:
        height = float(axes.transData.transform((x, y))[1])
        shift = max(0.0, previous + least - height)
        previous = height + shift
        text = f"{panel.number_format.format(y)} {label}".strip()
        axes.annotate(
            text,
            (x, y),
            xytext=(8, 0.72 * shift),
            textcoords="offset points",
            color=color,
            fontsize=10.5,
            weight="bold",
            va="center",
            annotation_clip=False,
        )


def _draw_bands(axes: Any, bands: list[tuple[str, float, float]], theme: Theme) -> None:
    for number, (_, start, end) in enumerate(bands):
        if number % 2 == 0:
            axes.axvspan(start, end, color=theme.band, lw=0, zorder=-1)


def _labels_fit(bands: list[tuple[str, float, float]]) -> bool:
    """Whether each stage's name is narrower than its band (about 7 pixels a letter)."""
    total = np.log(max(bands[-1][2] * 1.05 / bands[0][1], 1.0001))
    width = WIDTH - _LEFT - _RIGHT
    return all(
        7.0 * len(name) + 6 < width * np.log(end / start) / total for name, start, end in bands
    )


def _label_bands(
    axes: Any, bands: list[tuple[str, float, float]], slanted: bool, theme: Theme
) -> None:
    for name, start, end in bands:
        axes.annotate(
            name.replace("_", " "),
            (float(np.sqrt(start * end)), 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, 5),
            textcoords="offset points",
            color=theme.muted,
            fontsize=10,
            ha="left" if slanted else "center",
            va="bottom",
            rotation=28 if slanted else 0,
            rotation_mode="anchor",
        )


def draw_weights(path: Path, result: Result) -> None:
    """The largest identity coefficients and expression weights as horizontal bars."""
    theme = LIGHT
    columns = (
        (
            "Identity, standard deviations",
            largest(result.identity_names, result.identity),
            theme.series[0],
        ),
        (
            "Expression, weight",
            largest(result.expression_names, result.expression),
            theme.series[1],
        ),
    )
    rows = max(1, *(len(bars) for _, bars, _ in columns))
    height = 26 * rows
    canvas = Canvas(WIDTH, height + 96, theme)
    for number, (heading, bars, color) in enumerate(columns):
        left = 20 + number * WIDTH / 2
        canvas.text(left, 30, heading, 11.5, weight="bold")
        if not bars:
            canvas.text(left, 70, "all zero", 11, theme.muted)
            continue
        label = min(220.0, 16 + 7.2 * max(len(name) for name, _ in bars))
        axes = canvas.axes(left + label, 46, WIDTH / 2 - label - 80, 26 * len(bars))
        _draw_bars(axes, bars, color, theme)
    canvas.save(path)


def largest(
    names: Sequence[str], weights: np.ndarray, count: int = LARGEST
) -> list[tuple[str, float]]:
    """Up to ``count`` (name, weight) pairs of the largest absolute weights that are not zero,
    largest first.
    """
    values = np.nan_to_num(np.asarray(weights, np.float64).reshape(-1))
    labels = (
        names
        if len(names) == len(values)
        else [f"mode {number}" for number in range(1, len(values) + 1)]
    )
    order = np.argsort(-np.abs(values), kind="stable")[:count]
    return [(labels[index], float(values[index])) for index in order if abs(values[index]) > 1e-6]


def _draw_bars(axes: Any, bars: list[tuple[str, float]], color: str, theme: Theme) -> None:
    from matplotlib.ticker import MaxNLocator

    values = np.array([value for _, value in bars])
    places = np.arange(len(bars))
    axes.barh(places, values, height=0.62, color=color, lw=0, zorder=2)
    low, high = min(0.0, values.min()), max(0.0, values.max())
    pad = BAR_LABEL * (high - low) / (axes.bbox.width - 2 * BAR_LABEL)
    axes.set_xlim(low - (pad if low < 0 else 0), high + (pad if high > 0 else 0))
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.set_ylim(len(bars) - 0.5, -0.5)
    axes.set_yticks(places, [_shortened(name) for name, _ in bars], color=theme.text, fontsize=10)
    axes.axvline(0, color=theme.muted, lw=1, zorder=3)
    axes.grid(axis="x", color=theme.grid, lw=1, zorder=0)
    axes.set_axisbelow(True)
    for place, value in zip(places, values, strict=True):
        axes.annotate(
            f"{value:.2f}".replace("-", "−"),
            (value, place),
            xytext=(5 if value >= 0 else -5, 0),
            textcoords="offset points",
            ha="left" if value >= 0 else "right",
            va="center",
            color=theme.muted,
            fontsize=9.5,
            annotation_clip=False,
        )


def _shortened(name: str, length: int = 28) -> str:
    return name if len(name) <= length else f"{name[: length - 1]}…"

"""A bench's outcome as files: CSV tables, pictures, and one HTML page that needs nothing else."""

from __future__ import annotations

import base64
import csv
from collections.abc import Sequence
from dataclasses import dataclass, fields
from html import escape
from pathlib import Path

import numpy as np

from facestage.bench.charts import (
    CURVES,
    SETTINGS,
    draw_curves,
    draw_settings,
    has_sweep,
    picture_name,
)
from facestage.bench.settings import HARMONICS, OURS
from facestage.bench.table import Final, Reach, adam_text, final_lines, ratio_text, reach_lines
from facestage.bench.trace import Row
from facestage.contract.files.atomic import atomic_file
from facestage.report.page_style import CSS

TRACE_CSV, REACH_CSV, FINAL_CSV, TEXT, PAGE = (
    "trace.csv",
    "reach.csv",
    "final.csv",
    "bench.txt",
    "bench.html",
)
REACH_COLUMNS = (
    "case",
    "measure",
    "threshold",
    "ours_seconds",
    "adam_seconds",
    "harmonics_seconds",
    "ratio",
    "bound",
)


@dataclass(frozen=True)
class Bench:
    """Everything that one run measured."""

    rows: list[Row]
    finals: list[Final]
    table: list[Reach]
    main: tuple[str, ...]  # names of the contenders that ran on every case
    about: tuple[str, ...]  # sentences: the cases, the machine, the cold start


def text_lines(bench: Bench) -> list[str]:
    """What the command prints when all is done."""
    return [
        *bench.about,
        "",
        "Where each contender ended",
        *final_lines(bench.finals),
        "",
        "Seconds until an error is reached for good (ratio: Adam's over Facestage's, in this run)",
        *reach_lines(bench.table),
    ]


def write_bench(folder: Path, bench: Bench) -> None:
    """Write CSV files, pictures, text and page into ``folder``, which exists."""
    _write_csv(
        folder / TRACE_CSV,
        [field.name for field in fields(Row)],
        [_values(row) for row in bench.rows],
    )
    _write_csv(
        folder / FINAL_CSV,
        [field.name for field in fields(Final)],
        [_values(item) for item in bench.finals],
    )
    _write_csv(folder / REACH_CSV, REACH_COLUMNS, [_reach_values(item) for item in bench.table])
    pictures = []
    for case in dict.fromkeys(row.case for row in bench.rows):
        path = folder / picture_name(CURVES, case)
        draw_curves(path, case, bench.rows, bench.main)
        pictures.append(
            (path, f"{case}: error against seconds of optimisation, every contender judged alike")
        )
        if has_sweep(bench.finals, case, bench.main):
            path = folder / picture_name(SETTINGS, case)
            draw_settings(path, case, bench.finals)
            pictures.append(
                (path, f"{case}: where each budget, resolution and number of samples ends")
            )
    for name, text in (
        (TEXT, "\n".join(text_lines(bench)) + "\n"),
        (PAGE, build_page(bench, pictures)),
    ):
        with atomic_file(folder / name) as temporary:
            temporary.write_text(text, encoding="utf-8")


def build_page(bench: Bench, pictures: Sequence[tuple[Path, str]]) -> str:
    """The page; ``pictures`` (file, caption) become part of it."""
    figures = "".join(
        f'<figure><div class="chart wide"><img alt="{escape(caption)}" src="data:image/png;base64,'
        f'{base64.b64encode(path.read_bytes()).decode()}"></div><figcaption>{escape(caption)}</figcaption></figure>\n'
        for path, caption in pictures
    )
    about = "".join(f"<p>{escape(sentence)}</p>" for sentence in bench.about)
    final_head = (
        "Case",
        "Contender",
        "Seconds",
        "Start, mm",
        "Similarity, mm",
        "Rigid, mm",
        "dB",
        "dB with detail",
        "Albedo",
        "Light",
    )
    final_rows = [
        (
            item.case,
            item.contender,
            f"{item.seconds:.1f}",
            _fixed(item.start_mm, 2),
            f"{item.similarity_mm:.2f}",
            f"{item.rigid_mm:.2f}",
            *(
                _fixed(value, digits)
                for value, digits in (
                    (item.psnr, 1),
                    (item.detail_psnr, 1),
                    (item.albedo, 3),
                    (item.light, 3),
                )
            ),
        )
        for item in bench.finals
    ]
    reach_head = ("Case", "Error", "Facestage, s", "Adam, s", "Ratio", "Harmonics, s")
    reach_rows = [
        (
            item.case,
            f"{item.threshold:g} {item.measure.unit}",
            _fixed(item.seconds.get(OURS), 1),
            adam_text(item),
            ratio_text(item),
            _fixed(item.seconds.get(HARMONICS), 1),
        )
        for item in bench.table
    ]
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width,initial-scale=1">\n'
        f"<title>Bench – Facestage</title>\n<style>{CSS}</style>\n</head>\n<body>\n<main>\n"
        '<header><p class="eyebrow">Facestage bench</p><h1>Error against run time</h1>\n'
        f"{about}</header>\n{figures}"
        '<section><h2>Seconds to reach an error</h2><div class="card"><p class="note">From '
        "the start of "
        "optimisation until the error is reached and kept, without the albedo detail. Of Mitsuba + "
        "Adam the fastest variant counts; &gt;: its whole run was not enough.</p>"
        f"{_table(reach_head, reach_rows, 1)}</div></section>\n"
        '<section><h2>Where each contender ended</h2><div class="card"><p class="note">mm: '
        "mean distance of the "
        "narrow face's vertices from the truth. dB: of the fitted parameters, and with the "
        "per-texel albedo detail. "
        "Albedo and light: errors with the best single scale factored out.</p>"
        f"{_table(final_head, final_rows, 2)}</div></section>\n</main>\n</body>\n</html>\n"
    )


def _table(head: Sequence[str], rows: Sequence[Sequence[str]], words: int) -> str:
    """The first ``words`` columns are words, the rest numbers."""

    def line(tag: str, cells: Sequence[str]) -> str:
        marks = ["" if number < words else ' class="n"' for number in range(len(cells))]
        return "".join(
            f"<{tag}{mark}>{escape(cell)}</{tag}>" for mark, cell in zip(marks, cells, strict=True)
        )

    body = "\n".join(f"<tr>{line('td', row)}</tr>" for row in rows)
    return f"<table><thead><tr>{line('th', head)}</tr></thead><tbody>\n{body}\n</tbody></table>"


def _write_csv(path: Path, columns: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    with (
        atomic_file(path) as temporary,
        temporary.open("w", newline="", encoding="utf-8") as stream,
    ):
        writer = csv.writer(stream)
        writer.writerow(columns)
        writer.writerows(rows)


def _values(item: Row | Final) -> list[object]:
    values = [getattr(item, field.name) for field in fields(item)]
    return [
        f"{value:.6g}" if isinstance(value, float) else "" if value is None else value
        for value in values
    ]


def _reach_values(item: Reach) -> list[object]:
    seconds = [item.seconds.get(family) for family in ("ours", "adam", "harmonics")]
    numbers = ["" if value is None else f"{value:.6g}" for value in (*seconds, item.ratio)]
    return [item.case, item.measure.column, item.threshold, *numbers, int(item.is_bound)]


def _fixed(value: float | None, digits: int) -> str:
    return "–" if value is None or not np.isfinite(value) else f"{value:.{digits}f}"

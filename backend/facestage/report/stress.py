"""The table of the stress cases: as text line by line, as one HTML page, and as JSON for
programs.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from html import escape
from pathlib import Path

from facestage.contract.errors import InputError
from facestage.contract.files.atomic import atomic_file
from facestage.contract.files.storage import write_json
from facestage.report.page_style import CSS
from facestage.report.tables import NOTHING, number

CONVERGED = "converged"
NAME_WIDTH, KIND_WIDTH, PAGE_WIDTH = 27, 10, 118
# The badges of the fit's report, by outcome.
BADGES = {"converged": "converged", "advised": "budget_spent", "refused": "budget_spent"}
WORDS = {
    "converged": "Converged",
    "advised": "Stopped with advice",
    "refused": "Refused",
    "crashed": "Crashed",
    "hung": "Hung",
}
TABLE_CSS = """\
main{max-width:1400px}
td.case{min-width:210px}td.case b{white-space:nowrap}
td.case span,td.said{color:var(--muted);font-size:13.5px}
td.said{min-width:280px}
tr.failed td{background:color-mix(in srgb,var(--bad) 9%,transparent)}
.fault{color:var(--bad);font-weight:600}
.badge{margin:0;font-size:12.5px;padding:1px 9px}
"""


@dataclass(frozen=True)
class StressRow:
    """One case: what came of it and, in ``faults``, what is wrong with that."""

    name: str
    about: str
    kind: str  # converged, advised, refused, crashed or hung
    sentence: str
    faults: tuple[str, ...]
    mm: float | None  # mean vertex distance, similarity-aligned
    start_mm: float | None  # the same after the landmark stage
    psnr: float | None
    condition: float | None  # of the last damped system
    iterations: int
    seconds: float
    warnings: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """True when nothing is wrong."""
        return not self.faults


def head_lines() -> list[str]:
    """The head of the text table."""
    head = (
        f"     {'case':{NAME_WIDTH}}{'outcome':{KIND_WIDTH}}{'mm':>6}{'start':>7}{'dB':>7}"
        f"{'condition':>11}{'steps':>6}{'s':>7}"
    )
    return [head, "-" * len(head)]


def row_lines(row: StressRow) -> list[str]:
    """A case as text: its numbers, and below them what it said unless it simply converged."""
    numbers = (
        f"{'ok  ' if row.passed else 'FAIL'} "
        f"{row.name:{NAME_WIDTH}}{row.kind:{KIND_WIDTH}}{_fixed(row.mm):>6}"
        f"{_fixed(row.start_mm):>7}{_fixed(row.psnr, 1):>7}{_power(row.condition):>11}"
        f"{row.iterations or NOTHING!s:>6}{row.seconds:>7.1f}"
    )
    remarks = [f"! {fault}" for fault in row.faults] + [
        f"warning: {warning}" for warning in row.warnings
    ]
    if row.kind != CONVERGED:
        remarks.append(row.sentence)
    indent = " " * 5
    return [
        numbers,
        *(
            line
            for remark in remarks
            for line in textwrap.wrap(
                remark, PAGE_WIDTH, initial_indent=indent, subsequent_indent=indent + "  "
            )
        ),
    ]


def summary_line(rows: Sequence[StressRow]) -> str:
    """One sentence: how many cases there were, what came of them, and whether any lied."""
    counts = [
        f"{sum(row.kind == kind for row in rows)} {word.lower()}" for kind, word in WORDS.items()
    ]
    failed = [row.name for row in rows if not row.passed]
    verdict = (
        f"FAILED: {', '.join(failed)}"
        if failed
        else "none is NaN, hangs, crashes or is silently wrong"
    )
    seconds = sum(row.seconds for row in rows)
    return f"{len(rows)} cases in {seconds:.0f} s: {', '.join(counts)}; {verdict}."


def make_folder(folder: Path) -> None:
    """Make the report's folder if need be. Raises InputError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"Cannot make the folder '{folder}' ({error.strerror or error}); choose another."
        ) from error


def write_stress_report(folder: Path, rows: Sequence[StressRow]) -> None:
    """Write stress.txt, stress.html and stress.json into ``folder``, which is made if need be."""
    make_folder(folder)
    lines = [*head_lines(), *(line for row in rows for line in row_lines(row)), summary_line(rows)]
    for name, text in (
        ("stress.txt", "\n".join(lines) + "\n"),
        ("stress.html", build_stress_page(rows)),
    ):
        with atomic_file(folder / name) as temporary:
            temporary.write_text(text, encoding="utf-8")
    write_json(
        folder / "stress.json", {"cases": [asdict(row) | {"passed": row.passed} for row in rows]}
    )


def build_stress_page(rows: Sequence[StressRow]) -> str:
    """The table as a page that needs no other file and no network."""
    failed = sum(not row.passed for row in rows)
    tiles = [("Cases", str(len(rows)))]
    tiles += [(word, str(sum(row.kind == kind for row in rows))) for kind, word in WORDS.items()]
    tiles.append(("At fault", str(failed)))
    tile_html = "".join(
        f"<div><dt>{escape(label)}</dt><dd>{escape(value)}</dd></div>" for label, value in tiles
    )
    head = "".join(
        f"<th{cell}>{text}</th>"
        for text, cell in (
            ("Case", ""),
            ("Outcome", ""),
            ("mm", ' class="n"'),
            ("at start", ' class="n"'),
            ("dB", ' class="n"'),
            ("Condition", ' class="n"'),
            ("Steps", ' class="n"'),
            ("s", ' class="n"'),
            ("What it said", ""),
        )
    )
    body = "\n".join(_html_row(row) for row in rows)
    note = (
        "mm: mean vertex distance from the truth after similarity alignment, and the same "
        "after the landmark stage. "
        "dB: PSNR on the face. Condition: of the last damped system, scaled to a unit "
        "diagonal. A case is at fault "
        "when it crashes, hangs, holds NaN or infinity, or claims to have converged beyond "
        "its bounds."
    )
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width,initial-scale=1">\n'
        "<title>Stress cases – "
        f"Facestage</title>\n<style>{CSS}{TABLE_CSS}</style>\n</head>\n<body>\n<main>\n"
        '<header>\n<p class="eyebrow">Facestage stress</p>\n<h1>Stiff and extreme cases</h1>\n'
        f'<p class="advice">{escape(summary_line(rows))}</p>\n<dl '
        f'class="tiles">{tile_html}</dl>\n</header>\n'
        f'<section><h2>Cases</h2><div class="card"><p class="note">{escape(note)}</p>'
        f"<table><thead><tr>{head}</tr></thead><tbody>\n{body}\n</tbody></table></div></section>\n"
        "</main>\n</body>\n</html>\n"
    )


def _html_row(row: StressRow) -> str:
    badge = BADGES.get(row.kind, "stopped")
    said = "".join(f'<div class="fault">{escape(fault)}</div>' for fault in row.faults) + escape(
        row.sentence
    )
    said += "".join(f"<div>Warning: {escape(warning)}</div>" for warning in row.warnings)
    numbers = (
        _fixed(row.mm),
        _fixed(row.start_mm),
        _fixed(row.psnr, 1),
        number(row.condition, 3),
        str(row.iterations or NOTHING),
        f"{row.seconds:.1f}",
    )
    cells = "".join(f'<td class="n">{escape(value)}</td>' for value in numbers)
    failed = "" if row.passed else ' class="failed"'
    return (
        f"<tr{failed}><td "
        f'class="case"><b>{escape(row.name)}</b><br><span>{escape(row.about)}</span></td>'
        '<td><span class="badge '
        f'{badge}">{escape(WORDS.get(row.kind, row.kind))}</span></td>{cells}'
        f'<td class="said">{said}</td></tr>'
    )


def _fixed(value: float | None, digits: int = 2) -> str:
    return NOTHING if value is None else f"{value + 0.0:.{digits}f}"


def _power(value: float | None) -> str:
    return NOTHING if value is None else f"{value:.1e}"

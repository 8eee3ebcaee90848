"""What a person looks at after a batch: each photo beside its fit, what is known of it, and why
some have none.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from html import escape
from pathlib import Path
from statistics import median
from urllib.parse import quote

from facestage.contract.batch import FAILED, FITS, BatchRow
from facestage.contract.files.atomic import atomic_file
from facestage.contract.files.paths import is_file
from facestage.contract.result import BUDGET_SPENT, CONVERGED, STOPPED
from facestage.contract.result_files import PERSON_PICTURE, PERSON_REPORT, REPORT, SEQUENCE_FILM
from facestage.report.page import STATUS_WORDS
from facestage.report.page_style import CSS
from facestage.report.tables import NOTHING

PHOTO, FIT = "face_photo.png", "face.png"  # of a result
THUMBNAIL = 112  # pixels
WORDS = {**STATUS_WORDS, FAILED: "Failed"}
PAGE_CSS = """\
main{max-width:1300px}
td.pictures{white-space:nowrap}
td.pictures img{display:inline-block;height:112px;width:auto;border-radius:6px;margin-right:4px;
 background:#17191e}
td.said{color:var(--muted);min-width:240px}
tr.failed td{background:color-mix(in srgb,var(--bad) 9%,transparent)}
tr.failed td.said{color:var(--bad)}
.failed .badge,.badge.failed{color:var(--bad)}
td .badge{margin:0;font-size:12.5px;padding:1px 9px}
"""


def write_batch_report(out: Path, rows: Sequence[BatchRow], total: int, seconds: float) -> None:
    """Write report.html into the batch's folder ``out``; of ``total`` rows, those that ended."""
    with atomic_file(out / REPORT) as temporary:
        temporary.write_text(_page(out, rows, total, seconds), encoding="utf-8")


def picture_of(out: Path, row: BatchRow) -> Path | None:
    """The picture that shows the fit of a row, if there is one."""
    for name in (FIT, PERSON_PICTURE, SEQUENCE_FILM):
        path = out / FITS / row.name / name
        if is_file(path):
            return path
    return None


def _page(out: Path, rows: Sequence[BatchRow], total: int, seconds: float) -> str:
    failed = sum(row.failed for row in rows)
    words = f"{len(rows) - failed} of {total} rows were fitted"
    words += f", {failed} could not be." if failed else "."
    if len(rows) < total:
        words += f" {total - len(rows)} are left: --resume goes on with them."
    status, badge = (STOPPED, "Some failed") if failed else (CONVERGED, "Done")
    if len(rows) < total:
        status, badge = BUDGET_SPENT, "Cut off"
    tiles = "".join(
        f"<div><dt>{escape(label)}</dt><dd>{escape(value)} <span>{unit}</span></dd></div>"
        for label, value, unit in _figures(rows, seconds)
    )
    head = "".join(
        f"<th{' class=n' if number else ''}>{text}</th>"
        for text, number in (
            ("Photo and fit", False),
            ("Name", False),
            ("", False),
            ("PSNR, skin", True),
            ("From truth", True),
            ("Run time", True),
            ("What the fit says", False),
        )
    )
    body = "\n".join(_row(out, row) for row in rows)
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width,initial-scale=1">\n'
        f"<title>{total} rows – Facestage</title>\n<style>{CSS}{PAGE_CSS}</style>\n</head>\n"
        '<body>\n<main>\n<header>\n<p class="eyebrow">Facestage batch report</p>\n'
        f"<h1>{escape(out.name)}</h1>\n"
        f'<p class="advice"><span class="badge {status}">{badge}</span>{escape(words)}</p>\n'
        f'<dl class="tiles">{tiles}</dl>\n</header>\n'
        f'<section>\n<h2>Fits</h2>\n<div class="card"><table><thead><tr>{head}</tr></thead>'
        f"<tbody>\n{body}\n</tbody></table></div>\n</section>\n</main>\n</body>\n</html>\n"
    )


def _figures(rows: Sequence[BatchRow], seconds: float) -> list[tuple[str, str, str]]:
    fitted = [row for row in rows if not row.failed]
    figures = [
        ("Fitted", str(len(fitted)), ""),
        ("Failed", str(len(rows) - len(fitted)), ""),
        ("This run", f"{seconds:.0f}", "s"),
    ]
    for key, label, unit in (
        ("psnr_skin", "PSNR on the skin, median", "dB"),
        ("similarity_mm", "From truth, median", "mm"),
    ):
        values = [row.errors[key] for row in fitted if key in row.errors]
        if values:
            figures.append((label, f"{median(values):.{1 if unit == 'dB' else 2}f}", unit))
    if fitted:
        figures.append(("A fit, median", f"{median(row.seconds for row in fitted):.0f}", "s"))
    return figures


def _row(out: Path, row: BatchRow) -> str:
    folder = out / FITS / row.name
    name = f"<b>{escape(row.name)}</b>"
    pictures = ""
    if not row.failed:
        report = next((one for one in (REPORT, PERSON_REPORT) if is_file(folder / one)), None)
        if report is not None:
            name = f'<a href="{FITS}/{quote(row.name)}/{report}">{name}</a>'
        picture = picture_of(out, row)
        if picture is not None:
            shown = [folder / PHOTO, picture] if picture.name == FIT else [picture]
            pictures = "".join(_thumbnail(path) for path in shown if is_file(path))
    numbers = (
        _fixed(row.errors.get("psnr_skin"), 1, "dB"),
        _fixed(row.errors.get("similarity_mm"), 2, "mm"),
        _fixed(row.seconds, 1, "s"),
    )
    cells = "".join(f'<td class="n">{cell}</td>' for cell in numbers)
    failed = ' class="failed"' if row.failed else ""
    photos = ", ".join(Path(photo).name for photo in row.photos)
    return (
        f'<tr{failed}><td class="pictures">{pictures}</td>'
        f'<td>{name}<br><span class="unit">{escape(photos)}</span></td>'
        f'<td><span class="badge {escape(row.status)}">{escape(WORDS[row.status])}</span></td>'
        f'{cells}<td class="said">{escape(row.sentence)}</td></tr>'
    )


def _thumbnail(path: Path) -> str:
    from PIL import Image

    buffer = io.BytesIO()
    with Image.open(path) as image:
        # Twice as large as it is shown, for screens of fine pixels.
        image.thumbnail((8 * THUMBNAIL, 2 * THUMBNAIL))
        image.convert("RGB").save(buffer, format="JPEG", quality=85)
    content = base64.b64encode(buffer.getvalue()).decode("ascii")
    return f'<img src="data:image/jpeg;base64,{content}" alt="{escape(path.stem)}">'


def _fixed(value: float | None, digits: int, unit: str) -> str:
    if value is None:
        return NOTHING
    return f'{value:.{digits}f} <span class="unit">{unit}</span>'

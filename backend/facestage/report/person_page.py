"""One picture and one page for several photos of a person: each photo beside its fit, and the skin
that they share.
"""

from __future__ import annotations

import shlex
from html import escape
from pathlib import Path

import numpy as np

from facestage.contract.files.atomic import atomic_file
from facestage.contract.person import Person
from facestage.contract.result_files import PERSON_PICTURE, PERSON_REPORT
from facestage.report.figure import DARK, Canvas
from facestage.report.page import STATUS_WORDS, data_uri
from facestage.report.page_style import CSS

PANEL, GAP, MARGIN, TITLE = 300.0, 10.0, 16.0, 28.0


def write_person_report(folder: Path, person: Person) -> None:
    """Write person.png and person.html into a folder that holds the photos' own results with their
    pictures.
    """
    with atomic_file(folder / PERSON_PICTURE) as temporary:
        _draw(folder, person, temporary)
    with atomic_file(folder / PERSON_REPORT) as temporary:
        temporary.write_text(_page(folder, person), encoding="utf-8")


def _draw(folder: Path, person: Person, path: Path) -> None:
    """A column per photo, photo above fit, and the albedo of all of them at the end."""
    count = len(person.photos)
    width = 2 * MARGIN + count * (PANEL + GAP) + 2 * PANEL + GAP
    canvas = Canvas(width, 2 * MARGIN + TITLE + 2 * PANEL + GAP, DARK)
    top = MARGIN + TITLE
    for index, photo in enumerate(person.photos):
        left = MARGIN + index * (PANEL + GAP)
        title = f"{photo.number}  {Path(photo.image).name}"
        canvas.text(
            left, MARGIN + 14, title if len(title) < 36 else f"{title[:34]}…", 11, weight="bold"
        )
        for row, name in enumerate(("face_photo.png", "face.png")):
            canvas.picture(
                left,
                top + row * (PANEL + GAP),
                PANEL,
                PANEL,
                _picture(folder / photo.folder / name),
            )
    left = MARGIN + count * (PANEL + GAP)
    canvas.text(left, MARGIN + 14, "Albedo from all photos", 11, weight="bold")
    albedo = _picture(folder / person.photos[0].folder / "albedo.png")
    canvas.picture(left, top, 2 * PANEL + GAP, 2 * PANEL + GAP, albedo)
    canvas.save(path)


def _picture(path: Path) -> np.ndarray:
    from PIL import Image

    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))


def _page(folder: Path, person: Person) -> str:
    rows = "".join(
        f'<tr><td>{photo.number}</td><td><a href="{escape(photo.folder, quote=True)}/report.html">'
        f"{escape(Path(photo.image).name)}</a></td><td>{'yes' if photo.shares_shape else 'no'}</td>"
        f"<td>{escape(_decibel(photo.errors))}</td><td>{escape(photo.advice)}</td></tr>"
        for photo in person.photos
    )
    folders = " ".join(shlex.quote(photo.folder) for photo in person.photos)
    repeat = escape(f"facestage fit --job {folders} --same-person --out ../again")
    words = STATUS_WORDS.get(person.status, person.status)
    picture = data_uri((folder / PERSON_PICTURE).read_bytes())
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width,initial-scale=1">\n'
        f"<title>{len(person.photos)} photos of one person – "
        f"Facestage</title>\n<style>{CSS}</style>\n</head>\n"
        '<body>\n<main>\n<header>\n<p class="eyebrow">Facestage fit report</p>\n'
        f"<h1>{len(person.photos)} photos of one person</h1>\n"
        f'<p class="advice"><span class="badge {escape(person.status)}">{escape(words)}</span>'
        f"{escape(person.advice)}</p>\n</header>\n"
        '<section>\n<h2>Photos and fits</h2>\n<figure class="dark"><img alt="Each photo above '
        "its fit, and the albedo "
        f'of all photos" src="{picture}"></figure>\n</section>\n'
        '<section>\n<h2>Each photo</h2>\n<div class="card"><table><tr><th></th><th>Photo and '
        "its report</th>"
        "<th>Shares the shape</th><th>PSNR of the skin</th><th>What the fit "
        f"says</th></tr>{rows}</table></div>\n"
        "</section>\n<section>\n<h2>Repeat this fit</h2>\n"
        '<div class="card">The jobs as they were resolved lie in the folders beside this '
        "page. In this folder, run"
        f"<pre><code>{repeat}</code></pre></div>\n</section>\n</main>\n</body>\n</html>\n"
    )


def _decibel(errors: dict[str, float]) -> str:
    value = errors.get("psnr_skin")
    return "–" if value is None else f"{value:.1f} dB"

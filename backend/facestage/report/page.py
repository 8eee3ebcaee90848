"""The report as one HTML page that needs no other file and no network."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

import numpy as np

from facestage.contract.result import BUDGET_SPENT, CONVERGED, STOPPED
from facestage.contract.texture_maps import TEXTURE_MAPS, TextureMap
from facestage.report import tables
from facestage.report.certainty import CERTAINTY
from facestage.report.page_style import COMPARE_INPUT, CSS
from facestage.report.pictures import landmark_distances
from facestage.report.report_data import ReportData
from facestage.report.tables import Row

STATUS_WORDS = {
    CONVERGED: "Converged",
    BUDGET_SPENT: "Time budget spent",
    STOPPED: "Stopped with advice",
}
# Above this many bytes a picture is embedded as a JPEG, which the eye cannot tell from the PNG
# beside the page.
EMBED_LIMIT = 250_000
FACE_WIDTH = 560  # CSS pixels of the slider at most
TEXTURE_COVERAGE = "texture_coverage.png"


def build_page(folder: Path, data: ReportData) -> str:
    """The page, with the pictures that :func:`writer.write_report` drew into ``folder``."""
    parts = [
        _header(data),
        _section("Photo and fit", _photo_and_fit(folder)),
        _relit(folder, data),
        _section("Textures", _textures(folder, data)),
        _section("Light", _light(folder, data)),
        _section(
            "Error against run time",
            _chart(folder / "trace.png", "Errors against seconds, stage by stage"),
        ),
        _section(
            "Shape and expression",
            _chart(folder / "weights.png", "The largest identity and expression weights"),
        ),
        _section("How sure", _certainty(folder, data)),
        _section("Numbers", _numbers(data)),
        _section("Left out", _left_out(data)),
        _section("Repeat this fit", _repeat(data)),
    ]
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width,initial-scale=1">\n'
        f"<title>{escape(data.title)} – "
        f"Facestage</title>\n<style>{CSS}</style>\n</head>\n<body>\n<main>\n"
        + "\n".join(part for part in parts if part)
        + "\n</main>\n</body>\n</html>\n"
    )


def data_uri(content: bytes) -> str:
    """A PNG as a data URI, recompressed as JPEG when it is large."""
    kind = "png"
    if len(content) > EMBED_LIMIT:
        from PIL import Image

        buffer = io.BytesIO()
        Image.open(io.BytesIO(content)).convert("RGB").save(
            buffer, format="JPEG", quality=92, subsampling=0
        )
        content, kind = min(
            (buffer.getvalue(), "jpeg"), (content, "png"), key=lambda pair: len(pair[0])
        )
    return f"data:image/{kind};base64,{base64.b64encode(content).decode('ascii')}"


def _section(heading: str, body: str) -> str:
    return f"<section>\n<h2>{escape(heading)}</h2>\n{body}\n</section>" if body else ""


def _header(data: ReportData) -> str:
    result = data.result
    words = STATUS_WORDS.get(result.status, tables.words(result.status))
    tiles = "".join(
        f"<div><dt>{escape(row.label)}</dt><dd>{escape(row.value)} "
        f"<span>{escape(row.unit)}</span></dd></div>"
        for row in _key_figures(data)
    )
    return (
        '<header>\n<p class="eyebrow">Facestage fit report</p>\n'
        f"<h1>{escape(data.title)}</h1>\n"
        f'<p class="advice"><span class="badge {escape(result.status)}">{escape(words)}</span>'
        f"{escape(result.advice)}</p>\n"
        f'<dl class="tiles">{tiles}</dl>\n</header>'
    )


def _key_figures(data: ReportData) -> list[Row]:
    # The last step's numbers stand in only where the finished picture was not measured: it has more
    # detail.
    errors = data.result.errors or (data.trace[-1] if data.trace else {})
    rows = [Row("Run time", tables.number(tables.total_seconds(data.result.timings), 3), "s")]
    wanted = (
        ("psnr", "PSNR, higher is better"),
        ("psnr_skin", "PSNR on the skin"),
        ("photo_rms", "Photo residual, RMS, linear"),
        ("rigid_mm", "From truth, rigid alignment"),
        ("similarity_mm", "From truth, similarity alignment"),
    )
    for key, label in wanted:
        value = errors.get(key)
        if isinstance(value, int | float | np.number) and np.isfinite(value):
            unit = tables.ERRORS[key][1].replace("linear", "")
            rows.append(Row(label, tables.number(float(value), 3), unit))
    distances = landmark_distances(data)
    if distances.size:
        rows.append(
            Row("Landmarks, median distance", tables.number(float(np.median(distances)), 3), "px")
        )
    return rows


def _photo_and_fit(folder: Path) -> str:
    slider = (
        f'<figure class="dark"><div class="compare" style="max-width:{FACE_WIDTH}px">'
        f"{_image(folder / 'face_photo.png', 'The photo')}"
        f"{_image(folder / 'face.png', 'The fit in the photo', 'over')}{COMPARE_INPUT}<i></i>"
        '<b class="photo">Photo</b><b class="fit">Fit</b></div>'
        "<figcaption>Drag to compare the photo with the fit.</figcaption></figure>"
    )
    landmarks = _figure(
        folder / "landmarks.png",
        "Given and fitted landmarks on the photo",
        "Landmarks as given and as fitted; faint ones are hidden from the camera.",
    )
    comparison = _figure(
        folder / "comparison.png",
        "Photo, fit and their difference",
        "Dimmed: the photo where nothing was rendered. The difference covers the pixels that count "
        "in the fit; blue means that the fit is too dark, red that it is too bright.",
        wide=True,
    )
    return f'{comparison}<div class="columns">{slider}{landmarks}</div>'


def _relit(folder: Path, data: ReportData) -> str:
    if not data.relit:
        return ""
    figures = [
        _figure(folder / relit_file(name), f"The face relit: {name}", tables.words(name))
        for name in data.relit
    ]
    return _section("Relit", f'<div class="columns">{"".join(figures)}</div>')


def relit_file(name: str) -> str:
    """The file name of a relit picture."""
    return f"relit_{''.join(letter if letter.isalnum() else '_' for letter in name)}.png"


def _textures(folder: Path, data: ReportData) -> str:
    figures = ""
    for each in TEXTURE_MAPS:
        if each.name in data.maps:
            alternative = f"{each.title} over the UV square"
            figures += _figure(folder / map_file(each), alternative, _map_caption(each, data))
    if data.texture_coverage is not None:
        caption = "Where the albedo is from."
        figures += _figure(
            folder / TEXTURE_COVERAGE, "Origin of the albedo over the UV square", caption
        )
    return f'<div class="columns">{figures}</div>'


def map_file(each: TextureMap) -> str:
    """The file name of a map's picture."""
    return f"{each.name}.png"


def _map_caption(each: TextureMap, data: ReportData) -> str:
    if each.plain is not None:
        plain = tables.number(float(data.result.parameters[each.plain]), 3)
        return f"{each.title}; {plain} where the photo does not tell."
    if each.colored and data.texture_coverage is not None:
        return f"{each.title}. Of faded texels the photo says nothing."
    return f"{each.title}."


def _light(folder: Path, data: ReportData) -> str:
    picture = _figure(
        folder / "light_probe.png",
        "The fitted light as a lat-long map, with matte and mirror spheres",
        "Numbers are those of the table: the strongest lights. Rings are lights that are on, "
        "crosses are off. Left and right as in the photo; the spheres stand in for the face.",
        wide=True,
    )
    rows = "".join(_light_row(row) for row in tables.light_rows(data.result.stage))
    table = (
        '<table><thead><tr><th>Light</th><th>From the camera’s direction</th><th class="n">Red</th>'
        '<th class="n">Green</th><th class="n">Blue</th><th></th>'
        '<th class="n">Share of power</th><th>State</th></tr></thead>'
        f"<tbody>{rows}</tbody></table>"
    )
    count = len(data.result.stage)
    words = "The light" if count == 1 else f"All {count} lights"
    note = '<p class="note">Left and right as in the photo. Radiance is linear RGB.</p>'
    return f"{picture}<details><summary>{words}</summary>{note}{table}</details>"


def _light_row(row: tables.LightRow) -> str:
    radiance = "".join(f'<td class="n">{escape(value)}</td>' for value in row.radiance)
    style = ' class="off"' if row.state == "off" else ""
    return (
        f'<tr{style}><td>{row.number}</td><td class="place">{escape(row.place)}</td>{radiance}'
        f'<td><span class="swatch" style="background:{row.swatch}"></span></td>'
        f'<td class="n">{100 * row.share:.1f} %</td><td>{escape(row.state)}</td></tr>'
    )


def _certainty(folder: Path, data: ReportData) -> str:
    parts = []
    if (folder / CERTAINTY).is_file():
        parts.append(
            _figure(
                folder / CERTAINTY,
                "Standard deviation of each vertex, as in the photo and from the side",
                "One standard deviation of each vertex in mm, size and pose taken out: what photo, "
                "landmarks and face statistics leave open if the face model holds. Right: along "
                "the camera's axis alone.",
                wide=True,
            )
        )
    relief = tables.relief_sentence(data.result)
    if relief:
        parts.append(f'<div class="card"><h3>Relief</h3><p class="note">{escape(relief)}</p></div>')
    found = data.result.null_directions
    if found:
        where = ", ".join(
            f"{value:.0f} of {tables.words(name).lower()}"
            for name, value in found["by_block"].items()
        )
        items = "".join(f"<li>{escape(sentence)}</li>" for sentence in found["sentences"])
        parts.append(
            '<div class="card"><h3>What photo and landmarks do not tell</h3><p '
            f'class="note">Of {found["of"]} '
            f"independent directions, {found['count']} rest on the priors "
            f"alone{': about ' + where if where else ''}. "
            f"Those with a name:</p><ul>{items}</ul></div>"
        )
    rows = tables.certainty_rows(data.result)
    if rows:
        body = "".join(
            f"<tr><td>{escape(row.name)}</td><td>{escape(row.kind)}</td><td "
            f'class="n">{escape(row.value)} ± '
            f'{escape(row.deviation)}</td><td class="n">{100 * row.left:.0f} %</td></tr>'
            for row in rows
        )
        parts.append(
            '<div class="card"><h3>The least certain weights that are '
            "observed</h3><table><thead><tr><th>Weight</th>"
            '<th></th><th class="n">Value ± deviation</th><th class="n">Of its prior '
            "deviation</th></tr></thead>"
            f"<tbody>{body}</tbody></table></div>"
        )
    return "\n".join(parts)


def _numbers(data: ReportData) -> str:
    result = data.result
    on_photo, against_truth = tables.error_tables(result.errors)
    cards = [
        _rows_card("Errors on the photo", on_photo),
        _rows_card("Errors against known truth", against_truth),
        _bars_card("Energy at the end", tables.energy_rows(result.energy, data.energy_names), ""),
        _bars_card("Timings", tables.timing_rows(result.timings), "s"),
        _rows_card("Camera, pose and settings", tables.setup_rows(result)),
        _rows_card("Read from the photo", [Row(name, text) for name, text in result.photo.items()]),
        _rows_card(
            "Software", [Row(name, str(version)) for name, version in result.versions.items()]
        ),
    ]
    return f'<div class="columns">{"".join(cards)}</div>'


def _rows_card(heading: str, rows: Sequence[Row]) -> str:
    if not rows:
        return ""
    body = "".join(
        f'<tr><td>{escape(row.label)}</td><td class="n">{escape(row.value)} '
        f'<span class="unit">{escape(row.unit)}</span></td></tr>'
        for row in rows
    )
    return f'<div class="card"><h3>{escape(heading)}</h3><table><tbody>{body}</tbody></table></div>'


def _bars_card(heading: str, rows: Sequence[tuple[str, float, str]], unit: str) -> str:
    if not rows:
        return ""
    body = "".join(
        f'<tr><td>{escape(label)}</td><td class="bar"><span '
        f'style="width:{100 * share:.1f}%"></span></td>'
        f'<td class="n">{escape(value)} <span class="unit">{unit}</span></td></tr>'
        for label, share, value in rows
    )
    return f'<div class="card"><h3>{escape(heading)}</h3><table><tbody>{body}</tbody></table></div>'


def _left_out(data: ReportData) -> str:
    if not data.result.left_out:
        return '<p class="note">Nothing: every part of the scene was fitted.</p>'
    heads, rows = tables.left_out_table(data.result.left_out)
    head = "".join(f"<th>{escape(text)}</th>" for text in heads)
    body = "".join(f"<tr>{_cells(row)}</tr>" for row in rows)
    note = '<p class="note">What this scene did not need, and what leaving it out saved.</p>'
    return (
        "<div "
        f'class="card">{note}<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'
    )


def _cells(values: Iterable[str]) -> str:
    return "".join(f"<td>{escape(value)}</td>" for value in values)


def _repeat(data: ReportData) -> str:
    return (
        '<div class="card">The job as it was resolved lies beside this page. In this folder, run'
        f"<pre><code>{escape(data.repeat_command)}</code></pre></div>" + _model_origin(data)
    )


def _model_origin(data: ReportData) -> str:
    """Whose model the face is, and on what terms: it holds for the result too."""
    origin = data.result.model_origin
    if not origin:
        return ""
    words = f"Face model: {origin['name']}, {origin['source']}. Licence: {origin['license']}."
    return f'<div class="card">{escape(words)}</div>'


def _figure(path: Path, alt: str, caption: str, wide: bool = False) -> str:
    """A picture with its caption; a wide one scrolls on a narrow screen instead of becoming
    unreadable.
    """
    picture = f'<div class="wide">{_image(path, alt)}</div>' if wide else _image(path, alt)
    return f'<figure class="dark">{picture}<figcaption>{escape(caption)}</figcaption></figure>'


def _image(path: Path, alt: str, style: str = "") -> str:
    name = f' class="{style}"' if style else ""
    return f'<img{name} src="{data_uri(path.read_bytes())}" alt="{escape(alt)}">'


def _chart(path: Path, alt: str) -> str:
    return f'<figure class="chart wide">{_image(path, alt)}</figure>'

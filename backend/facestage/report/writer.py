"""Write the pictures of a fit and the page that shows them."""

from __future__ import annotations

from pathlib import Path

from facestage.contract.certainty import DEVIATION
from facestage.contract.files.atomic import atomic_file
from facestage.contract.result_files import REPORT
from facestage.contract.texture_maps import HEIGHT, NORMAL, TEXTURE_MAPS
from facestage.report.certainty import CERTAINTY, draw_certainty
from facestage.report.charts import draw_trace, draw_weights
from facestage.report.color import exposure, shrink
from facestage.report.light_picture import draw_light_probe
from facestage.report.page import TEXTURE_COVERAGE, build_page, map_file, relit_file
from facestage.report.pictures import (
    COMPARISON_MARGIN,
    View,
    draw_colors,
    draw_comparison,
    draw_coverage,
    draw_faces,
    draw_landmarks,
    draw_map,
    draw_normals,
    save_linear,
)
from facestage.report.report_data import ReportData


def write_report(folder: Path, data: ReportData) -> None:
    """Write report.html and its PNG pictures into an existing folder.

    comparison, face, face_photo, landmarks, the texture maps and texture_coverage (where they are
    known), light_probe, trace, weights, certainty (where any parameter was fitted), and
    one relit_NAME for each relit picture. All pictures of the photo share the exposure of
    :func:`color.exposure` and are shrunk to at most ``color.MAX_SIDE`` pixels. The page embeds them
    all and needs no other file.
    """
    folder = Path(folder)
    view = View.of(data)
    draw_comparison(folder / "comparison.png", view)
    draw_faces(folder, view)
    draw_landmarks(folder / "landmarks.png", view, data)
    for each in TEXTURE_MAPS:
        if each.name in data.maps:
            file, values = folder / map_file(each), data.maps[each.name]
            if each is NORMAL:
                draw_normals(file, values)
            elif each.colored:
                draw_colors(file, values, data.texture_coverage)
            else:
                draw_map(file, values, signed=each is HEIGHT)
    if data.texture_coverage is not None:
        draw_coverage(folder / TEXTURE_COVERAGE, data.texture_coverage)
    draw_light_probe(folder / "light_probe.png", data)
    factor = exposure(data.photo)
    for name, picture in data.relit.items():
        small = factor * shrink(picture)
        same = small.shape == view.photo.shape
        save_linear(
            folder / relit_file(name), small[view.crop(margin=COMPARISON_MARGIN)] if same else small
        )
    draw_trace(folder / "trace.png", data.trace)
    draw_weights(folder / "weights.png", data.result)
    if DEVIATION in data.result.arrays:
        draw_certainty(folder / CERTAINTY, data)
    with atomic_file(folder / REPORT) as temporary:
        temporary.write_text(build_page(folder, data), encoding="utf-8")

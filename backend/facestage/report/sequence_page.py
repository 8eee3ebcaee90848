"""What a person looks at after a film was tracked: curves, errors, frames beside their fits."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from facestage.contract.files.atomic import atomic_file
from facestage.contract.result_files import (
    REPORT,
    SEQUENCE_FILM,
    SEQUENCE_PICTURE,
    WRINKLES_PICTURE,
)
from facestage.contract.sequence import SEEN
from facestage.contract.sequence import Sequence as Track
from facestage.report.figure import DARK, LIGHT, Canvas
from facestage.report.page import STATUS_WORDS, data_uri
from facestage.report.page_style import CSS
from facestage.report.sequence_film import BLOOD_FULL, ShownFrame, film_of, pace_of

WIDTH, HEIGHT, LEFT, RIGHT, GAP = 1080.0, 170.0, 70.0, 150.0, 78.0
CURVES = 10  # the expressions that move most
FRAME_MARKS = 12  # numbers of frames along a curve
COLUMNS, THUMBNAIL, THUMBNAILS = 6, 160.0, 12
FAST = 1.5  # times as fast as it was, from which on the report says so
PHOTO_ERROR = "Photo minus fit, RMS, linear, by seconds and by frames"
LANDMARK_ERROR = (
    "Landmarks minus fit, RMS, standard deviations of a single photo's, by seconds and by frames"
)
ROWS_MAX = 40  # of the table of frames that need a look


def write_sequence_report(folder: Path, track: Track, frames: Sequence[ShownFrame]) -> None:
    """Write report.html, sequence.png and film.webp; ``frames``: some of the film's, which the
    last shows.
    """
    if frames:
        some = np.linspace(0, len(frames) - 1, min(THUMBNAILS, len(frames))).round().astype(int)
        with atomic_file(folder / SEQUENCE_PICTURE) as temporary:
            _draw_thumbnails(temporary, [frames[index] for index in some])
        with atomic_file(folder / SEQUENCE_FILM) as temporary:
            temporary.write_bytes(film_of(frames))
    with atomic_file(folder / "curves.png") as temporary:
        _draw_curves(temporary, track)
    with atomic_file(folder / REPORT) as temporary:
        temporary.write_text(_page(folder, track, frames), encoding="utf-8")


def _draw_thumbnails(path: Path, thumbnails: Sequence[ShownFrame]) -> None:
    rows = -(-len(thumbnails) // COLUMNS)
    cell = len(thumbnails[0].pictures) * THUMBNAIL + 34
    canvas = Canvas(20 + COLUMNS * (THUMBNAIL + 8), 16 + rows * cell, DARK)
    for place, shown in enumerate(thumbnails):
        left = 14 + (place % COLUMNS) * (THUMBNAIL + 8)
        top = 28 + (place // COLUMNS) * cell
        canvas.text(left, top - 6, f"frame {shown.number}", 10, weight="bold")
        for row, picture in enumerate(shown.pictures):
            canvas.picture(left, top + row * THUMBNAIL, THUMBNAIL, THUMBNAIL, picture)
    canvas.save(path)


def _draw_curves(path: Path, track: Track) -> None:
    seconds = np.array([frame.time for frame in track.frames])
    turn, place = _pose_curves(track)
    moving = np.argsort(-track.expression.std(axis=0), kind="stable")[:CURVES]
    weights = {track.expression_names[index]: track.expression[:, index] for index in moving}
    spread = track.deviations.get("expression")
    panels = [
        ("Expression: the weights that move most", weights),
        ("Turn of the head, degrees", turn),
        ("Place of the head, mm from its mean", place),
    ]
    photo, landmarks = (
        np.array([np.nan if value is None else value for value in values])
        for values in zip(*((f.photo_rms, f.landmark_rms) for f in track.frames), strict=True)
    )
    errors = {PHOTO_ERROR: {"photo": photo}, LANDMARK_ERROR: {"landmarks": landmarks}}
    for heading, curves in errors.items():
        if any(np.isfinite(values).any() for values in curves.values()):
            panels.append((heading, curves))
    if spread is not None:
        mean = spread[:, moving].mean(axis=1)
        panels.append(("Standard deviation of these weights, mean", {"deviation": mean}))
    if track.haemoglobin is not None:
        panels.append(
            (
                "Haemoglobin beyond the keyframes', standard deviations of a population",
                _blood(track),
            )
        )
    canvas = Canvas(WIDTH, 40 + len(panels) * (HEIGHT + GAP), LIGHT)
    for row, (heading, curves) in enumerate(panels):
        top = 34 + row * (HEIGHT + GAP)
        canvas.text(LEFT, top - (22 if heading in errors else 10), heading, 11, weight="bold")
        axes = canvas.axes(LEFT, top, WIDTH - LEFT - RIGHT, HEIGHT)
        for name, values in curves.items():
            axes.plot(seconds, values, linewidth=1.2, label=name)
        if len(curves) > 1:
            axes.legend(
                loc="upper left",
                bbox_to_anchor=(1.0, 1.02),
                frameon=False,
                fontsize=7,
                labelcolor=LIGHT.text,
            )
        if heading in errors:
            _mark_frames(axes, track, seconds)
        axes.margins(x=0)
        axes.set_xlabel("seconds", fontsize=8)
    canvas.save(path)


def _mark_frames(axes: Any, track: Track, seconds: np.ndarray) -> None:
    """Numbers of frames above, and lines where frames need a look."""
    for frame in track.frames:
        if frame.status != SEEN:
            axes.axvline(frame.time, color="#d9822b", alpha=0.5, linewidth=1.0)
    numbers = np.array([frame.number for frame in track.frames])
    marked = np.flatnonzero(numbers % _round_step(len(numbers)) == 0)
    above = axes.secondary_xaxis("top")
    above.set_xticks(seconds[marked], labels=[str(number) for number in numbers[marked]])
    above.tick_params(colors=LIGHT.muted, labelsize=8, length=0, pad=0)
    above.spines["top"].set_visible(False)


def _round_step(frames: int) -> int:
    """1, 2 or 5 times a power of ten: every so many ``frames`` are at most FRAME_MARKS."""
    power = 10 ** int(np.log10(max(frames, 1)))
    steps = (factor * power // 10 for factor in (1, 2, 5, 10, 20, 50))
    return next(step for step in steps if step and frames <= FRAME_MARKS * step)


def _pose_curves(track: Track) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Angles about the camera's axes (bow, turn, tilt), and where the head is."""
    rotation = track.model_to_camera[:, :3, :3]
    turn = np.degrees(np.arctan2(rotation[:, 0, 2], rotation[:, 2, 2]))
    bow = np.degrees(np.arcsin(np.clip(-rotation[:, 1, 2], -1, 1)))
    tilt = np.degrees(np.arctan2(rotation[:, 1, 0], rotation[:, 1, 1]))
    place = 1e3 * (track.model_to_camera[:, :3, 3] - track.model_to_camera[:, :3, 3].mean(axis=0))
    return (
        {"turn": turn, "bow": bow, "tilt": tilt},
        {"right": place[:, 0], "up": place[:, 1], "towards the camera": place[:, 2]},
    )


def _blood(track: Track) -> dict[str, np.ndarray]:
    """Where the face has most and least of it, but for one vertex in a hundred."""
    assert track.haemoglobin is not None and track.haemoglobin_harmonics is not None
    face = track.haemoglobin_harmonics[:, track.haemoglobin_harmonics.any(axis=0)]
    least, most = np.array([np.percentile(row @ face, (1, 99)) for row in track.haemoglobin]).T
    return {"most of the face": most, "least of the face": least}


def _page(folder: Path, track: Track, frames: Sequence[ShownFrame]) -> str:
    title = f"{len(track.frames)} frames of {Path(track.film).name}"
    words = STATUS_WORDS.get(track.status, track.status)
    figures = "".join(
        f"<tr><td>{escape(name)}</td><td>{value:.4g}</td></tr>"
        for name, value in (track.errors | track.skin | track.timings).items()
    )
    doubtful = [frame for frame in track.frames if frame.status != SEEN]
    rows = "".join(
        f"<tr><td>{frame.number}</td><td>{frame.time:.3f} s</td>"
        f"<td>{escape(frame.advice)}</td></tr>"
        for frame in doubtful[:ROWS_MAX]
    )
    more = len(doubtful) - ROWS_MAX
    look = (
        f"<section>\n<h2>Frames that need a look</h2>\n"
        f'<div class="card"><table>{rows}</table>'
        + (f"<p>and {more} more, in sequence.json</p>" if more > 0 else "")
        + "</div>\n</section>\n"
        if doubtful
        else ""
    )
    shown = (
        '<section>\n<h2>Frames and fits</h2>\n<figure class="dark"><img alt="Frames above their '
        f'fits" src="{data_uri((folder / SEQUENCE_PICTURE).read_bytes())}"></figure>\n'
        f"{_film(folder, track, frames)}</section>\n"
        if frames
        else ""
    )
    curves = data_uri((folder / "curves.png").read_bytes())
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width,initial-scale=1">\n'
        f"<title>{escape(title)} – Facestage</title>\n<style>{CSS}</style>\n</head>\n"
        '<body>\n<main>\n<header>\n<p class="eyebrow">Facestage sequence report</p>\n'
        f'<h1>{escape(title)}</h1>\n<p class="advice"><span class="badge {escape(track.status)}">'
        f"{escape(words)}</span>{escape(track.advice)}</p>\n</header>\n{shown}"
        f'<section>\n<h2>Curves</h2>\n<figure><img alt="Curves" src="{curves}"></figure>\n'
        f"</section>\n{_wrinkles(folder, track)}{look}"
        f'<section>\n<h2>Numbers</h2>\n<div class="card"><table>{figures}</table></div>\n'
        "</section>\n</main>\n</body>\n</html>\n"
    )


def _wrinkles(folder: Path, track: Track) -> str:
    """The wrinkles that come with sliders, if there are any."""
    path = folder / WRINKLES_PICTURE
    if not track.wrinkles or not path.is_file():
        return ""
    rows = "".join(
        f"<tr><td>{escape(each.name)}</td><td>{escape(', '.join(each.sliders))}</td></tr>"
        for each in track.wrinkles
    )
    return (
        '<section>\n<h2>Wrinkles that come with an expression</h2>\n<figure class="dark"><img '
        f'alt="Wrinkles over the texture" src="{data_uri(path.read_bytes())}"><figcaption>At full '
        "strength, over the texture, under a lamp at the upper left; their strength is the mean of "
        f'the sliders below</figcaption></figure>\n<div class="card"><table>{rows}</table></div>\n'
        "</section>\n"
    )


def _film(folder: Path, track: Track, frames: Sequence[ShownFrame]) -> str:
    """The film beside its fit."""
    content = base64.b64encode((folder / SEQUENCE_FILM).read_bytes()).decode("ascii")
    words = f"Frames {frames[0].number} to {frames[-1].number}, photo and the fit of its skin"
    if frames[0].blood is not None:
        words += (
            ", and its haemoglobin beside the keyframes': red is more, blue is less, full color "
            f"{BLOOD_FULL:g} standard deviations of a population"
        )
    pace = pace_of(frames)
    if pace > FAST:
        words += f", {pace:.0f} times as fast"
    return (
        f'<figure class="dark"><img alt="The film beside its fit" '
        f'src="data:image/webp;base64,{content}"><figcaption>{words}</figcaption></figure>\n'
    )

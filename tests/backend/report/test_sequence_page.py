"""The report of a film: what it shows of photo, fit and errors."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence

from facestage.contract.camera import Camera
from facestage.contract.sequence import Sequence, SequenceFrame
from facestage.contract.wrinkles import Wrinkles
from facestage.report import (
    ShownFrame,
    blood_picture,
    write_sequence_report,
    write_wrinkles_picture,
)
from facestage.report.figure import LIGHT, Canvas
from facestage.report.sequence_film import film_of, pace_of
from facestage.report.sequence_page import COLUMNS, THUMBNAIL, _mark_frames, _round_step
from facestage.report.wrinkles_picture import shaded

SIDE = 32


def shown(count: int, apart: float = 1 / 24) -> list[ShownFrame]:
    """Photos get redder, their fits greener."""
    frames = []
    for index in range(count):
        pictures = np.zeros((2, SIDE, SIDE, 3), np.uint8)
        pictures[0, ..., 0] = pictures[1, ..., 1] = 40 + 200 * index // count
        frames.append(ShownFrame(index + 1, index * apart, *pictures))
    return frames


def track_of(count: int) -> Sequence:
    statuses = ["unsure" if index == 3 else "seen" for index in range(count)]
    frames = tuple(
        SequenceFrame(11 + k, k / 24, f"{k}", status, "", 1, 0.01 + 1e-3 * k, 0.5)
        for k, status in enumerate(statuses)
    )
    return Sequence(
        "converged",
        "Fine.",
        "film.mp4",
        "default",
        Camera.default(64, 48),
        24.0,
        frames,
        (11,),
        ("a",),
        ("jawOpen",),
        np.zeros(1),
        np.linspace(0, 1, count)[:, None],
        np.tile(np.eye(4), (count, 1, 1)),
        {},
        {},
        {},
        {},
    )


@pytest.mark.parametrize(
    ("apart", "milliseconds", "pace"), [(1 / 24, 42, 1.0), (2.0, 100, 20.0), (0.0, 20, 0.0)]
)
def test_the_film_shows_photo_beside_fit_for_as_long(apart: float, milliseconds: int, pace: float):
    frames = shown(5, apart)
    with Image.open(io.BytesIO(film_of(frames))) as film:
        assert len(list(ImageSequence.Iterator(film))) == 5 and film.size == (2 * SIDE, SIDE)
        film.seek(4)
        pixels = np.asarray(film.convert("RGB")).astype(int)
        assert film.info["duration"] == milliseconds and film.info["loop"] == 0  # for ever
    assert abs(pixels[4, 4] - frames[4].photo[0, 0]).max() < 25
    assert abs(pixels[4, SIDE + 12] - frames[4].fit[0, 0]).max() < 25
    assert pace_of(frames) == pytest.approx(pace)


def test_the_report_plays_the_film_and_names_its_pace(tmp_path: Path):
    write_sequence_report(tmp_path, track_of(6), shown(6, 3.0))
    page = (tmp_path / "report.html").read_text("utf-8")
    assert "data:image/webp;base64," in page and "30 times as fast" in page
    assert (
        "Frames 1 to 6, photo and the fit of its skin" in page and "Frames that need a look" in page
    )
    with Image.open(tmp_path / "film.webp") as film:
        assert len(list(ImageSequence.Iterator(film))) == 6
    assert (tmp_path / "sequence.png").is_file()


def test_wrinkles_are_shown_with_their_sliders(tmp_path: Path):
    track = replace(track_of(3), wrinkles=(Wrinkles("smile", ("jawOpen",)),))
    write_sequence_report(tmp_path, track, [])
    assert "Wrinkles that come" not in (tmp_path / "report.html").read_text("utf-8")
    height = np.zeros((64, 64), np.float32)
    height[30:34, 10:50] = -0.5
    write_wrinkles_picture(tmp_path / "wrinkles.png", {"smile": height}, 0.75)
    write_sequence_report(tmp_path, track, [])
    page = (tmp_path / "report.html").read_text("utf-8")
    assert "Wrinkles that come" in page and "<td>smile</td><td>jawOpen</td>" in page
    lit = shaded(height, 0.75)[..., 0].astype(int)
    # The lamp stands above: the slope that faces it is the lower one.
    assert lit[33, 30] > 140 > 128 == lit[5, 5] > 110 > lit[30, 30]


def test_the_thumbnails_are_spread_over_the_film(tmp_path: Path):
    frames = shown(25)
    write_sequence_report(tmp_path, track_of(25), frames)
    with Image.open(tmp_path / "sequence.png") as picture:
        pixels = np.asarray(picture.convert("RGB")).astype(int)
    grow = pixels.shape[1] / (20 + COLUMNS * (THUMBNAIL + 8))
    # Their photos get redder from place to place, the fits below them greener.
    places = [(column, row) for row in range(2) for column in range(COLUMNS)]
    colors = []
    for column, row in places:
        left, top = 14 + (column + 0.5) * (THUMBNAIL + 8), 28 + row * (2 * THUMBNAIL + 34)
        middle = [int(grow * (top + (half + 0.5) * THUMBNAIL)) for half in range(2)]
        colors.append([pixels[middle[half], int(grow * left), half] for half in range(2)])
    wanted = [frames[round(24 * place / 11)].photo[0, 0, 0] for place in range(len(places))]
    np.testing.assert_allclose(colors, np.array([wanted, wanted]).T, atol=3)


def test_without_a_frame_to_show_there_is_no_film(tmp_path: Path):
    write_sequence_report(tmp_path, track_of(6), [])
    assert "data:image/webp" not in (tmp_path / "report.html").read_text("utf-8")
    assert not (tmp_path / "film.webp").exists()


@pytest.mark.parametrize(("frames", "step"), [(1, 1), (12, 1), (13, 2), (48, 5), (121, 20)])
def test_frames_are_numbered_in_round_steps(frames: int, step: int):
    assert _round_step(frames) == step


def test_numbers_of_frames_stand_at_their_seconds():
    track = track_of(48)
    axes = Canvas(400, 300, LIGHT).axes(50, 50, 300, 200)
    axes.plot([0.0, 2.0], [0.0, 1.0])
    _mark_frames(axes, track, np.array([frame.time for frame in track.frames]))
    (above,) = axes.child_axes
    marked = {int(label.get_text()): label.get_position()[0] for label in above.get_xticklabels()}
    assert sorted(marked) == list(range(15, 59, 5))
    assert all(place == pytest.approx((number - 11) / 24) for number, place in marked.items())
    assert [line.get_xdata()[0] for line in axes.lines[1:]] == [3 / 24]


def test_haemoglobin_that_changes_is_shown_and_drawn(tmp_path: Path):
    grey = np.full((SIDE, SIDE, 3), 0.3)
    change = np.repeat(np.linspace(-2.0, 2.0, SIDE)[None], SIDE, axis=0)
    picture = blood_picture(grey, change)
    assert picture[0, 0, 2] > 0.7 > 0.1 > picture[0, 0, 0]
    assert picture[0, -1, 0] > 0.6 > 0.1 > picture[0, -1, 2]
    np.testing.assert_allclose(blood_picture(grey, 0.0 * change), grey)
    frames = [
        ShownFrame(one.number, one.time, one.photo, one.fit, (255 * picture).astype(np.uint8))
        for one in shown(6)
    ]
    with Image.open(io.BytesIO(film_of(frames))) as film:
        assert film.size == (3 * SIDE, SIDE)
    plain, blood = tmp_path / "plain", tmp_path / "blood"
    for folder in (plain, blood):
        folder.mkdir()
    track = track_of(6)
    write_sequence_report(plain, track, shown(6))
    changing = replace(
        track,
        haemoglobin=np.linspace(-1, 1, 12).reshape(6, 2),
        haemoglobin_harmonics=np.ones((2, 5)),
        haemoglobin_color=np.full(3, -0.05),
        deviations={"haemoglobin": np.full((6, 2), 0.1)},
        skin={"haemoglobin": 0.7},
    )
    write_sequence_report(blood, changing, frames)
    assert "red is more" not in (plain / "report.html").read_text("utf-8")
    page = (blood / "report.html").read_text("utf-8")
    assert "red is more, blue is less" in page and "<td>haemoglobin</td><td>0.7</td>" in page
    for name in ("curves.png", "sequence.png"):  # another panel, another row
        with Image.open(plain / name) as before, Image.open(blood / name) as after:
            assert after.height > before.height + 150

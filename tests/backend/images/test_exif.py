"""Focal lengths from EXIF as Pillow writes it, against what the lens must be in pixels."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from facestage.images.exif import FocalPrior
from facestage.images.image_io import read_photograph

# A phone's main camera: 26 mm of film on 4:3.
WIDTH, HEIGHT, EQUIVALENT = 400, 300, 26
EXPECTED = EQUIVALENT * 500 / math.hypot(36, 24)
FOCAL, FILM, ZOOM, OWN_WIDTH, OWN_HEIGHT, PLANE, UNIT = (
    0x920A,
    0xA405,
    0xA404,
    0xA002,
    0xA003,
    0xA20E,
    0xA210,
)


def prior(
    folder: Path, tags: dict, size: tuple[int, int] = (WIDTH, HEIGHT), orientation: int = 1
) -> FocalPrior | None:
    exif = Image.Exif()
    exif[0x0112] = orientation
    exif.get_ifd(0x8769).update(tags)
    Image.fromarray(np.full((*size[::-1], 3), 128, np.uint8)).save(folder / "a.jpg", exif=exif)
    return read_photograph(folder / "a.jpg").focal


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_35mm_equivalence_is_by_the_diagonal(tmp_path: Path, orientation: int):
    found = prior(
        tmp_path, {FILM: EQUIVALENT, OWN_WIDTH: WIDTH, OWN_HEIGHT: HEIGHT}, orientation=orientation
    )
    assert (
        found is not None and found.focal_px == pytest.approx(EXPECTED) and found.log_sigma == 0.05
    )
    assert "26 mm" in found.source


def test_a_picture_that_was_made_smaller_keeps_its_lens(tmp_path: Path):
    found = prior(tmp_path, {FILM: EQUIVALENT, OWN_WIDTH: 4 * WIDTH, OWN_HEIGHT: 4 * HEIGHT})
    assert (
        found is not None and found.focal_px == pytest.approx(EXPECTED) and found.log_sigma == 0.05
    )


def test_the_sensor_is_better_than_the_equivalent(tmp_path: Path):
    """50 mm on a sensor of 36 mm with 400 pixels: 555.6 pixels, whatever the maker calls the
    equivalent.
    """
    per_unit = {2: 25.4, 3: 10.0, 4: 1.0}
    for unit, length in per_unit.items():
        tags = {
            FOCAL: IFDRational(50, 1),
            PLANE: IFDRational(round(1e6 * WIDTH / 36 * length), 1000000),
            UNIT: unit,
        }
        found = prior(tmp_path, tags | {FILM: 75, OWN_WIDTH: WIDTH, OWN_HEIGHT: HEIGHT})
        assert found is not None and found.focal_px == pytest.approx(50 * WIDTH / 36, rel=1e-3)
        assert found.log_sigma == 0.03 and "36.0 mm" in found.source


def test_a_crop_is_believed_less(tmp_path: Path):
    """A third of the width was cut: the lens in pixels is as before if the rest was not resized."""
    cut = (WIDTH * 2 // 3, HEIGHT)
    found = prior(tmp_path, {FILM: EQUIVALENT, OWN_WIDTH: WIDTH, OWN_HEIGHT: HEIGHT}, cut)
    assert found is not None and "part" in found.source and found.log_sigma >= 0.2
    assert abs(math.log(found.focal_px / EXPECTED)) < found.log_sigma
    # An editor that wrote the new size: only the shape is odd.
    found = prior(
        tmp_path, {FILM: EQUIVALENT, OWN_WIDTH: HEIGHT, OWN_HEIGHT: HEIGHT}, (HEIGHT, HEIGHT)
    )
    assert found is not None and found.log_sigma >= 0.2
    assert abs(math.log(found.focal_px / EXPECTED)) < found.log_sigma


def test_a_crop_that_was_resized_lies_within_what_is_said(tmp_path: Path):
    own = (4000, 3000)
    truth = EQUIVALENT * 5000 / math.hypot(36, 24)
    for side, scale in ((3000, 1.0), (3000, 0.1), (1500, 0.2)):
        size = (round(side * scale), round(side * scale))
        found = prior(tmp_path, {FILM: EQUIVALENT, OWN_WIDTH: own[0], OWN_HEIGHT: own[1]}, size)
        assert found is not None
        assert abs(math.log(found.focal_px / (truth * scale))) < 2 * found.log_sigma


def test_digital_zoom_leaves_it_open_who_multiplied(tmp_path: Path):
    tags = {FILM: EQUIVALENT, OWN_WIDTH: WIDTH, OWN_HEIGHT: HEIGHT, ZOOM: IFDRational(3, 2)}
    found = prior(tmp_path, tags)
    assert found is not None and "zoom" in found.source
    for either in (EXPECTED, 1.5 * EXPECTED):
        assert abs(math.log(found.focal_px / either)) < 1.01 * found.log_sigma


@pytest.mark.parametrize(
    "tags",
    [
        {},
        {FILM: 0},
        {FILM: 3},
        {FOCAL: IFDRational(50, 1)},
        {FOCAL: IFDRational(0, 0), PLANE: IFDRational(1, 0)},
        {
            FOCAL: IFDRational(50, 1),
            PLANE: IFDRational(1, 1),
            UNIT: 9,
            OWN_WIDTH: WIDTH,
            OWN_HEIGHT: HEIGHT,
        },
        {
            FOCAL: IFDRational(50, 1),
            PLANE: IFDRational(1, 1000),
            UNIT: 3,
            OWN_WIDTH: WIDTH,
            OWN_HEIGHT: HEIGHT,
        },
    ],
)
def test_what_says_nothing_gives_nothing(tmp_path: Path, tags: dict):
    assert prior(tmp_path, tags) is None


def test_damaged_exif_never_stops_a_photo(tmp_path: Path):
    exif = Image.Exif()
    exif.get_ifd(0x8769).update(
        {FILM: EQUIVALENT, FOCAL: IFDRational(4, 1), OWN_WIDTH: WIDTH, OWN_HEIGHT: HEIGHT}
    )
    Image.fromarray(np.full((HEIGHT, WIDTH, 3), 128, np.uint8)).save(tmp_path / "a.jpg", exif=exif)
    data = (tmp_path / "a.jpg").read_bytes()
    start = data.index(b"Exif")
    end = start - 2 + int.from_bytes(data[start - 2 : start], "big")
    kept = 0
    for trial in range(60):
        random, damaged = np.random.default_rng(trial), bytearray(data)
        for position in random.integers(start + 6, end, 4):
            damaged[position] ^= int(random.integers(1, 256))
        (tmp_path / "b.jpg").write_bytes(damaged)
        found = read_photograph(tmp_path / "b.jpg").focal
        assert found is None or (
            math.isfinite(found.focal_px) and found.focal_px > 0 and found.log_sigma > 0
        )
        kept += found is not None
    assert 0 < kept < 60, "some damage spares the lens, some does not"

"""Photos in, pictures out: color, orientation, alpha, clipping, damage."""

from __future__ import annotations

import contextlib
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from facestage.contract.errors import InputError
from facestage.contract.files.color import linear_to_srgb, srgb_to_linear
from facestage.images.image_io import read_exr, read_photograph, resize, write_exr
from facestage.images.opencv import opencv

RANDOM = np.random.default_rng(0)
PIXELS = RANDOM.integers(0, 256, (5, 7, 3)).astype(np.uint8)


@given(st.floats(0, 1))
def test_srgb_round_trip(value: float):
    assert float(linear_to_srgb(srgb_to_linear(np.array(value)))) == pytest.approx(value, abs=1e-6)


def test_srgb_known_values():
    np.testing.assert_allclose(srgb_to_linear(np.array([0, 0.5, 1])), [0, 0.21404114, 1], atol=1e-7)


def test_png_is_decoded_as_srgb(tmp_path: Path):
    Image.fromarray(PIXELS).save(tmp_path / "a.png")
    photo = read_photograph(tmp_path / "a.png")
    assert photo.size == (7, 5) and photo.color.dtype == np.float32 and photo.mask.all()
    np.testing.assert_allclose(photo.color, srgb_to_linear(PIXELS / 255.0), atol=1e-6)
    np.testing.assert_array_equal(photo.clipped, PIXELS >= 254)


@pytest.mark.parametrize("mode", ["L", "P", "RGBA", "LA", "1", "CMYK"])
def test_other_modes(tmp_path: Path, mode: str):
    name = tmp_path / ("a.jpg" if mode == "CMYK" else "a.png")
    Image.fromarray(PIXELS).convert(mode).save(name)
    photo = read_photograph(name)
    assert photo.color.shape == (5, 7, 3) and np.isfinite(photo.color).all()
    assert photo.color.min() >= 0 and photo.color.max() <= 1


def test_sixteen_bit_grey_keeps_its_precision(tmp_path: Path):
    grey = np.array([[0, 1000, 1001, 65535]], np.uint16)
    Image.fromarray(grey).save(tmp_path / "a.png")
    color = read_photograph(tmp_path / "a.png").color
    np.testing.assert_allclose(color[..., 0], srgb_to_linear(grey / 65535.0), atol=1e-6)
    assert color[0, 2, 0] > color[0, 1, 0]


def test_alpha_is_a_mask(tmp_path: Path):
    alpha = np.zeros((5, 7, 1), np.uint8)
    alpha[1:3] = 255
    Image.fromarray(np.concatenate([PIXELS, alpha], axis=2)).save(tmp_path / "a.png")
    np.testing.assert_array_equal(read_photograph(tmp_path / "a.png").mask, alpha[..., 0] > 0)


def test_exif_orientation_turns_the_picture(tmp_path: Path):
    block = np.zeros((16, 32, 3), np.uint8)
    block[:8, :16] = 255
    exif = Image.Exif()
    exif[0x0112] = 6  # the camera was held on its side: turn by 90 degrees clockwise
    Image.fromarray(block).save(tmp_path / "a.jpg", exif=exif, quality=95)
    photo = read_photograph(tmp_path / "a.jpg")
    assert photo.size == (16, 32)
    bright = photo.color.mean(2) > 0.5
    assert bright[:16, 8:].mean() > 0.95 and bright[16:].mean() < 0.05


def test_exr_round_trip_is_linear_and_keeps_more_than_one(tmp_path: Path):
    image = RANDOM.uniform(0, 30, (4, 6, 3)).astype(np.float16).astype(np.float32)
    write_exr(tmp_path / "a.exr", image)
    np.testing.assert_array_equal(read_exr(tmp_path / "a.exr"), image)
    photo = read_photograph(tmp_path / "a.exr")
    assert photo.mask.all() and not photo.clipped.any()
    assert [path.name for path in tmp_path.iterdir()] == ["a.exr"]


def test_another_format_named_exr_is_refused(tmp_path: Path):
    Image.fromarray(PIXELS).save(tmp_path / "a.png")
    (tmp_path / "a.png").rename(tmp_path / "a.exr")
    with pytest.raises(InputError, match=r"a\.exr.*OpenEXR"):
        read_photograph(tmp_path / "a.exr")


def test_heights_below_zero_are_written(tmp_path: Path):
    height = np.array([[-0.5, 0.25], [0.0, -1e6]], np.float32)
    write_exr(tmp_path / "a.exr", height)
    found = opencv().imread(str(tmp_path / "a.exr"), opencv().IMREAD_UNCHANGED)
    np.testing.assert_allclose(found, np.maximum(height, -65000), rtol=1e-3)


def test_grey_exr(tmp_path: Path):
    write_exr(tmp_path / "a.exr", np.full((3, 2), 0.5, np.float32))
    np.testing.assert_array_equal(read_exr(tmp_path / "a.exr"), np.full((3, 2, 3), 0.5))


def _write_raw_exr(path: Path, image: np.ndarray) -> None:
    import cv2

    assert cv2.imwrite(str(path), np.ascontiguousarray(image[..., ::-1]), [cv2.IMWRITE_EXR_TYPE, 2])


def test_pixels_that_are_no_numbers_are_masked(tmp_path: Path):
    image = np.full((4, 4, 3), 0.25, np.float32)
    image[0, 0, 1], image[1, 1, 0], image[2, 2] = np.nan, np.inf, -3
    _write_raw_exr(tmp_path / "a.exr", image)
    photo = read_photograph(tmp_path / "a.exr")
    assert np.isfinite(photo.color).all() and photo.color.min() >= 0
    assert not photo.mask[0, 0] and not photo.mask[1, 1] and photo.mask.sum() == 14


def test_only_nan_is_refused(tmp_path: Path):
    _write_raw_exr(tmp_path / "a.exr", np.full((4, 4, 3), np.nan, np.float32))
    with pytest.raises(InputError, match=r"a\.exr.*no usable pixel"):
        read_photograph(tmp_path / "a.exr")


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".exr"])
@pytest.mark.parametrize(
    "content",
    [b"", b"this is text\n" * 20, b"\x89PNG\r\n\x1a\n", b"\x76\x2f\x31\x01\x02\x00\x00\x00"],
)
def test_what_is_no_picture_is_refused(
    tmp_path: Path, suffix: str, content: bytes, capfd: pytest.CaptureFixture[str]
):
    path = tmp_path / f"photo{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"The photo '.*photo") as caught:
        read_photograph(path)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr().err == "", "only the one sentence may reach the user"


def test_missing_files_and_folders_are_refused(tmp_path: Path):
    for path, words in (
        (tmp_path / "none.png", "does not exist"),
        (tmp_path, "is a folder, expected a file"),
    ):
        with pytest.raises(InputError, match=words):
            read_photograph(path)


@pytest.mark.parametrize("kind", ["png", "jpg", "exr"])
def test_damaged_pictures_never_crash(tmp_path: Path, kind: str):
    """Cut or with bytes changed: decoded to finite numbers, or refused with a sentence."""
    path = tmp_path / f"a.{kind}"
    if kind == "exr":
        write_exr(path, RANDOM.random((24, 24, 3)))
    else:
        Image.fromarray(RANDOM.integers(0, 255, (24, 24, 3)).astype(np.uint8)).save(path)
    data = path.read_bytes()
    for trial in range(60):
        random = np.random.default_rng(trial)
        damaged = bytearray(data)
        if trial % 2:
            damaged = damaged[: random.integers(1, len(data))]
        for position in random.integers(0, len(damaged), 4):
            damaged[position] ^= int(random.integers(1, 256))
        path.write_bytes(damaged)
        with contextlib.suppress(InputError):
            assert np.isfinite(read_photograph(path).color).all()


def test_a_giant_picture_is_refused_before_it_is_decoded(tmp_path: Path):
    header = struct.pack(">IIBBBBB", 60000, 60000, 8, 2, 0, 0, 0)
    chunk = b"IHDR" + header
    data = (
        b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + chunk + struct.pack(">I", zlib.crc32(chunk))
    )
    (tmp_path / "huge.png").write_bytes(data + b"\x00" * 64)
    with pytest.raises(InputError, match=r"huge\.png"):
        read_photograph(tmp_path / "huge.png")


def test_resize_averages_areas():
    image = np.zeros((4, 4, 3), np.float32)
    image[:2, :2] = 1
    image[0, 0] = 5
    small = resize(image, 2, 2)
    np.testing.assert_allclose(small[..., 0], [[2, 0], [0, 0]])


def test_an_unwritable_place_is_named(tmp_path: Path):
    (tmp_path / "parent").touch()
    with pytest.raises(InputError, match="parent"):
        write_exr(tmp_path / "parent" / "a.exr", np.zeros((2, 2, 3)))

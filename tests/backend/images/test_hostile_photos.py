"""Photos that promise more than is read, or that would hang or crash a decoder, are refused in a
sentence.
"""

from __future__ import annotations

import contextlib
import os
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from facestage.contract.errors import InputError
from facestage.contract.files.exr_header import DEEP, MULTIPART, TILED, read_header
from facestage.images.image_io import PROFILE_LIMIT, read_photograph, write_exr

PIXELS = np.random.default_rng(0).integers(0, 256, (12, 20, 3)).astype(np.uint8)


def refusal(path: Path) -> str:
    with pytest.raises(InputError, match=path.name) as caught:
        read_photograph(path)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 500
    return str(caught.value)


@pytest.mark.parametrize("name", ["a.png", "a.exr", "a.jpg"])
def test_a_pipe_and_a_device_are_refused_unread(tmp_path: Path, name: str):
    os.mkfifo(tmp_path / name)
    assert "is a pipe or a device" in refusal(tmp_path / name)
    (tmp_path / name).unlink()
    (tmp_path / name).symlink_to("/dev/zero")
    assert "is a pipe or a device" in refusal(tmp_path / name)


@pytest.mark.parametrize("name", ["a.png", "a.exr"])
@pytest.mark.parametrize("path", ["x" * 5000, "a\0b"])
def test_paths_that_cannot_be_are_refused(path: str, name: str):
    with pytest.raises(InputError, match="cannot be read"):
        read_photograph(Path(path + name))


def with_header(path: Path, change: dict[str, bytes], flags: int = 0) -> None:
    """An EXR whose attributes have other values of the same length, or other flags."""
    write_exr(path, PIXELS / 255.0)
    content = bytearray(path.read_bytes())
    content[4:8] = struct.pack("<I", 2 | flags)
    for name, value in change.items():
        at = content.index(name.encode() + b"\0") + len(name) + 1
        at = content.index(b"\0", at) + 1
        assert struct.unpack_from("<i", content, at)[0] == len(value)
        content[at + 4 : at + 4 + len(value)] = value
    path.write_bytes(content)


@pytest.mark.parametrize(
    ("window", "words"),
    [
        (
            (0, 0, 2**31 - 2, 2**31 - 2),
            "it is 2147483647 x 2147483647 pixels; at most 16384 a side",
        ),
        ((-(2**31), 0, 2**31 - 1, 0), "it is 4294967296 x 1 pixels"),
        (
            (0, 0, 16383, 16383),
            "it is 16384 x 16384 pixels; at most 16384 a side and 134 million in all",
        ),
        ((10, 0, 0, 11), "it is -9 x 12 pixels"),
    ],
)
def test_the_window_of_an_exr_is_not_believed(tmp_path: Path, window: tuple[int, ...], words: str):
    with_header(tmp_path / "a.exr", {"dataWindow": struct.pack("<4i", *window)})
    assert words in refusal(tmp_path / "a.exr")


@pytest.mark.parametrize("flags", [DEEP, MULTIPART, DEEP | MULTIPART])
def test_other_kinds_of_exr_are_named(tmp_path: Path, flags: int):
    with_header(tmp_path / "a.exr", {}, flags)
    assert "it has several parts or deep pixels; save it as one flat picture" in refusal(
        tmp_path / "a.exr"
    )


def test_compressions_are_named(tmp_path: Path):
    for code, words in (
        (8, "its compression DWAA is not read; save it with ZIP"),
        (77, "compression 77 is unknown"),
    ):
        with_header(tmp_path / "a.exr", {"compression": bytes([code])})
        assert words in refusal(tmp_path / "a.exr")


def test_tiles_that_are_none_do_not_crash(tmp_path: Path):
    with_header(tmp_path / "a.exr", {}, TILED)
    assert "not a readable EXR" in refusal(tmp_path / "a.exr")


def write_hard_exr(path: Path, code: int) -> np.ndarray:
    """An EXR of one of the compressions that a child decodes."""
    from facestage.images.opencv import opencv

    cv2 = opencv()
    image = np.random.default_rng(1).random((40, 50, 3)).astype(np.float32)
    assert cv2.imwrite(
        str(path), image[..., ::-1], [cv2.IMWRITE_EXR_TYPE, 2, cv2.IMWRITE_EXR_COMPRESSION, code]
    )
    return image


@pytest.mark.parametrize(("code", "name"), [(4, "PIZ"), (5, "PXR24"), (6, "B44"), (7, "B44A")])
def test_hard_compressions_are_read_in_a_child(tmp_path: Path, code: int, name: str):
    image = write_hard_exr(tmp_path / "a.exr", code)
    assert read_header((tmp_path / "a.exr").read_bytes()).compression == name
    np.testing.assert_allclose(
        read_photograph(tmp_path / "a.exr").color, image, rtol=1e-4, atol=1e-4
    )


@pytest.mark.parametrize("cut", [8, 100, 250, 330, 400])
def test_a_cut_exr_is_refused_or_read(tmp_path: Path, cut: int):
    write_exr(tmp_path / "a.exr", PIXELS / 255.0)
    (tmp_path / "a.exr").write_bytes((tmp_path / "a.exr").read_bytes()[:cut])
    assert "not a readable EXR" in refusal(tmp_path / "a.exr")


def chunk(kind: bytes, content: bytes) -> bytes:
    return (
        struct.pack(">I", len(content))
        + kind
        + content
        + struct.pack(">I", zlib.crc32(kind + content))
    )


def png(width: int, height: int, *chunks: bytes) -> bytes:
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + b"".join(chunks) + chunk(b"IEND", b"")


@pytest.mark.parametrize(
    ("width", "height", "words"),
    [
        (16384, 16384, "decompression bomb"),
        (12000, 12000, "it is 12000 x 12000 pixels; at most 16384 a side and"),
        (16385, 8, "it is 16385 x 8 pixels"),
    ],
)
def test_pixels_are_counted_before_they_are_decoded(
    tmp_path: Path, width: int, height: int, words: str
):
    pixels = zlib.compress(bytes(4_000_000), 9)
    (tmp_path / "a.png").write_bytes(png(width, height, chunk(b"IDAT", pixels)))
    assert words in refusal(tmp_path / "a.png")


def test_texts_that_unpack_to_gigabytes_are_refused(tmp_path: Path):
    text = b"Comment\0\0" + zlib.compress(bytes(300 * 2**20), 9)
    pixels = zlib.compress(b"".join(b"\0" + row.tobytes() for row in PIXELS))
    (tmp_path / "a.png").write_bytes(png(20, 12, chunk(b"zTXt", text), chunk(b"IDAT", pixels)))
    assert "not a readable image" in refusal(tmp_path / "a.png")


def test_a_profile_that_is_absurdly_large_is_ignored(tmp_path: Path):
    Image.fromarray(PIXELS).save(tmp_path / "a.tif", icc_profile=b"RGB " * (PROFILE_LIMIT // 4 + 1))
    assert read_photograph(tmp_path / "a.tif").color_space == "sRGB"


def test_nothing_but_the_sentence_is_said_of_a_damaged_tiff(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
):
    Image.fromarray(PIXELS).save(tmp_path / "a.tif", compression="tiff_lzw")
    content = bytearray((tmp_path / "a.tif").read_bytes())
    content[12:60] = b"\xff" * 48
    (tmp_path / "a.tif").write_bytes(content)
    with contextlib.suppress(InputError):
        read_photograph(tmp_path / "a.tif")
    assert capfd.readouterr().err == ""


@pytest.mark.slow
def test_the_largest_picture_takes_less_than_three_gigabytes(tmp_path: Path):
    """A megabyte of PNG of as many pixels as are read."""
    side = 11500
    row, packer = bytes(3 * side + 1), zlib.compressobj(9)
    pixels = b"".join(packer.compress(row) for _ in range(side)) + packer.flush()
    (tmp_path / "a.png").write_bytes(png(side, side, chunk(b"IDAT", pixels)))
    script = (
        "import resource, sys; from pathlib import Path; from facestage.images.image_io import "
        "read_photograph; print(read_photograph(Path(sys.argv[1])).size, "
        "resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"
    )
    said = subprocess.run(
        [sys.executable, "-I", "-c", script, str(tmp_path / "a.png")],
        capture_output=True,
        text=True,
        check=True,
    )
    assert said.stdout.startswith(f"({side}, {side})")
    assert int(said.stdout.split()[-1]) < 3 * 2**20

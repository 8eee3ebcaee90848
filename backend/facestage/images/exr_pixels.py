"""The pixels of an OpenEXR file that somebody gave, by OpenCV's decoder, within limits.

OpenCV brings OpenEXR 2.3, whose decoders of wavelets, blocks and tiles are known to write beyond
their memory for damaged files (CVE-2020-11758 to 11765 and others): those run in a child that may
die. What is left, rows of pixels as they are or packed by zlib or RLE, is decoded here.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from facestage.contract.camera import PIXELS_MAX, SIDE_MAX
from facestage.contract.files.exr_header import ExrHeader, read_header
from facestage.contract.files.reading import GIB, read_bytes
from facestage.images.opencv import opencv
from facestage.system.in_child import ChildLimits, ReaderFailedError, read_in_child

FILE_LIMIT = 2 * GIB  # PIXELS_MAX of four floats
SIMPLE, HARD = ("none", "RLE", "ZIPS", "ZIP"), ("PIZ", "PXR24", "B44", "B44A")
_PIXELS_A_SECOND = 8_000_000


def read_exr_pixels(path: Path, what: str) -> tuple[np.ndarray, ExrHeader]:
    """(h, w, c) float32 as OpenCV has them: B, G, R, A, or grey, or grey and A; and the header.

    Raises InputError for a file that cannot be opened, ValueError with a clause for one that is no
    such picture.
    """
    content = read_bytes(path, what, FILE_LIMIT)
    header = read_header(content)
    check_size(header.width, header.height)
    if header.compression not in SIMPLE + HARD:
        raise ValueError(f"its compression {header.compression} is not read; save it with ZIP")
    if header.compression in SIMPLE and not header.tiled:
        pixels = _decoded(content)
    else:
        pixels = _through_child(path, header)
    pixels = np.asarray(pixels, np.float32)
    pixels = pixels[..., None] if pixels.ndim == 2 else pixels
    if pixels.ndim != 3 or pixels.shape[:2] != (header.height, header.width):
        raise ValueError("its pixels are not those that its header promises")
    return pixels, header


def check_size(width: int, height: int) -> None:
    """Raise ValueError for a picture without pixels, or of more than are read."""
    if width < 1 or height < 1:
        raise ValueError(f"it is {width} x {height} pixels")
    if max(width, height) > SIDE_MAX or width * height > PIXELS_MAX:
        raise ValueError(
            f"it is {width} x {height} pixels; at most {SIDE_MAX} a side and {PIXELS_MAX // 10**6} "
            "million in all are read, make it smaller"
        )


def decode_file(path: Path, _names: Sequence[str]) -> dict[str, np.ndarray]:
    """The child's part: the pixels of a file that has been looked at."""
    return {"pixels": _decoded(path.read_bytes())}


def _decoded(content: bytes) -> np.ndarray:
    cv2 = opencv()
    try:
        pixels = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise ValueError(f"OpenCV cannot decode it: {error}") from error
    if pixels is None:
        raise ValueError("it is damaged, or has no channels R, G, B or Y")
    return np.asarray(pixels)


def _through_child(path: Path, header: ExrHeader) -> np.ndarray:
    pixels = header.width * header.height
    limits = ChildLimits(
        memory=6 * GIB, seconds=4 + pixels // _PIXELS_A_SECOND, array_bytes=16 * pixels
    )
    try:
        return read_in_child(decode_file, path, (), limits)["pixels"]
    except ReaderFailedError as error:
        raise ValueError(str(error)) from error

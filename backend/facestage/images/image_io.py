"""Images in and out: 8/16-bit files of any color space and linear EXR, always as linear float RGB
inside.
"""

from __future__ import annotations

import contextlib
import logging
import re
import struct
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.files.atomic import atomic_file
from facestage.contract.files.reading import MIB, open_regular
from facestage.contract.grey import CLIP_LEVEL
from facestage.contract.job import PHOTO_SUFFIXES
from facestage.images.color_profile import (
    DEFAULT,
    SRGB,
    chromaticities_to_rec709,
    decoder_of,
    through_littlecms,
)
from facestage.images.exif import FocalPrior, focal_prior
from facestage.images.exr_pixels import check_size, read_exr_pixels
from facestage.images.opencv import opencv
from facestage.images.quiet import quiet_standard_error

# A picture of as many pixels as are read (contract.camera) and 16 bits has 0.8 GB unpacked.
PHOTO_LIMIT = 1024 * MIB
# The largest profiles, tables for printing, have 3 MB.
PROFILE_LIMIT = 16 * MIB
# Decoders that are tried, by content: Pillow has others, one of which runs a program.
FORMATS = ("PNG", "JPEG", "WEBP", "TIFF", "BMP")
# What phones and cameras write that is not decoded here: "ftyp" brands of HEIF and AVIF; files of
# raw sensor data, whose own picture would be a thumbnail.
HEIF_BRANDS = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"mif1", b"msf1", b"avif", b"avis")
RAW_SUFFIXES = (".dng", ".nef", ".cr2", ".cr3", ".arw", ".orf", ".rw2", ".raf", ".pef", ".srw")
ORIENTATION = 0x0112
EXR_MAX = 1e9
HALF_MOST = 65000.0  # of what half floats hold, in what is written
LINEAR_REC709 = "linear Rec. 709"

# What Pillow logs of a damaged file, Python prints where no log was set up; the error that it
# raises says it too.
logging.getLogger("PIL").addHandler(logging.NullHandler())
# What damaged bytes make Pillow's decoders raise, beside what it says that they do.
_UNREADABLE = (
    OSError,
    SyntaxError,
    ValueError,
    LookupError,
    TypeError,
    ArithmeticError,
    AttributeError,
    EOFError,
    RuntimeError,
    MemoryError,
    AssertionError,
    struct.error,
)


@dataclass(frozen=True)
class Photograph:
    """A decoded photograph."""

    color: np.ndarray  # (h, w, 3) float32 linear RGB, Rec. 709
    mask: np.ndarray  # (h, w) bool: finite and not transparent
    clipped: np.ndarray  # (h, w, 3) bool: saturated
    color_space: str = SRGB  # what the file's numbers were taken for
    focal: FocalPrior | None = None  # what the file says of its lens
    developed: bool = True  # somebody chose its exposure: its white is 1
    tinted: bool = False  # its hue is none of the photo's, see fit/given/black_and_white.py

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        return self.color.shape[1], self.color.shape[0]


def read_photograph(path: Path) -> Photograph:
    """Decode a photo to linear Rec. 709; alpha masks pixels.

    PNG, JPEG, WebP and TIFF by their ICC profile, or as sRGB, turned by their EXIF orientation; EXR
    as linear, by its chromaticities. A PNG's gAMA, cHRM and cICP chunks are not looked at.

    Raises InputError for a missing, empty or undecodable file, or one without a single finite
    pixel.
    """
    path = Path(path)
    if path.suffix.lower() == ".exr":
        return _read_exr(path, "photo")
    return _with_pixels(path, "photo", _read_display(path))


def _with_pixels(path: Path, what: str, photograph: Photograph) -> Photograph:
    if not photograph.mask.any():
        raise InputError(
            f"The {what} '{path}' has no usable pixel: all are transparent, NaN or infinite."
        )
    return photograph


def _read_display(path: Path) -> Photograph:
    from PIL import Image, UnidentifiedImageError

    if path.suffix.lower() in RAW_SUFFIXES:
        raise InputError(
            f"The photo '{path}' is a camera's raw file; develop it and export a 16-bit TIFF "
            "or a JPEG."
        )
    with open_regular(path, "photo", PHOTO_LIMIT) as file:
        _refuse_by_content(path, file.read(12))
        file.seek(0)
        try:
            with warnings.catch_warnings():
                # Pillow's size guard is a warning first; ours is below it. Damaged EXIF is as good
                # as none.
                warnings.simplefilter("ignore")
                with Image.open(file, formats=FORMATS) as image:
                    check_size(*image.size)
                    if image.mode in ("F", "I"):
                        raise ValueError(
                            "it has 32 bits per pixel, of unknown scale; save it as an EXR"
                        )
                    # Known only until the pixels are decoded.
                    deep = image.mode in ("RGB", "RGBA") and any(
                        "16" in str(tile.args) for tile in image.tile
                    )
                    with (
                        quiet_standard_error()
                        if image.format == "TIFF"
                        else contextlib.nullcontext()
                    ):
                        image.load()
                    exif = image.getexif()
                    focal, turn = focal_prior(exif, *image.size), exif.get(ORIENTATION, 1)
                    color, clipped, alpha, space = _decoded(file, image, deep)
        except (*_UNREADABLE, Image.DecompressionBombError) as error:
            reason = _plain(str(error)) or type(error).__name__
            if isinstance(error, UnidentifiedImageError):
                reason = "it is of no known format, or damaged"
            raise InputError(
                f"The photo '{path}' is not a readable image ({reason}); expected "
                f"{', '.join(PHOTO_SUFFIXES)}."
            ) from error
    mask = np.ones(color.shape[:2], bool) if alpha is None else alpha
    color, mask, clipped = (
        np.ascontiguousarray(_upright(array, turn)) for array in (color, mask, clipped)
    )
    return Photograph(color, mask, clipped, space, focal)


def _refuse_by_content(path: Path, head: bytes) -> None:
    if not head:
        raise InputError(f"The photo '{path}' is empty (0 bytes); export it again.")
    if head[4:8] == b"ftyp" and head[8:12] in HEIF_BRANDS:
        raise InputError(
            f"The photo '{path}' is a HEIC or AVIF picture, which is not read; export it as JPEG."
        )


def _plain(text: str) -> str:
    """The text of a library's error, on one line and without a memory address that changes."""
    return re.sub(r"<_io\.\w+[^>]*>", "the file", " ".join(text.split()))[:200].rstrip(".")


def _decoded(
    file: BinaryIO, image: Any, deep: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None, str]:
    """Linear color (h, w, 3), clipped (h, w, 3), alpha (h, w) bool or None, and the color space of
    a Pillow image.
    """
    alpha = np.asarray(image.convert("RGBA").getchannel("A")) > 127 if _has_alpha(image) else None
    profile = image.info.get("icc_profile")
    decoder, name = DEFAULT, DEFAULT.name
    if profile and len(profile) <= PROFILE_LIMIT:
        # A profile that is damaged, or for another kind of image, is ignored, as viewers do.
        with contextlib.suppress(ValueError):
            found = decoder_of(profile)
            if found is None:
                image = through_littlecms(
                    image.convert("RGB") if image.mode in ("P", "RGBA") else image, profile
                )
                name, deep = "ICC profile, by LittleCMS in 8 bits", False
            else:
                decoder, name = found, found.name
    codes = _codes(file, image, deep)
    return decoder(codes), codes >= CLIP_LEVEL * np.iinfo(codes.dtype).max, alpha, name


def _codes(file: BinaryIO, image: Any, deep: bool) -> np.ndarray:
    """(h, w, 3) uint8 or uint16 code values; 16 bits keep their precision."""
    if image.mode.startswith("I;16"):
        return np.repeat(np.asarray(image, np.uint16)[..., None], 3, axis=2)
    if deep:
        # Pillow drops half the bits of color; OpenCV does not.
        file.seek(0)
        content = np.frombuffer(file.read(PHOTO_LIMIT), np.uint8)
        with quiet_standard_error():  # libpng says there what it makes of a damaged end
            codes = opencv().imdecode(content, -1)
        if (
            codes is not None
            and codes.dtype == np.uint16
            and codes.shape[:2] == image.size[::-1]
            and codes.ndim == 3
        ):
            return np.asarray(codes[..., 2::-1])
    return np.asarray(image if image.mode == "RGB" else image.convert("RGB"))


def _upright(array: np.ndarray, orientation: int) -> np.ndarray:
    """``array`` (h, w, ...) turned as the EXIF orientation 1..8 says."""
    if orientation in (5, 6, 7, 8):
        array = array.swapaxes(0, 1)
    if orientation in (3, 4, 7, 8):
        array = array[::-1]
    if orientation in (2, 3, 6, 7):
        array = array[:, ::-1]
    return array


def _has_alpha(image: Any) -> bool:
    return "A" in image.getbands() or "transparency" in image.info


def _read_exr(path: Path, what: str) -> Photograph:
    try:
        image, header = read_exr_pixels(path, what)
    except ValueError as error:
        raise InputError(
            f"The {what} '{path}' is not a readable EXR ({_plain(str(error))}); expected a flat "
            "OpenEXR file with RGB channels."
        ) from error
    finite = np.isfinite(image)
    mask = finite.all(axis=2)
    if image.shape[2] == 4:
        mask &= image[..., 3] > 0.5
    # 16-bit floats end far below: what is larger is no light of a photo, and its square would be
    # infinite.
    np.clip(
        np.where(finite, image, 0.0),
        0.0 if header.chromaticities is None else -EXR_MAX,
        EXR_MAX,
        out=image,
    )
    color = image[..., [2, 1, 0]] if image.shape[2] >= 3 else np.repeat(image[..., :1], 3, axis=2)
    matrix = (
        None if header.chromaticities is None else chromaticities_to_rec709(header.chromaticities)
    )
    if matrix is not None:
        color = color @ matrix.T.astype(np.float32)
    name = LINEAR_REC709 if matrix is None else "linear, by its chromaticities"
    clipped = np.zeros(color.shape, bool)
    photograph = Photograph(np.maximum(color, 0.0), mask, clipped, name, developed=False)
    return _with_pixels(path, what, photograph)


def write_exr(path: Path, image: np.ndarray) -> None:
    """Write (h, w, 3) RGB or (h, w) grey linear float as a half-float EXR, whole or not at all."""
    cv2 = opencv()
    data = np.asarray(image, np.float32)
    data = data[..., ::-1] if data.ndim == 3 else data
    most = np.empty(data.shape, np.float32)  # large maps are copied once
    np.clip(data, -HALF_MOST, HALF_MOST, out=most)  # below 0: heights
    with atomic_file(path) as temporary:
        options = [
            cv2.IMWRITE_EXR_TYPE,
            cv2.IMWRITE_EXR_TYPE_HALF,
            cv2.IMWRITE_EXR_COMPRESSION,
            cv2.IMWRITE_EXR_COMPRESSION_ZIP,
        ]
        if not cv2.imwrite(str(temporary), most, options):
            raise InputError(f"Cannot write the picture '{path}'; is the disk full?")


def write_png(path: Path, image: np.ndarray) -> None:
    """Write (h, w, 3) uint8 as a PNG of these very bytes, whole or not at all."""
    from PIL import Image

    with atomic_file(path) as temporary:
        Image.fromarray(image).save(temporary, format="PNG")


def read_exr(path: Path, what: str = "picture") -> np.ndarray:
    """(h, w, 3) float32 linear RGB of an EXR; ``what`` it is, for errors.

    Raises InputError as :func:`read_photograph` does.
    """
    return _read_exr(Path(path), what).color


def resize(image: np.ndarray, width: int, height: int) -> np.ndarray:
    """(h, w, ...) float image of another size: area-averaged where it shrinks, else bilinear."""
    cv2 = opencv()
    larger = width > image.shape[1] or height > image.shape[0]
    method = cv2.INTER_LINEAR if larger else cv2.INTER_AREA
    return cv2.resize(
        np.ascontiguousarray(image, np.float32), (width, height), interpolation=method
    )

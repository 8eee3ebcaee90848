"""Images in and out: 8/16-bit sRGB files and linear EXR, always as linear float RGB inside."""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.storage import atomic_file

MAX_SIDE = 16384
EXTENSIONS = ".png, .jpg, .jpeg, .exr"
# The brightest code value of a display image, less rounding: there the sensor, or the file, ran out.
CLIP_LEVEL = 0.996
EXR_MAGIC = b"\x76\x2f\x31\x01"


@dataclass(frozen=True)
class Photograph:
    """A decoded photograph."""

    color: np.ndarray  # (h, w, 3) float32 linear RGB, Rec. 709
    mask: np.ndarray  # (h, w) bool: finite and not transparent
    clipped: np.ndarray  # (h, w, 3) bool: saturated

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        return self.color.shape[1], self.color.shape[0]


def srgb_to_linear(value: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1, decoding; 0..1 in and out."""
    return np.where(value <= 0.04045, value / 12.92, ((np.maximum(value, 0.0) + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(value: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1, encoding; 0..1 in and out."""
    return np.where(value <= 0.0031308, value * 12.92, 1.055 * np.maximum(value, 0.0031308) ** (1 / 2.4) - 0.055)


def read_photograph(path: Path) -> Photograph:
    """Decode a photo: PNG/JPEG as sRGB with its EXIF orientation, EXR as linear; alpha masks pixels.

    Raises InputError for a missing, empty or undecodable file, or one without a single finite pixel.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"The photo '{path}' does not exist; give the path of a {EXTENSIONS} file.")
    if path.stat().st_size == 0:
        raise InputError(f"The photo '{path}' is empty (0 bytes); export it again.")
    photograph = _read_exr(path) if path.suffix.lower() == ".exr" else _read_display(path)
    if max(photograph.size) > MAX_SIDE:
        raise InputError(
            f"The photo '{path}' is {photograph.size[0]} x {photograph.size[1]} pixels; at most {MAX_SIDE} a side."
        )
    if not photograph.mask.any():
        raise InputError(f"The photo '{path}' has no usable pixel: all are transparent, NaN or infinite.")
    return photograph


def _read_display(path: Path) -> Photograph:
    from PIL import Image, ImageOps, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            # Pillow's size guard is a warning first; the limit below is ours.
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(path) as image:
                if max(image.size) > MAX_SIDE:
                    raise InputError(
                        f"The photo '{path}' is {image.size[0]} x {image.size[1]} pixels; at most {MAX_SIDE} a side."
                    )
                upright = ImageOps.exif_transpose(image)
                alpha = np.asarray(upright.convert("RGBA"))[..., 3] if _has_alpha(upright) else None
                values = _to_unit_rgb(upright)
    except (UnidentifiedImageError, Image.DecompressionBombError, OSError, SyntaxError, ValueError) as error:
        raise InputError(f"The photo '{path}' is not a readable image ({error}); expected {EXTENSIONS}.") from error
    mask = np.ones(values.shape[:2], bool) if alpha is None else alpha > 127
    return Photograph(srgb_to_linear(values).astype(np.float32), mask, values >= CLIP_LEVEL)


def _has_alpha(image: Any) -> bool:
    return "A" in image.getbands() or "transparency" in image.info


def _to_unit_rgb(image: Any) -> np.ndarray:
    """(h, w, 3) float in 0..1 of any mode Pillow decodes; 16-bit grey keeps its precision."""
    if image.mode.startswith("I;16"):
        grey = np.asarray(image, np.float64) / 65535.0
        return np.repeat(grey[..., None], 3, axis=2)
    return np.asarray(image.convert("RGB"), np.float64) / 255.0


def _opencv() -> Any:
    # OpenCV reads EXR only when this is set before its first import.
    os.environ["OPENCV_IO_ENABLE_OPENEXR"] = "1"
    import cv2

    # What is wrong with a file is said once, by the error it raises.
    cv2.setLogLevel(0)
    return cv2


def _read_exr(path: Path) -> Photograph:
    cv2 = _opencv()
    try:
        data = path.read_bytes()
        # OpenCV would decode any format here, and take its sRGB for linear light.
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data[:4] == EXR_MAGIC else None
    except (cv2.error, OSError) as error:
        raise InputError(f"The photo '{path}' is not a readable EXR ({error}).") from error
    if image is None:
        raise InputError(f"The photo '{path}' is not a readable EXR; expected an OpenEXR file with RGB channels.")
    image = np.asarray(image, np.float32)
    image = image[..., None] if image.ndim == 2 else image
    mask = np.isfinite(image).all(axis=2)
    if image.shape[2] == 4:
        mask &= image[..., 3] > 0.5
    color = image[..., [2, 1, 0]] if image.shape[2] >= 3 else np.repeat(image[..., :1], 3, axis=2)
    color = np.where(np.isfinite(color), np.maximum(color, 0.0), 0.0).astype(np.float32)
    return Photograph(color, mask, np.zeros(color.shape, bool))


def write_exr(path: Path, image: np.ndarray) -> None:
    """Write (h, w, 3) RGB or (h, w) grey linear float as a half-float EXR, whole or not at all."""
    cv2 = _opencv()
    data = np.ascontiguousarray(image, np.float32)
    data = data[..., ::-1] if data.ndim == 3 else data
    with atomic_file(path) as temporary:
        options = [
            cv2.IMWRITE_EXR_TYPE,
            cv2.IMWRITE_EXR_TYPE_HALF,
            cv2.IMWRITE_EXR_COMPRESSION,
            cv2.IMWRITE_EXR_COMPRESSION_ZIP,
        ]
        if not cv2.imwrite(str(temporary), np.ascontiguousarray(np.clip(data, 0, 65000)), options):
            raise InputError(f"Cannot write the picture '{path}'; is the disk full?")


def write_png(path: Path, image: np.ndarray) -> None:
    """Write (h, w, 3) uint8 as a PNG of these very bytes, whole or not at all."""
    from PIL import Image

    with atomic_file(path) as temporary:
        Image.fromarray(image).save(temporary, format="PNG")


def read_exr(path: Path) -> np.ndarray:
    """(h, w, 3) float32 linear RGB of an EXR."""
    return read_photograph(path).color


def resize(image: np.ndarray, width: int, height: int) -> np.ndarray:
    """Area-averaged (h, w, ...) float image."""
    cv2 = _opencv()
    return cv2.resize(np.ascontiguousarray(image, np.float32), (width, height), interpolation=cv2.INTER_AREA)

"""Small photographs of every kind that is read, with profiles, EXIF and alpha."""

from __future__ import annotations

import io
import os
import struct
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageCms

from fuzz.case import Case

WIDTH, HEIGHT = 24, 18


def picture(channels: int = 3, kind: type = np.uint8) -> np.ndarray:
    """(h, w, channels) smooth, with a little noise."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    wave = 0.5 + 0.4 * np.sin(x[..., None] / 5 + y[..., None] / 7 + np.arange(channels))
    return (wave * np.iinfo(kind).max).astype(kind)


def profile() -> bytes:
    """sRGB as LittleCMS writes it, without the day it was made."""
    data = bytearray(ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes())
    data[24:36] = bytes(12)
    return bytes(data)


def lab_profile() -> bytes:
    """One that is no matrix of RGB."""
    data = bytearray(ImageCms.ImageCmsProfile(ImageCms.createProfile("LAB", 5000)).tobytes())
    data[24:36] = bytes(12)
    return bytes(data)


def exif_bytes(orientation: int = 6) -> bytes:
    exif = Image.Exif()
    exif[0x0112] = orientation
    exif[0x0110] = "Camera"
    exif.get_ifd(0x8769).update(
        {
            0x920A: 50.0,
            0xA405: 75,
            0xA404: 1.5,
            0xA002: WIDTH,
            0xA003: HEIGHT,
            0xA20E: 700.0,
            0xA210: 3,
        }
    )
    return exif.tobytes()


def encoded(image: Any, kind: str, **options: Any) -> bytes:
    stream = io.BytesIO()
    image.save(stream, kind, **options)
    return stream.getvalue()


def exr(image: np.ndarray, options: tuple[int, ...] = ()) -> bytes:
    """An EXR of (h, w, channels) float32, as OpenCV writes it."""
    os.environ["OPENCV_IO_ENABLE_OPENEXR"] = "1"
    import cv2

    with tempfile.TemporaryDirectory(prefix="facestage-fuzz-") as folder:
        path = Path(folder) / "a.exr"
        cv2.imwrite(str(path), np.ascontiguousarray(image[..., ::-1]), options)
        return path.read_bytes()


def photographs() -> list[Case]:
    rgb, rgba, grey = (Image.fromarray(picture(count).squeeze()) for count in (3, 4, 1))
    deep = Image.fromarray(picture(1, np.uint16).squeeze())
    meta = {"icc_profile": profile(), "exif": exif_bytes()}
    files = {
        "a.png": [
            encoded(rgb, "PNG", **meta),
            encoded(rgba, "PNG"),
            encoded(deep, "PNG"),
            encoded(rgb.quantize(8), "PNG", transparency=1),
            encoded(grey, "PNG", icc_profile=lab_profile()),
            _deep_png(),
        ],
        "a.jpg": [
            encoded(rgb, "JPEG", **meta),
            encoded(rgb, "JPEG", progressive=True, exif=exif_bytes(3)),
            encoded(rgb.convert("CMYK"), "JPEG", icc_profile=profile()),
            encoded(grey, "JPEG"),
        ],
        "a.webp": [encoded(rgba, "WEBP", lossless=True, **meta), encoded(rgb, "WEBP")],
        "a.tif": [
            encoded(rgb, "TIFF", **meta),
            encoded(rgb, "TIFF", compression="tiff_lzw"),
            encoded(rgb, "TIFF", compression="jpeg"),
            encoded(deep, "TIFF", compression="tiff_deflate"),
        ],
        "a.bmp": [encoded(rgb, "BMP")],
    }
    return [{name: data} for name, several in files.items() for data in several]


def _deep_png() -> bytes:
    """16 bits of color, which Pillow does not write."""
    import cv2

    return bytes(cv2.imencode(".png", picture(3, np.uint16))[1])


def exr_photographs() -> list[Case]:
    import cv2

    half = (cv2.IMWRITE_EXR_TYPE, cv2.IMWRITE_EXR_TYPE_HALF)
    images = []
    for channels in (1, 3, 4):
        image = picture(channels).astype(np.float32) / 255
        images.append(exr(image))
        images.append(
            exr(image, (*half, cv2.IMWRITE_EXR_COMPRESSION, cv2.IMWRITE_EXR_COMPRESSION_PIZ))
        )
        images.append(
            exr(image, (*half, cv2.IMWRITE_EXR_COMPRESSION, cv2.IMWRITE_EXR_COMPRESSION_NO))
        )
    return [{"a.exr": data} for data in (*images, _with_chromaticities(images[5]))]


def _with_chromaticities(data: bytes) -> bytes:
    """An uncompressed EXR with one attribute more; the table of its lines is put right."""
    mark = b"chromaticities\x00chromaticities\x00" + struct.pack("<i", 32)
    more = mark + struct.pack("<8f", 0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.3127, 0.329)
    end = 8
    while data[end]:
        for _ in range(2):
            end = data.index(b"\0", end) + 1
        end += 4 + int(struct.unpack("<i", data[end : end + 4])[0])
    table = struct.unpack(f"<{HEIGHT}Q", data[end + 1 : end + 1 + 8 * HEIGHT])
    moved = struct.pack(f"<{HEIGHT}Q", *(place + len(more) for place in table))
    return data[:8] + more + data[8 : end + 1] + moved + data[end + 1 + 8 * HEIGHT :]


def profiles() -> list[Case]:
    return [{"a.icc": data} for data in (profile(), lab_profile(), _grey_profile())]


def _grey_profile() -> bytes:
    """Grey with a table of 16 values: header, one tag, one curve."""
    curve = (
        b"curv"
        + bytes(4)
        + (16).to_bytes(4, "big")
        + np.linspace(0, 65535, 16).astype(">u2").tobytes()
    )
    header = bytearray(128)
    header[12:24], header[36:40] = b"mntrGRAYXYZ ", b"acsp"
    table = (
        (1).to_bytes(4, "big") + b"kTRC" + (144).to_bytes(4, "big") + len(curve).to_bytes(4, "big")
    )
    return bytes(header) + table + curve


def exif_blocks() -> list[Case]:
    return [{"a.exif": exif_bytes(turn)} for turn in (1, 6)]

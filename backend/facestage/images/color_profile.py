"""What the numbers of a photo mean: ICC profiles and EXR chromaticities, to linear Rec. 709.

A profile that is a matrix and three curves (sRGB, Display P3, Adobe RGB, ProPhoto, linear ones) or
one curve of grey is evaluated here, in floating point, because LittleCMS as Pillow offers it takes
and gives 8 bits. Every other profile (CMYK, look-up tables) goes through LittleCMS to 8-bit sRGB.
Source: ICC.1:2022, sections 9 and 10.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from facestage.contract.files.color import srgb_to_linear

# CIE XYZ under D50, Bradford-adapted, of linear Rec. 709: the colorants of the ICC's own sRGB
# profiles.
REC709_TO_D50 = np.array(
    [
        [0.4360747, 0.3850649, 0.1430804],
        [0.2225045, 0.7168786, 0.0606169],
        [0.0139322, 0.0971045, 0.7141733],
    ]
)
REC709_CHROMATICITIES = np.array([0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290])
BRADFORD = np.array(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)
# A profile this close to sRGB (matrix; curve, of 1) is sRGB, written with other roundings.
SRGB_MATRIX_TOLERANCE, SRGB_CURVE_TOLERANCE = 2e-3, 2e-3
SRGB = "sRGB"
STRIP_ROWS = 256
HEADER_BYTES, TAG_BYTES = 128, 12
LOOKUP_TAGS = ("A2B0", "D2B0")
COLORANTS, CURVES = ("rXYZ", "gXYZ", "bXYZ"), ("rTRC", "gTRC", "bTRC")
# Number of parameters of each type of parametric curve (ICC.1:2022, table 68).
PARAMETERS = (1, 3, 4, 5, 7)
Curve = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Decoder:
    """From code values to linear Rec. 709: a curve per channel, then a matrix."""

    name: str  # of the color space, for people
    curves: tuple[Curve, Curve, Curve]
    matrix: np.ndarray | None  # (3, 3) to linear Rec. 709; None: it is already

    def __call__(self, codes: np.ndarray) -> np.ndarray:
        """(h, w, 3) float32 linear Rec. 709 of (h, w, 3) uint8 or uint16 codes.

        Colors beyond the gamut keep what is above 1; a negative channel becomes 0.
        """
        levels = np.iinfo(codes.dtype).max
        ramp = np.arange(levels + 1) / levels
        tables = [np.asarray(curve(ramp), np.float32) for curve in self.curves]
        linear = np.empty(codes.shape, np.float32)
        # In strips: what numpy needs beside the result would be several times a large picture.
        for start in range(0, len(codes), STRIP_ROWS):
            strip = slice(start, start + STRIP_ROWS)
            for channel, table in enumerate(tables):
                linear[strip, :, channel] = table[codes[strip, :, channel]]
            if self.matrix is not None:
                linear[strip] = np.maximum(linear[strip] @ self.matrix.T.astype(np.float32), 0.0)
        return linear


DEFAULT = Decoder(SRGB, (srgb_to_linear,) * 3, None)


def decoder_of(profile: bytes) -> Decoder | None:
    """How to decode RGB or grey code values with an ICC profile; None when it is no matrix with
    curves.

    Raises ValueError for a profile that is cut or inconsistent.
    """
    try:
        tags = _tags(profile)
        name = _description(tags) or "ICC profile"
        if profile[16:20] == b"GRAY" and "kTRC" in tags:
            return Decoder(name, (_curve(tags["kTRC"]),) * 3, None)
        if profile[16:20] != b"RGB " or any(tag in tags for tag in LOOKUP_TAGS):
            return None
        if not all(tag in tags for tag in COLORANTS + CURVES):
            return None
        columns = [struct.unpack(">3i", tags[tag][8:20]) for tag in COLORANTS]
        curves = (_curve(tags["rTRC"]), _curve(tags["gTRC"]), _curve(tags["bTRC"]))
    except (struct.error, IndexError) as error:
        raise ValueError(f"the ICC profile is damaged: {error}") from error
    to_d50 = np.array(columns).T / 65536.0
    ramp = np.arange(256) / 255.0
    decoded = np.stack([curve(ramp) for curve in curves])
    if not (
        np.isfinite(to_d50).all()
        and np.isfinite(decoded).all()
        and abs(np.linalg.det(to_d50)) > 1e-4
    ):
        raise ValueError("the ICC profile is damaged: its colorants or curves are no numbers")
    if (
        np.abs(to_d50 - REC709_TO_D50).max() < SRGB_MATRIX_TOLERANCE
        and np.abs(decoded - srgb_to_linear(ramp)).max() < SRGB_CURVE_TOLERANCE
    ):
        return DEFAULT
    # White of the file is white of the photo, whatever the roundings of the profile's colorants.
    matrix = np.linalg.solve(REC709_TO_D50, to_d50)
    return Decoder(name, curves, matrix / matrix.sum(axis=1, keepdims=True))


def through_littlecms(image: Any, profile: bytes) -> Any:
    """A Pillow image of any mode as 8-bit sRGB, by LittleCMS with black point compensation.

    Raises ValueError for a profile that LittleCMS refuses, or that is for another kind of image.
    """
    from PIL import ImageCms

    try:
        return ImageCms.profileToProfile(
            image,
            ImageCms.ImageCmsProfile(io.BytesIO(profile)),
            ImageCms.createProfile("sRGB"),
            renderingIntent=ImageCms.Intent.RELATIVE_COLORIMETRIC,
            outputMode="RGB",
            flags=ImageCms.Flags.BLACKPOINTCOMPENSATION,
        )
    except (ImageCms.PyCMSError, OSError) as error:
        raise ValueError(f"the ICC profile does not fit the picture: {error}") from error


def chromaticities_to_rec709(values: np.ndarray) -> np.ndarray | None:
    """(3, 3) matrix from linear RGB of primaries and white (8,) CIE xy to linear Rec. 709, white to
    white (Bradford).

    None when they are Rec. 709's own or no chromaticities.
    """
    if np.allclose(values, REC709_CHROMATICITIES, atol=1e-3):
        return None
    if not np.isfinite(values).all() or (values[1::2] <= 0).any():
        return None
    own, target = _rgb_to_xyz(values), _rgb_to_xyz(REC709_CHROMATICITIES)
    if own is None or target is None:
        return None
    cones = BRADFORD @ np.stack([own.sum(axis=1), target.sum(axis=1)], axis=1)
    adapt = np.linalg.solve(BRADFORD, np.diag(cones[:, 1] / cones[:, 0]) @ BRADFORD)
    return np.linalg.solve(target, adapt @ own)


def _rgb_to_xyz(values: np.ndarray) -> np.ndarray | None:
    pairs = values.reshape(4, 2)
    xyz = np.column_stack(
        [pairs[:, 0] / pairs[:, 1], np.ones(4), (1 - pairs.sum(axis=1)) / pairs[:, 1]]
    ).T
    if abs(np.linalg.det(xyz[:, :3])) < 1e-6:
        return None
    return xyz[:, :3] * np.linalg.solve(xyz[:, :3], xyz[:, 3])


def _tags(profile: bytes) -> dict[str, bytes]:
    """The tagged elements of a profile by signature."""
    (count,) = struct.unpack(">I", profile[HEADER_BYTES : HEADER_BYTES + 4])
    if count > 200:
        raise ValueError(f"the ICC profile is damaged: it claims {count} tags")
    result = {}
    for index in range(count):
        start = HEADER_BYTES + 4 + TAG_BYTES * index
        signature, offset, size = struct.unpack(">4sII", profile[start : start + TAG_BYTES])
        result[signature.decode("latin-1")] = profile[offset : offset + size]
    return result


def _curve(element: bytes) -> Curve:
    """The function of a curveType or parametricCurveType element, from 0..1 to 0..1."""
    if element[:4] == b"curv":
        (count,) = struct.unpack(">I", element[8:12])
        table = (
            np.array(struct.unpack(f">{count}H", element[12 : 12 + 2 * count]))
            if count < 2**17
            else np.zeros(0)
        )
        if count == 0:
            return lambda x: x
        if count == 1:
            gamma = float(table[0]) / 256.0
            return lambda x: x**gamma
        if len(table) == 0:
            raise ValueError("the ICC profile is damaged: a curve is too long")
        return lambda x: np.interp(x, np.linspace(0, 1, count), table / 65535.0)
    if element[:4] != b"para":
        raise ValueError("the ICC profile is damaged: a curve has an unknown type")
    (kind,) = struct.unpack(">H", element[8:10])
    if kind >= len(PARAMETERS):
        raise ValueError("the ICC profile is damaged: a parametric curve has an unknown type")
    values = (
        np.array(struct.unpack(f">{PARAMETERS[kind]}i", element[12 : 12 + 4 * PARAMETERS[kind]]))
        / 65536.0
    )
    return _parametric(kind, values)


def _parametric(kind: int, values: np.ndarray) -> Curve:
    """Y = (a X + b)^g + e above d, c X + f below it; the shorter types leave out the rest
    (ICC.1:2022, table 68).
    """
    g, a, b, c, d, e, f = np.pad(values, (0, 7 - len(values))).tolist()
    if kind == 0:
        a, d = 1.0, -1.0
    elif kind in (1, 2):
        d, e, f, c = -b / a if a else 0.0, (c if kind == 2 else 0.0), (c if kind == 2 else 0.0), 0.0

    def evaluate(x: np.ndarray) -> np.ndarray:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            return np.clip(
                np.where(x >= d, np.maximum(a * x + b, 0.0) ** g + e, c * x + f), 0.0, 1.0
            )

    return evaluate


def _description(tags: dict[str, bytes]) -> str:
    """The profile's own name: text (version 2) or localized Unicode (version 4); empty when it has
    none.
    """
    element = tags.get("desc", b"")
    if element[:4] == b"desc":
        (length,) = struct.unpack(">I", element[8:12])
        text = element[12 : 12 + length].decode("latin-1")
    elif element[:4] == b"mluc" and len(element) >= 28:
        length, offset = struct.unpack(">II", element[20:28])
        text = element[offset : offset + length].decode("utf-16-be", "replace")
    else:
        return ""
    return " ".join("".join(letter for letter in text if letter.isprintable()).split())[:60]

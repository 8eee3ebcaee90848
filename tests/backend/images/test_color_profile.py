"""Photos of other color spaces decode to the same light."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image, ImageCms

from facestage.contract.errors import InputError
from facestage.contract.files.color import linear_to_srgb, srgb_to_linear
from facestage.images.color_profile import chromaticities_to_rec709, decoder_of
from facestage.images.image_io import read_photograph, write_exr
from reference.known import known

# CIE XYZ under D50 of the primaries, as Apple's and Adobe's own profiles have them.
P3 = np.array(
    [[0.51512, 0.29198, 0.15710], [0.24120, 0.69225, 0.06657], [-0.00105, 0.04189, 0.78407]]
)
ADOBE = np.array(
    [[0.60974, 0.20528, 0.14919], [0.31111, 0.62567, 0.06322], [0.01947, 0.06087, 0.74457]]
)
REC709 = np.array(
    [[0.43607, 0.38515, 0.14307], [0.22249, 0.71687, 0.06061], [0.01392, 0.09708, 0.71410]]
)
SRGB_CURVE = (3, (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045))
# linear Rec. 709: inside every gamut here
COLORS = np.random.default_rng(1).uniform(0.02, 0.7, (6, 8, 3))


def profile(to_xyz: np.ndarray, curve: bytes, name: str = "Test", space: bytes = b"RGB ") -> bytes:
    """The bytes of a display profile of version 4: a matrix and one curve for all channels, or
    grey.
    """
    text = name.encode("utf-16-be")
    tags = {
        b"desc": b"mluc"
        + bytes(4)
        + struct.pack(">II2s2sII", 1, 12, b"en", b"US", len(text), 28)
        + text
    }
    tags[b"wtpt"] = (
        b"XYZ "
        + bytes(4)
        + struct.pack(">3i", *np.round(np.array([0.9642, 1, 0.8249]) * 65536).astype(int))
    )
    if space == b"GRAY":
        tags[b"kTRC"] = curve
    else:
        for channel, letter in enumerate(b"rgb"):
            fixed = np.round(to_xyz[:, channel] * 65536).astype(int)
            tags[bytes([letter]) + b"XYZ"] = b"XYZ " + bytes(4) + struct.pack(">3i", *fixed)
            tags[bytes([letter]) + b"TRC"] = curve
    offset, table, body = 132 + 12 * len(tags), struct.pack(">I", len(tags)), b""
    for signature, element in tags.items():
        element += bytes(-len(element) % 4)
        table += struct.pack(">4sII", signature, offset + len(body), len(element))
        body += element
    size = offset + len(body)
    header = struct.pack(
        ">I4sI4s4s4s12s4s", size, b"lcms", 0x04300000, b"mntr", space, b"XYZ ", bytes(12), b"acsp"
    )
    header += bytes(28) + struct.pack(">3i", 63190, 65536, 54061)
    return header + bytes(128 - len(header)) + table + body


def gamma(value: float) -> bytes:
    return b"curv" + bytes(4) + struct.pack(">IH", 1, round(value * 256)) + bytes(2)


def parametric(kind: int, values: tuple[float, ...]) -> bytes:
    return (
        b"para"
        + bytes(4)
        + struct.pack(">HH", kind, 0)
        + b"".join(struct.pack(">i", round(value * 65536)) for value in values)
    )


LINEAR = b"curv" + bytes(4) + struct.pack(">I", 0)
TABLE = (
    b"curv"
    + bytes(4)
    + struct.pack(">I", 1024)
    + b"".join(
        struct.pack(">H", round(65535 * float(srgb_to_linear(np.array(k / 1023)))))
        for k in range(1024)
    )
)
Curve = Callable[[np.ndarray], np.ndarray]
# Colorants, curve, and by formula: to codes and back.
SPACES: dict[str, tuple[np.ndarray, bytes, Curve, Curve]] = {
    "p3": (P3, parametric(*SRGB_CURVE), linear_to_srgb, srgb_to_linear),
    "p3-table": (P3, TABLE, linear_to_srgb, srgb_to_linear),
    "adobe": (ADOBE, gamma(563 / 256), lambda x: x ** (256 / 563), lambda x: x ** (563 / 256)),
    "linear": (REC709, LINEAR, lambda x: x, lambda x: x),
    "gamma-offset": (REC709, parametric(1, (2.0, 1.0, 0.0)), np.sqrt, np.square),
}


def encoded(name: str) -> tuple[bytes, np.ndarray]:
    """The profile of a space and COLORS in its codes, 0..1."""
    to_xyz, curve, encode, _ = SPACES[name]
    own = COLORS @ (np.linalg.inv(to_xyz) @ REC709).T
    return profile(to_xyz, curve, name), encode(np.clip(own, 0, 1))


@pytest.mark.parametrize("name", SPACES)
def test_a_tagged_photo_shows_the_same_light(tmp_path: Path, name: str):
    icc, codes = encoded(name)
    Image.fromarray(np.round(codes * 255).astype(np.uint8)).save(
        tmp_path / "a.png", icc_profile=icc
    )
    photo = read_photograph(tmp_path / "a.png")
    to_xyz, _, _, decode = SPACES[name]
    rounded = decode(np.round(codes * 255) / 255) @ (np.linalg.inv(REC709) @ to_xyz).T
    np.testing.assert_allclose(photo.color, rounded, atol=0.5 / 255)
    # what 8 bits in this space can say
    np.testing.assert_allclose(photo.color, COLORS, atol=2 / 255)
    assert photo.color_space == name


@pytest.mark.parametrize("name", SPACES)
def test_littlecms_agrees(name: str):
    """The same codes through LittleCMS to sRGB, which rounds to 8 bits."""
    icc, codes = encoded(name)
    image = Image.fromarray(np.round(codes * 255).astype(np.uint8))
    other = ImageCms.profileToProfile(
        image,
        ImageCms.ImageCmsProfile(io.BytesIO(icc)),
        ImageCms.createProfile("sRGB"),
        renderingIntent=ImageCms.Intent.RELATIVE_COLORIMETRIC,
    )
    decoder = decoder_of(icc)
    assert decoder is not None
    ours = linear_to_srgb(np.clip(decoder(np.asarray(image)), 0, 1))
    np.testing.assert_allclose(ours, np.asarray(other) / 255.0, atol=1.6 / 255)


def test_an_srgb_profile_changes_nothing(tmp_path: Path):
    pixels = np.random.default_rng(0).integers(0, 256, (5, 7, 3)).astype(np.uint8)
    Image.fromarray(pixels).save(tmp_path / "a.png")
    own = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    Image.fromarray(pixels).save(tmp_path / "b.png", icc_profile=own)
    plain, tagged = read_photograph(tmp_path / "a.png"), read_photograph(tmp_path / "b.png")
    np.testing.assert_array_equal(plain.color, tagged.color)
    assert plain.color_space == tagged.color_space == "sRGB"


def test_colors_beyond_the_gamut_stay_bright_and_never_negative(tmp_path: Path):
    icc = profile(P3, parametric(*SRGB_CURVE))
    Image.new("RGB", (2, 2), (255, 0, 0)).save(tmp_path / "a.png", icc_profile=icc)
    photo = read_photograph(tmp_path / "a.png")
    np.testing.assert_allclose(photo.color[0, 0], [1.2249, 0, 0], atol=2e-3)
    assert photo.clipped[0, 0].tolist() == [True, False, False]


@pytest.mark.parametrize("suffix", ["png", "tif"])
@pytest.mark.parametrize("orientation", [1, 6])
def test_sixteen_bit_color_keeps_its_precision(tmp_path: Path, suffix: str, orientation: int):
    codes = np.random.default_rng(2).integers(0, 65536, (4, 6, 3)).astype(np.uint16)
    codes[0, 0], codes[0, 1] = 1000, 1001
    cv2.imwrite(str(tmp_path / f"a.{suffix}"), codes[..., ::-1])
    if suffix == "png" and orientation != 1:
        # The orientation is in a chunk before the pixels.
        data, exif = (tmp_path / "a.png").read_bytes(), Image.Exif()
        exif[0x0112] = orientation
        body = b"eXIf" + exif.tobytes().removeprefix(b"Exif\x00\x00")
        chunk = struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))
        (tmp_path / "a.png").write_bytes(data[:33] + chunk + data[33:])
        codes = np.rot90(codes, -1)
    color = read_photograph(tmp_path / f"a.{suffix}").color
    np.testing.assert_allclose(color, srgb_to_linear(codes / 65535.0), atol=1e-6)


def test_sixteen_bit_color_has_profiles_too(tmp_path: Path):
    icc, codes = encoded("adobe")
    cv2.imwrite(str(tmp_path / "a.png"), np.round(codes * 65535).astype(np.uint16)[..., ::-1])
    data = (tmp_path / "a.png").read_bytes()
    body = b"iCCPx\x00\x00" + zlib.compress(icc)
    chunk = struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))
    (tmp_path / "a.png").write_bytes(data[:33] + chunk + data[33:])
    np.testing.assert_allclose(read_photograph(tmp_path / "a.png").color, COLORS, atol=5e-4)


def test_grey_profiles(tmp_path: Path):
    grey = np.linspace(0, 255, 24).astype(np.uint8).reshape(4, 6)
    icc = profile(REC709, gamma(1.8), space=b"GRAY")
    Image.fromarray(grey).save(tmp_path / "a.png", icc_profile=icc)
    expected = np.repeat(((grey / 255.0) ** (round(1.8 * 256) / 256))[..., None], 3, axis=2)
    np.testing.assert_allclose(read_photograph(tmp_path / "a.png").color, expected, atol=1e-5)


def test_lab_profiles_go_through_littlecms(tmp_path: Path):
    """What is no matrix and curves: a TIFF in CIE Lab, of which LittleCMS knows the colors."""
    srgb = Image.fromarray(np.round(linear_to_srgb(COLORS) * 255).astype(np.uint8))
    lab_profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("LAB"))
    lab = known(
        ImageCms.profileToProfile(
            srgb, ImageCms.createProfile("sRGB"), lab_profile, outputMode="LAB"
        )
    )
    lab.save(tmp_path / "a.tif", icc_profile=lab_profile.tobytes())
    photo = read_photograph(tmp_path / "a.tif")
    np.testing.assert_allclose(linear_to_srgb(photo.color), np.asarray(srgb) / 255.0, atol=12 / 255)
    assert "LittleCMS" in photo.color_space


@pytest.mark.parametrize("cut", [0, 40, 131, 140, 300])
def test_damaged_and_foreign_profiles_are_ignored(tmp_path: Path, cut: int):
    pixels = np.random.default_rng(0).integers(0, 256, (5, 7, 3)).astype(np.uint8)
    icc = profile(P3, parametric(*SRGB_CURVE))[:cut] or b"no profile at all"
    Image.fromarray(pixels).save(tmp_path / "a.png", icc_profile=icc)
    np.testing.assert_allclose(
        read_photograph(tmp_path / "a.png").color, srgb_to_linear(pixels / 255.0), atol=1e-6
    )
    Image.fromarray(pixels).convert("CMYK").save(
        tmp_path / "b.jpg", icc_profile=profile(P3, LINEAR)
    )
    assert np.isfinite(read_photograph(tmp_path / "b.jpg").color).all()


@pytest.mark.parametrize("changes", range(40))
def test_no_profile_crashes(changes: int):
    random = np.random.default_rng(changes)
    icc = bytearray(profile(P3, TABLE if changes % 2 else parametric(*SRGB_CURVE)))
    for position in random.integers(0, min(len(icc), 500), 6):
        icc[position] ^= int(random.integers(1, 256))
    try:
        decoder = decoder_of(bytes(icc))
    except ValueError:
        return
    if decoder is not None:
        assert np.isfinite(decoder(np.arange(24, dtype=np.uint8).reshape(2, 4, 3) * 10)).all()


@pytest.mark.parametrize("suffix", [".webp", ".tif"])
def test_other_containers(tmp_path: Path, suffix: str):
    pixels = np.random.default_rng(0).integers(0, 256, (5, 7, 3)).astype(np.uint8)
    icc, codes = encoded("p3")
    Image.fromarray(pixels).save(tmp_path / f"a{suffix}", lossless=True)
    np.testing.assert_allclose(
        read_photograph(tmp_path / f"a{suffix}").color, srgb_to_linear(pixels / 255.0), atol=1e-6
    )
    Image.fromarray(np.round(codes * 255).astype(np.uint8)).save(
        tmp_path / f"b{suffix}", icc_profile=icc, lossless=True
    )
    np.testing.assert_allclose(read_photograph(tmp_path / f"b{suffix}").color, COLORS, atol=1 / 255)


def test_what_must_be_exported_first_says_so(tmp_path: Path):
    (tmp_path / "a.heic").write_bytes(b"\x00\x00\x00\x18ftypheic\x00\x00\x00\x00mif1heic")
    with pytest.raises(InputError, match=r"HEIC.*JPEG"):
        read_photograph(tmp_path / "a.heic")
    (tmp_path / "a.dng").write_bytes(b"II*\x00" + bytes(64))
    with pytest.raises(InputError, match=r"raw.*JPEG"):
        read_photograph(tmp_path / "a.dng")
    for kind in (np.float32, np.int32):
        Image.fromarray(np.zeros((4, 4), kind)).save(tmp_path / "a.tif")
        with pytest.raises(InputError, match=r"32 bits.*EXR"):
            read_photograph(tmp_path / "a.tif")


def test_exr_chromaticities(tmp_path: Path):
    """ACEScg, by the matrix that its makers publish for Rec. 709 (Bradford from D60)."""
    values = np.array([0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767])
    published = np.array(
        [
            [1.70505, -0.62179, -0.08326],
            [-0.13026, 1.14080, -0.01055],
            [-0.02400, -0.12897, 1.15297],
        ]
    )
    matrix = chromaticities_to_rec709(values)
    assert matrix is not None
    np.testing.assert_allclose(matrix, published, atol=5e-4)
    write_exr(tmp_path / "a.exr", COLORS)
    data = (tmp_path / "a.exr").read_bytes()
    attribute = b"chromaticities\x00chromaticities\x00" + struct.pack("<i8f", 32, *values)
    # Chunk offsets are from the start of the file: a header that grew moves them.
    data = _with_attribute(data, attribute)
    (tmp_path / "b.exr").write_bytes(data)
    plain, tagged = read_photograph(tmp_path / "a.exr"), read_photograph(tmp_path / "b.exr")
    np.testing.assert_allclose(tagged.color, np.maximum(plain.color @ matrix.T, 0), atol=1e-5)
    assert tagged.mask.all() and "chromaticities" in tagged.color_space


def _with_attribute(data: bytes, attribute: bytes) -> bytes:
    """The bytes of a one-part scan-line EXR with one more attribute in its header."""
    position = 8
    while data[position]:
        position = data.index(b"\x00", data.index(b"\x00", position) + 1) + 1
        position += 4 + struct.unpack("<i", data[position : position + 4])[0]
    first = struct.unpack("<Q", data[position + 1 : position + 9])[0]
    count = (first - position - 1) // 8
    offsets = struct.unpack(f"<{count}Q", data[position + 1 : first])
    moved = struct.pack(f"<{count}Q", *(offset + len(attribute) for offset in offsets))
    return data[:position] + attribute + b"\x00" + moved + data[first:]


def test_the_first_picture_of_several_is_the_photo(tmp_path: Path):
    """Phones write JPEGs of more than one picture, a depth map for instance."""
    first, second = (Image.new("RGB", (16, 8), color) for color in ((200, 30, 30), (30, 30, 200)))
    first.save(tmp_path / "a.jpg", format="MPO", save_all=True, append_images=[second])
    first.save(tmp_path / "b.webp", save_all=True, append_images=[second], lossless=True)
    for name in ("a.jpg", "b.webp"):
        color = read_photograph(tmp_path / name).color
        assert color.shape == (8, 16, 3) and (color[..., 0] > 5 * color[..., 2]).all()

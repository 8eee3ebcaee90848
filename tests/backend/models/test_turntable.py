"""The contact sheets show the nearest surface in the right place and are readable PNG files."""

import zlib

import numpy as np

from facestage.models.turntable import picture, sheet, write_png


def _square(z: float, half: float) -> np.ndarray:
    return np.array([[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]])


def test_nearer_square_hides_the_farther_one_and_back_faces_do_not_show():
    vertices = np.concatenate([_square(0.0, 0.1), _square(0.05, 0.04)])
    triangles = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    albedo = np.repeat([[0.4, 0.0, 0.0], [0.0, 0.4, 0.0]], 4, axis=0)
    image = picture(vertices, triangles, albedo, size=60, center=(0, 0, 0), height=0.3)
    assert image.shape == (72, 60, 3)
    assert image[36, 30, 1] > 0 == image[36, 30, 0]
    assert image[36, 14, 0] > 0 == image[36, 14, 1]
    assert np.ptp(image[2, 2]) == 0, "the corner is background"
    behind = picture(vertices, triangles, albedo, yaw=180.0, size=60, center=(0, 0, 0), height=0.3)
    assert np.ptp(behind) == 0


def test_positive_yaw_shows_the_subjects_left():
    vertices = _square(0.0, 0.05) @ np.array([[0, 0, -1], [0, 1, 0], [1, 0, 0]]) + [0.08, 0, 0]
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    albedo = np.full((4, 3), 0.2)
    seen = [
        np.ptp(picture(vertices, triangles, albedo, yaw, 40, (0, 0, 0), 0.3)) > 0
        for yaw in (60.0, -60.0)
    ]
    assert seen == [True, False]


def test_sheet_and_png(tmp_path):
    pictures = [np.full((12, 10, 3), value) for value in (0.0, 0.5, 1.0)]
    image = sheet(pictures, 2)
    assert image.shape == (24, 20, 3)
    write_png(tmp_path / "sheet.png", image)
    data = (tmp_path / "sheet.png").read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    start = data.index(b"IDAT") + 4
    length = int.from_bytes(data[start - 8 : start - 4], "big")
    rows = (
        np.frombuffer(zlib.decompress(data[start : start + length]), np.uint8)
        .reshape(24, 61)[:, 1:]
        .reshape(24, 20, 3)
    )
    assert rows[0, 0, 0] == 0 and rows[0, 15, 0] == 188 and rows[20, 0, 0] == 255

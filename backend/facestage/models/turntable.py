"""Contact sheets of a face model, to look at it while it is being modelled: views, modes,
expressions, people.

`python -m facestage.models.turntable FOLDER` writes them as PNG. Points strewn over the
triangles, the nearest of each pixel kept: quick and good enough for proportions and folds; the fit
has its own ray tracer.
"""

from __future__ import annotations

import struct
import sys
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from facestage.contract.face_model import FaceModel
from facestage.contract.files.color import linear_to_srgb
from facestage.models.head.default_head import build_default_model

# direction from the face, level
_LIGHTS = ((np.array([-0.45, 0.55, 0.70]), 1.5), (np.array([0.85, 0.10, 0.45]), 0.45))
_AMBIENT = 0.4
_BACKGROUND = 0.78


def picture(
    vertices: np.ndarray,
    triangles: np.ndarray,
    albedo: np.ndarray,
    yaw: float = 0.0,
    size: int = 200,
    center: tuple[float, float, float] = (0.0, -0.01, -0.06),
    height: float = 0.36,
) -> np.ndarray:
    """(1.2 size, size, 3) float64 linear RGB: an orthographic view of a mesh from `yaw` degrees,
    `height` metres tall.

    vertices (n, 3) metres in the model frame, triangles (t, 3), albedo (n, 3) linear RGB. A
    positive yaw shows more of the subject's left. Lights turn with the camera.
    """
    rows, columns = int(1.2 * size), size
    angle = np.radians(yaw)
    to_camera = np.array(
        [[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]]
    )
    points = (vertices.astype(np.float64) - center) @ to_camera.T
    scale = rows / height
    screen = np.stack(
        [columns / 2 + points[:, 0] * scale, rows / 2 - points[:, 1] * scale, points[:, 2]], axis=-1
    )
    shade = _shaded(points, triangles, albedo)
    corner, color = screen[triangles], shade[triangles]
    winding = np.linalg.det(corner[:, 1:, :2] - corner[:, :1, :2])
    # counterclockwise from outside is clockwise on a screen whose y points down
    facing = winding < 0
    if not facing.any():
        return np.full((rows, columns, 3), _BACKGROUND)
    pixel, nearness, radiance = _samples(corner[facing], color[facing], rows, columns)
    image = np.full((rows * columns, 3), _BACKGROUND)
    order = np.argsort(nearness, kind="stable")
    image[pixel[order]] = radiance[order]  # the nearest sample of a pixel is written last
    return image.reshape(rows, columns, 3)


def sheet(pictures: Sequence[np.ndarray], columns: int) -> np.ndarray:
    """Pictures of one size side by side, `columns` in a row."""
    blank = np.full_like(pictures[0], _BACKGROUND)
    padded = [*pictures, *[blank] * (-len(pictures) % columns)]
    return np.concatenate(
        [np.concatenate(padded[k : k + columns], 1) for k in range(0, len(padded), columns)]
    )


def write_png(path: Path, image: np.ndarray) -> None:
    """Write linear RGB (h, w, 3) as an 8-bit sRGB PNG."""
    pixels = np.round(255 * linear_to_srgb(np.clip(image, 0.0, 1.0))).astype(np.uint8)
    # each row starts with filter type 0
    rows = np.pad(pixels.reshape(len(pixels), -1), ((0, 0), (1, 0)))

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    header = struct.pack(">IIBBBBB", pixels.shape[1], pixels.shape[0], 8, 2, 0, 0, 0)
    body = (
        chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows.tobytes())) + chunk(b"IEND", b"")
    )
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + body)


def views(model: FaceModel) -> np.ndarray:
    """The mean from eight sides."""
    return sheet(
        [
            picture(model.vertices, model.triangles, model.albedo_mean, yaw)
            for yaw in range(0, 360, 45)
        ],
        4,
    )


def identity_sheet(model: FaceModel, count: int, sigma: float = 2.0) -> np.ndarray:
    """The first identity modes at minus and plus `sigma` standard deviations, in pairs."""
    shapes = (
        model.shape(sign * sigma * unit)
        for unit in np.eye(len(model.identity_names))[:count]
        for sign in (-1, 1)
    )
    return sheet(
        [picture(shape, model.triangles, model.albedo_mean, 35.0, 130) for shape in shapes], 12
    )


def expression_sheet(model: FaceModel) -> np.ndarray:
    """Every expression at weight 1."""
    shapes = (model.shape(None, unit) for unit in np.eye(len(model.expression_names)))
    center = (0.0, 0.0, 0.0)
    return sheet(
        [picture(s, model.triangles, model.albedo_mean, 15.0, 130, center, 0.22) for s in shapes],
        15,
    )


def people_sheet(model: FaceModel, count: int = 18, seed: int = 0) -> np.ndarray:
    """Random people: shape and skin drawn from the priors."""
    rng = np.random.default_rng(seed)
    pictures = []
    for person in range(count):
        shape = model.shape(rng.standard_normal(len(model.identity_names)))
        albedo = model.albedo(0.5 * rng.standard_normal(len(model.albedo_basis)))
        pictures.append(picture(shape, model.triangles, albedo, (0.0, 40.0, 80.0)[person % 3], 180))
    return sheet(pictures, 6)


def _shaded(points: np.ndarray, triangles: np.ndarray, albedo: np.ndarray) -> np.ndarray:
    """(n, 3) diffuse radiance of each vertex."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    face_normal = np.cross(b - a, c - a)
    normal = np.zeros_like(points)
    for k in range(3):
        np.add.at(normal, triangles[:, k], face_normal)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    irradiance = np.full(len(points), _AMBIENT)
    for direction, level in _LIGHTS:
        irradiance += level * np.maximum(normal @ (direction / np.linalg.norm(direction)), 0.0)
    return albedo * irradiance[:, None]


def _samples(
    corner: np.ndarray, color: np.ndarray, rows: int, columns: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixel (m,), nearness (m,) and color (m, 3) of points strewn over triangles, closer than a
    pixel to each other.
    """
    longest = np.linalg.norm(corner[:, :, :2] - np.roll(corner[:, :, :2], 1, axis=1), axis=2).max(
        axis=1
    )
    steps = np.minimum(np.ceil(1.6 * longest).astype(int) + 1, 64)
    points, colors = [], []
    for count in np.unique(steps):
        i, j = np.meshgrid(np.arange(count + 1), np.arange(count + 1))
        inside = i + j <= count
        weights = np.stack([count - i[inside] - j[inside], i[inside], j[inside]], axis=-1) / count
        chosen = steps == count
        points.append(np.einsum("sk,tkc->tsc", weights, corner[chosen]).reshape(-1, 3))
        colors.append(np.einsum("sk,tkc->tsc", weights, color[chosen]).reshape(-1, 3))
    point, radiance = np.concatenate(points), np.concatenate(colors)
    column, row = np.floor(point[:, 0]).astype(int), np.floor(point[:, 1]).astype(int)
    seen = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    return (row * columns + column)[seen], point[seen, 2], radiance[seen]


def main(folder: Path) -> None:
    """Write all sheets of the default head into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    model = build_default_model()
    write_png(folder / "views.png", views(model))
    write_png(folder / "identity.png", identity_sheet(model, 30))
    write_png(folder / "expressions.png", expression_sheet(model))
    write_png(folder / "people.png", people_sheet(model))


if __name__ == "__main__":
    main(Path(sys.argv[1]))

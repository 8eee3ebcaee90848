"""The fitted light: its lat-long map with the lights marked, and two spheres lit by it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from facestage.contract.light_stage import OFF, LightStage
from facestage.report.color import clean, luminance, shrink, to_srgb8
from facestage.report.figure import DARK, Canvas
from facestage.report.report_data import ReportData

WIDTH, HEIGHT = 800, 400
SPHERE = 172
MATTE_PIXELS, MIRROR_PIXELS = 64, 344
LABELLED = 14
_INTEGRATION_WIDTH = 48  # pixels of the map that the matte sphere integrates over


def draw_light_probe(path: Path, data: ReportData) -> None:
    """The map with the camera's direction in the middle and right as in the photo, its brightest
    light white.
    """
    # An environment map is seen from inside; the report shows it as the camera sees the face.
    probe = clean(data.light_probe[:, ::-1])
    canvas = Canvas(WIDTH + SPHERE + 76, HEIGHT + 92, DARK)
    shown = shrink(probe)
    shown = shown / max(float(shown.max()), 1e-12)
    canvas.text(20, 28, "Light around the face", 12, weight="bold")
    axes, _ = canvas.picture(
        20, 44, WIDTH, HEIGHT, to_srgb8(shown), extent=(0, 1, 1, 0), aspect="auto"
    )
    _draw_grid(axes)
    _mark_lights(axes, data.result.stage)
    axes.set_xlim(0, 1)
    axes.set_ylim(1, 0)
    for u, name in ((0.25, "left"), (0.5, "camera"), (0.75, "right")):
        canvas.text(20 + u * WIDTH, HEIGHT + 66, name, 10, DARK.muted, ha="center")
    canvas.text(20, HEIGHT + 66, "behind", 10, DARK.muted)
    canvas.text(20 + WIDTH, HEIGHT + 66, "behind", 10, DARK.muted, ha="right")
    left = WIDTH + 52
    to_stage = data.result.camera_to_stage[:3, :3]
    for top, name, sphere in (
        (44, "matte sphere", matte_sphere(probe, to_stage)),
        (44 + HEIGHT - SPHERE, "mirror sphere", mirror_sphere(probe, to_stage)),
    ):
        canvas.picture(left, top, SPHERE, SPHERE, _rgba(sphere), interpolation="bicubic")
        canvas.text(left + SPHERE / 2, top + SPHERE + 22, name, 10, DARK.muted, ha="center")
    canvas.save(path)


def latlong(direction: np.ndarray) -> np.ndarray:
    """(n, 2) place (u right, v down, 0..1) of stage-frame directions (n, 3) on a map with +Z in its
    middle.

    Right of +Z comes +X, so that a light at the photo's right is right on the map.
    """
    x, y, z = np.moveaxis(np.asarray(direction, np.float64), -1, 0)
    length = np.maximum(np.sqrt(x**2 + y**2 + z**2), 1e-12)
    u = 0.5 + np.arctan2(x, z) / (2 * np.pi)
    v = np.arccos(np.clip(y / length, -1, 1)) / np.pi
    return np.stack([u, v], axis=-1)


def latlong_directions(height: int, width: int) -> np.ndarray:
    """(height, width, 3) unit directions of the pixel centres of such a map; the inverse of
    :func:`latlong`.
    """
    azimuth = 2 * np.pi * ((np.arange(width) + 0.5) / width - 0.5)
    polar = np.pi * (np.arange(height)[:, None] + 0.5) / height
    x, y, z = np.sin(polar) * np.sin(azimuth), np.cos(polar), np.sin(polar) * np.cos(azimuth)
    return np.stack(np.broadcast_arrays(x, y, z), axis=-1)


def matte_sphere(probe: np.ndarray, to_stage: np.ndarray) -> np.ndarray:
    """(p, p, 4) linear RGBA of a white Lambert sphere (radiance = irradiance / pi) seen by the
    camera.

    ``probe`` (H, W, 3) with +Z in its middle; ``to_stage`` (3, 3) turns camera axes to stage axes.
    """
    small = shrink(probe, _INTEGRATION_WIDTH)
    height, width = small.shape[:2]
    incoming = latlong_directions(height, width).reshape(-1, 3).astype(np.float32)
    solid_angle = (
        np.sin(np.pi * (np.arange(height) + 0.5) / height) * (2 * np.pi / width) * (np.pi / height)
    )
    power = (small * solid_angle[:, None, None]).reshape(-1, 3).astype(np.float32)
    normals, alpha = _sphere_normals(MATTE_PIXELS)
    cosine = np.maximum(normals.reshape(-1, 3) @ (to_stage.astype(np.float32).T @ incoming.T), 0.0)
    radiance = (cosine @ power).reshape(normals.shape) / np.pi
    return np.concatenate([radiance, alpha[..., None]], axis=-1)


def mirror_sphere(probe: np.ndarray, to_stage: np.ndarray) -> np.ndarray:
    """(p, p, 4) linear RGBA of a mirror ball; arguments as for :func:`matte_sphere`."""
    normals, alpha = _sphere_normals(MIRROR_PIXELS)
    reflected = 2.0 * normals[..., 2:] * normals - np.array([0.0, 0.0, 1.0], np.float32)
    place = latlong(reflected @ to_stage.T)
    height, width = probe.shape[:2]
    column = np.clip((place[..., 0] * width).astype(int), 0, width - 1)
    row = np.clip((place[..., 1] * height).astype(int), 0, height - 1)
    return np.concatenate([probe[row, column], alpha[..., None]], axis=-1)


def _sphere_normals(pixels: int) -> tuple[np.ndarray, np.ndarray]:
    """Camera-frame normals (pixels, pixels, 3) float32 of a sphere that fills the picture, and its
    smooth outline.
    """
    axis = (2.0 * (np.arange(pixels, dtype=np.float32) + 0.5) / pixels) - 1.0
    x, y = np.meshgrid(axis, -axis)
    radius = np.hypot(x, y)
    inside = np.maximum(radius, 1.0)
    x, y = x / inside, y / inside
    z = np.sqrt(np.maximum(1.0 - x**2 - y**2, 0.0))
    alpha = np.clip((1.0 - radius) * pixels / 2 + 0.5, 0.0, 1.0)
    return np.stack([x, y, z], axis=-1), alpha


def _rgba(sphere: np.ndarray) -> np.ndarray:
    """The sphere as the screen shows it, its brightest point nearly white."""
    color = to_srgb8(0.95 * sphere[..., :3] / max(float(sphere[..., :3].max()), 1e-12))
    return np.concatenate([color, np.round(255 * sphere[..., 3:]).astype(np.uint8)], axis=-1)


def _draw_grid(axes: object) -> None:
    for u in (0.25, 0.5, 0.75):
        axes.axvline(u, color="white", lw=0.8, alpha=0.14)  # type: ignore[attr-defined]
    axes.axhline(0.5, color="white", lw=0.8, alpha=0.14)  # type: ignore[attr-defined]


def light_power(stage: LightStage) -> np.ndarray:
    """(N,) luminance times area of each light: proportional to what it sends along its axis."""
    return luminance(stage.radiance) * stage.side**2


def _mark_lights(axes: object, stage: LightStage) -> None:
    """Every light as a ring, off ones as crosses; the strongest carry their number in the table."""
    place = latlong(stage.position)
    power = light_power(stage)
    off = (stage.state == OFF) | (power <= 0)
    scatter = axes.scatter  # type: ignore[attr-defined]
    scatter(*place[off].T, s=22, marker="x", color="white", alpha=0.35, lw=1)
    scatter(*place[~off].T, s=30, facecolors="none", edgecolors="white", alpha=0.75, lw=1)
    for index in [
        index for index in np.argsort(-power, kind="stable")[:LABELLED] if not off[index]
    ]:
        rise = 5 if place[index][1] > 0.06 else -14
        axes.annotate(  # type: ignore[attr-defined]
            str(index + 1),
            place[index],
            xytext=(7, rise),
            textcoords="offset points",
            color="white",
            fontsize=10,
            weight="bold",
            path_effects=_outline(),
        )


def _outline() -> list[object]:
    from matplotlib.patheffects import withStroke

    return [withStroke(linewidth=2.5, foreground="black")]

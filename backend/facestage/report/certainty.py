"""Each vertex's standard deviation as colors on the fitted face: as in the photo, and from the
side.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from facestage.contract.certainty import COLOR_MAP, DEVIATION, finite_mm, scale_end
from facestage.report.figure import DARK, Canvas
from facestage.report.plotting import load_matplotlib
from facestage.report.report_data import ReportData

CERTAINTY = "certainty.png"
PANEL, MARGIN, GAP = 400, 20, 14
# Brightness of a polygon that is seen edge-on: enough shading to see the shape, too little to
# change a color.
EDGE_BRIGHTNESS = 0.6
BORDER = 0.12  # around the face, as a share of its longer side


@dataclass(frozen=True)
class _Head:
    """What is drawn."""

    vertices: np.ndarray  # (n, 3) camera frame
    triangles: np.ndarray  # (t, 3)
    face: np.ndarray  # (f,) int, the vertices that must be in the picture


def draw_certainty(path: Path, data: ReportData) -> None:
    """Three panels: total deviation as in the photo and from the side, and the camera's axis alone
    from the side.

    The side is the one that the photo shows more of; orthographic. Needs the result's array
    DEVIATION (n, 3) in mm along the camera's axes.
    """
    result = data.result
    deviation = finite_mm(result.arrays[DEVIATION])
    triangles = result.triangles if data.surface is None else data.surface
    total, depth = np.linalg.norm(deviation, axis=1), deviation[:, 2]
    front = np.eye(3)
    side = _side_view(result.model_to_camera[:3, :3])
    face = np.arange(len(total)) if data.face is None else data.face
    head = _Head(result.vertices, triangles, face)
    limit = scale_end(total, face)
    panels = (
        ("As in the photo", front, total),
        ("From the side", side, total),
        ("From the side, depth alone", side, depth),
    )
    canvas = Canvas(2 * MARGIN + 3 * PANEL + 2 * GAP, 44 + PANEL + 70, DARK)
    for number, (title, view, colors) in enumerate(panels):
        left = MARGIN + number * (PANEL + GAP)
        canvas.text(left, 28, title, 12, weight="bold")
        axes = canvas.axes(left, 44, PANEL, PANEL)
        artist = _draw(axes, head, view, colors, limit)
    bar = canvas.color_bar(
        MARGIN, 44 + PANEL + 16, 3 * PANEL + 2 * GAP, 10, artist, [0, limit / 2, limit]
    )
    labels = bar.ax.get_xticklabels()
    labels[0].set_ha("left")
    labels[-1].set_ha("right")
    middle = MARGIN + 1.5 * PANEL + GAP
    canvas.text(middle, 44 + PANEL + 60, "one standard deviation, mm", 9.5, DARK.muted, ha="center")
    canvas.save(path)


def _side_view(rotation: np.ndarray) -> np.ndarray:
    """(3, 3) from the camera frame to a view along the head's ear-to-ear axis, from the side that
    the photo shows.
    """
    right = 1.0 if rotation[2, 0] >= 0 else -1.0  # the head's own +X turned towards the camera
    axis, up = right * rotation[:, 0], rotation[:, 1]
    return np.stack([np.cross(up, axis), up, axis])


def _facing(
    vertices: np.ndarray, triangles: np.ndarray, view: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the triangles that face the viewer, far ones first, and (n,) the cosine between
    each vertex's normal and the view.
    """
    turned = vertices.astype(np.float64) @ view.T
    corners = turned[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal = np.where(np.isfinite(normal), normal, 0.0)
    seen = np.flatnonzero((normal[:, 2] > 0) & np.isfinite(corners).all(axis=(1, 2)))
    order = seen[np.argsort(corners[seen, :, 2].mean(axis=1), kind="stable")]
    at_vertex = np.stack(
        [
            np.bincount(triangles.ravel(), np.repeat(normal[:, axis], 3), len(vertices))
            for axis in range(3)
        ],
        axis=1,
    )
    length = np.linalg.norm(at_vertex, axis=1)
    return order, np.clip(at_vertex[:, 2] / np.maximum(length, 1e-20), 0.0, 1.0)


def _draw(axes: Any, head: _Head, view: np.ndarray, values: np.ndarray, limit: float) -> object:
    """Paint the triangles back to front, colored by ``values`` (n,) of the vertices; returns what a
    color bar is made of.
    """
    load_matplotlib()
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import TriMesh
    from matplotlib.colors import Normalize
    from matplotlib.tri import Triangulation

    scale = ScalarMappable(Normalize(0.0, limit), colormaps[COLOR_MAP])
    order, cosine = _facing(head.vertices, head.triangles, view)
    axes.set_xticks([])
    axes.set_yticks([])
    if len(order) and len(head.face):
        points = (head.vertices @ view.T)[:, :2]
        shown = points[head.face][np.isfinite(points[head.face]).all(axis=1)]
        low, high = shown.min(axis=0), shown.max(axis=0)
        middle, half = (low + high) / 2, (0.5 + BORDER) * float((high - low).max())
        axes.set_xlim(middle[0] - half, middle[0] + half)
        axes.set_ylim(middle[1] - half, middle[1] + half)
        corners = points[head.triangles[order]] - middle
        inside = (corners.min(axis=1) < half) & (corners.max(axis=1) > -half)
        order = order[inside.all(axis=1)]
        colors = scale.to_rgba(values)
        colors[:, :3] *= (EDGE_BRIGHTNESS + (1 - EDGE_BRIGHTNESS) * cosine)[:, None]
        places = np.where(np.isfinite(points), points, 0.0)
        if len(order):
            # Its triangles are drawn in their order, with smooth colors, which is several times
            # faster than polygons with edges.
            painted = TriMesh(Triangulation(*places.T, head.triangles[order]), facecolors=colors)
            axes.add_collection(painted, autolim=False)
    return scale

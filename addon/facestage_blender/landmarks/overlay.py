"""Draws landmarks over the 3D View while they are edited: by state in color, the ones that follow,
the face's lines.
"""

from __future__ import annotations

from itertools import pairwise

import bpy
import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.landmarks import Landmarks

from .empties import HIDDEN, IGNORED, VISIBLE, edited_landmarks, landmark_empties, shown_plane
from .plane import on_plane, photo_size, plane_matrix
from .scheme import handles, lines
from .screen_drawing import ScreenDrawing

Color = tuple[float, float, float, float]
COLORS = {
    VISIBLE: (0.25, 1.0, 0.35, 1.0),
    HIDDEN: (1.0, 0.6, 0.1, 1.0),
    IGNORED: (0.75, 0.75, 0.75, 1.0),
}
SELECTED_COLOR = (1.0, 1.0, 1.0, 1.0)
FOLLOWER_COLOR, LINE_COLOR = (0.35, 0.8, 1.0, 0.75), (1.0, 1.0, 1.0, 0.4)
# pixels of the screen at a scale of 1
HANDLE_RADIUS, SELECTED_RADIUS, FOLLOWER_RADIUS = 3.2, 5.2, 1.6
CORNERS = np.exp(2j * np.pi * np.arange(9) / 8).view(np.float64).reshape(-1, 2)


def draw() -> None:
    """Draw the landmarks that are edited into the 3D View being drawn."""
    context = bpy.context
    if not context.space_data.overlay.show_overlays or shown_plane(context.scene) is None:
        return
    if not any(empty.visible_get() for empty in landmark_empties(context.scene)):
        return
    landmarks = current_landmarks(context.scene)
    if landmarks is None:
        return
    seen = on_screen(context.scene, landmarks, np.array(context.region_data.perspective_matrix))
    pixels = (0.5 + 0.5 * seen) * [context.region.width, context.region.height]
    paint("LINES", line_ends(landmarks, pixels), LINE_COLOR)
    for color, triangles in discs_by_color(
        context.scene, landmarks, pixels, context.preferences.system.ui_scale
    ):
        paint("TRIS", triangles, color)


def current_landmarks(scene: bpy.types.Scene) -> Landmarks | None:
    """The landmarks as the empties show them, worked out anew only when one has changed; None when
    they make no set.
    """
    empties = landmark_empties(scene)
    made_of = (
        scene.name,
        scene.facestage.landmark_plane.name,
        *(
            (item.name, item.facestage_landmark.state, *item.matrix_world.col[3])
            for item in empties
        ),
    )
    return OVERLAY.kept(made_of, lambda: _edited(scene))


def _edited(scene: bpy.types.Scene) -> Landmarks | None:
    try:
        return edited_landmarks(scene)
    except InputError:
        return None


def on_screen(scene: bpy.types.Scene, landmarks: Landmarks, view: np.ndarray) -> np.ndarray:
    """(m, 2) where the landmarks are in a view with perspective matrix (4, 4), -1..1; NaN for those
    behind it.
    """
    plane = scene.facestage.landmark_plane
    local = on_plane(landmarks.points, *photo_size(plane))
    points = (
        np.c_[local, np.zeros(len(local)), np.ones(len(local))] @ (view @ plane_matrix(plane)).T
    )
    return points[:, :2] / np.where(points[:, 3:] > 0, points[:, 3:], np.nan)


def line_ends(landmarks: Landmarks, pixels: np.ndarray) -> np.ndarray:
    """(2 s, 2) ends of the segments that draw the face."""
    pairs = [pair for chain in lines(landmarks.scheme) for pair in pairwise(chain)]
    ends = pixels[np.array(pairs, int).reshape(-1, 2)]
    return ends[np.isfinite(ends).all(axis=(1, 2))].reshape(-1, 2)


def discs_by_color(
    scene: bpy.types.Scene, landmarks: Landmarks, pixels: np.ndarray, scale: float
) -> list[tuple[Color, np.ndarray]]:
    """Colors, each with the triangles (3 t, 2) of its discs: what follows first, what can be
    dragged over it.
    """
    indices = [handle.index for handle in handles(landmarks.scheme, len(landmarks.points))]
    followers = np.setdiff1d(np.arange(len(pixels)), indices)
    empties = landmark_empties(scene)
    selected = [item.facestage_landmark.index for item in empties if item.select_get()]
    result = [
        (FOLLOWER_COLOR, discs(pixels[followers], FOLLOWER_RADIUS * scale)),
        (SELECTED_COLOR, discs(pixels[selected], SELECTED_RADIUS * scale)),
    ]
    marks = [item.facestage_landmark for item in empties]
    for state, color in COLORS.items():
        chosen = [mark.index for mark in marks if mark.state == state]
        result.append((color, discs(pixels[chosen], HANDLE_RADIUS * scale)))
    return result


def discs(centres: np.ndarray, radius: float) -> np.ndarray:
    """(3 t, 2) corners of triangles: a disc around each of the ``centres`` (m, 2), NaN for none."""
    centres = centres[np.isfinite(centres).all(axis=1)]
    edge = centres[:, None] + radius * CORNERS
    fan = [np.broadcast_to(centres[:, None], edge[:, 1:].shape), edge[:, :-1], edge[:, 1:]]
    return np.stack(fan, axis=2).reshape(-1, 2)


def paint(kind: str, points: np.ndarray, color: Color, indices: np.ndarray | None = None) -> None:
    """Draw "LINES" or "TRIS" between ``points`` (m, 2), pixels of the region, one after the other
    or as ``indices`` (k, 2 or 3) say.
    """
    import gpu
    from gpu_extras.batch import batch_for_shader

    if not len(points):
        return
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    content = {"pos": np.c_[points, np.zeros(len(points))].astype(np.float32)}
    batch = batch_for_shader(shader, kind, content, indices=indices)
    shader.bind()
    shader.uniform_float("color", color)
    gpu.state.blend_set("ALPHA")
    batch.draw(shader)
    gpu.state.blend_set("NONE")


OVERLAY: ScreenDrawing[Landmarks | None] = ScreenDrawing(draw)

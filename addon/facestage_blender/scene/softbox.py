"""A softbox of its own size in place of the stage's lights: a rectangle in Blender, and for a fit,
whose lights are squares, as many squares as fill it.
"""

from __future__ import annotations

import math

import bpy
import numpy as np
from mathutils import Matrix

from facestage.contract.errors import InputError
from facestage.contract.light_stage import ON, LightStage, horizontal_axis

from . import frames
from .several import home

NAME = "Facestage Softbox"
MARK = "facestage_softbox"  # on the light
SQUARES_MAX = 24  # that stand for one
ALIKE = 0.02  # of the sides of what is taken for a square


def add_softbox(
    empty: bpy.types.Object, towards: np.ndarray, distance: float, size: tuple[float, float]
) -> bpy.types.Object:
    """Put a dark softbox ``towards`` (3,) of the stage frame, ``distance`` metres from the stage's
    middle and turned to it, in place of one that there is; ``size``: width and height in metres.
    """
    remove_softbox(empty)
    data = bpy.data.lights.new(NAME, "AREA")
    data.shape, data.energy = "RECTANGLE", 0.0
    data.size, data.size_y = size
    data.spread, data.cutoff_distance = math.pi, size[0]
    softbox = bpy.data.objects.new(NAME, data)
    softbox[MARK] = True
    home(empty).objects.link(softbox)
    softbox.parent, softbox.matrix_parent_inverse = empty, Matrix()
    softbox.visible_camera = False
    outward = np.asarray(towards, np.float64) / np.linalg.norm(towards)
    matrix = np.eye(4)
    matrix[:3, :3] = frames.light_rotation(-outward, horizontal_axis(outward[None])[0])
    matrix[:3, 3] = frames.points_to_blender(distance * outward)
    softbox.matrix_basis = Matrix(matrix.tolist())
    return softbox


def softbox_of(empty: bpy.types.Object) -> bpy.types.Object | None:
    """The stage's softbox, or None."""
    return next((each for each in empty.children if each.get(MARK)), None)


def remove_softbox(empty: bpy.types.Object) -> None:
    """Take the stage's softbox away, if it has one."""
    softbox = softbox_of(empty)
    if softbox is not None:
        data = softbox.data
        bpy.data.objects.remove(softbox)
        bpy.data.lights.remove(data)


def softbox_sides(softbox: bpy.types.Object) -> tuple[float, float]:
    """Width and height in metres, the object's own scale included. Raises InputError for what is no
    rectangle any more.
    """
    data = softbox.data
    if data.type != "AREA" or data.shape not in {"RECTANGLE", "SQUARE"}:
        raise InputError(
            f"The softbox '{softbox.name}' is no rectangular area light; set its type and shape "
            "back."
        )
    height = data.size if data.shape == "SQUARE" else data.size_y
    return float(data.size) * abs(softbox.scale.x), float(height) * abs(softbox.scale.y)


def shine(softbox: bpy.types.Object, radiance: float) -> None:
    """Let it emit white light of this radiance."""
    width, height = softbox_sides(softbox)
    softbox.data.color = (1.0, 1.0, 1.0)
    softbox.data.energy = radiance * math.pi * width * height


def squares(width: float, height: float) -> tuple[int, int]:
    """Into how many columns and rows of what is nearly a square a rectangle is cut: the fewest."""
    best, off = (1, 1), math.inf
    for columns in range(1, SQUARES_MAX + 1):
        for rows in range(1, SQUARES_MAX // columns + 1):
            ratio = abs(math.log(width / columns / (height / rows)))
            fewer = columns * rows < best[0] * best[1]
            if ratio < off - ALIKE or (ratio < off + ALIKE and fewer):
                best, off = (columns, rows), min(ratio, off)
    return best


def read_softbox(softbox: bpy.types.Object, local: np.ndarray) -> LightStage:
    """The squares that fill the softbox, of which ``local`` (4, 4) is the place relative to the
    stage's empty, as fitted lights in the stage frame; as large together as it is.
    """
    width, height = softbox_sides(softbox)
    columns, rows = squares(width, height)
    x, y, z = (local[:3, axis] / np.linalg.norm(local[:3, axis]) for axis in range(3))
    across = width * ((np.arange(columns) + 0.5) / columns - 0.5)
    up = height * ((np.arange(rows) + 0.5) / rows - 0.5)
    right, above = (each.ravel() for each in np.meshgrid(across, up))
    place = local[:3, 3] + right[:, None] * x + above[:, None] * y
    count, data = columns * rows, softbox.data
    power = data.energy * 2.0 ** getattr(data, "exposure", 0.0)
    radiance = power / (math.pi * width * height) * np.array(data.color, np.float64)

    def each(vector: np.ndarray) -> np.ndarray:
        return np.tile(frames.points_to_stage(vector), (count, 1))

    return LightStage(
        position=frames.points_to_stage(place),
        direction=each(-z),
        axis_x=each(x),
        side=np.full(count, math.sqrt(width * height / count)),
        radiance=np.tile(radiance, (count, 1)),
        state=np.full(count, ON),
    )

"""Hairs as a mesh: thin tapering tubes, each with what its vertices must know of the rig."""

from __future__ import annotations

from collections.abc import Mapping

import bpy
import numpy as np

SECTIONS, SIDES = 6, 3  # of a hair: along it, and round it


def write_hairs(
    mesh: bpy.types.Mesh,
    points: np.ndarray,
    indices: Mapping[str, np.ndarray],
    vectors: Mapping[str, np.ndarray],
) -> None:
    """Fill a mesh with hairs of points (hairs * SECTIONS * SIDES, 3), the quads round each, and
    attributes of their vertices: whole numbers, and vectors (vertices, 3).
    """
    hairs = len(points) // (SECTIONS * SIDES)
    section, side = np.mgrid[: SECTIONS - 1, :SIDES]
    after = (side + 1) % SIDES
    quad = np.stack(
        [
            section * SIDES + side,
            section * SIDES + after,
            (section + 1) * SIDES + after,
            (section + 1) * SIDES + side,
        ],
        axis=-1,
    ).reshape(-1, 4)
    quads = (np.arange(hairs)[:, None, None] * SECTIONS * SIDES + quad).reshape(-1, 4)
    mesh.from_pydata(points.tolist(), [], quads.tolist())
    mesh.update()
    mesh.shade_smooth()
    for name, values in indices.items():
        attribute = mesh.attributes.new(name, "INT", "POINT")
        attribute.data.foreach_set("value", values.astype(np.int32))
    for name, values in vectors.items():
        attribute = mesh.attributes.new(name, "FLOAT_VECTOR", "POINT")
        attribute.data.foreach_set("vector", values.astype(np.float32).ravel())

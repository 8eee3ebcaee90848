"""Turns the 3D View to the photo, close to the face."""

from __future__ import annotations

import math

import bpy
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Vector

from facestage.contract.landmarks import Landmarks

from .plane import on_plane, photo_size, plane_matrix

FACE_SHARE = 0.62  # of the view that the face fills
ZOOM_LIMIT = 600.0  # Blender's own


def look_through_camera(context: bpy.types.Context) -> list[bpy.types.Area]:
    """Show the whole photo in the 3D View in use, else in all of the window's; returns these.

    They lose the dashed lines from each light to the stage's empty, which would cross the face.
    """
    areas = context.window.screen.areas if context.window is not None else []
    views = [area for area in areas if area.type == "VIEW_3D"]
    views = [context.area] if context.area in views else views
    for area in views:
        space = area.spaces.active
        space.overlay.show_relationship_lines = False
        space.region_3d.view_perspective = "CAMERA"
        space.region_3d.view_camera_zoom, space.region_3d.view_camera_offset = 0.0, (0.0, 0.0)
    return views


def look_at_face(context: bpy.types.Context, plane: bpy.types.Object, landmarks: Landmarks) -> None:
    """Show the photo in the 3D View in use, else in all of the window's, the landmarks' face large
    in its middle.
    """
    points = on_plane(landmarks.points[landmarks.counted], *photo_size(plane))
    flat = np.c_[points, np.zeros(len(points)), np.ones(len(points))]
    look_at(context, (flat @ plane_matrix(plane).T)[:, :3])


def look_at(context: bpy.types.Context, points: np.ndarray) -> None:
    """Show the photo, with what is seen of the world's ``points`` (m, 3) large in its middle."""
    for area in look_through_camera(context):
        rv3d = area.spaces.active.region_3d
        region = next((item for item in area.regions if item.type == "WINDOW"), None)
        if bpy.app.background or region is None:
            continue
        rv3d.update()
        seen = [location_3d_to_region_2d(region, rv3d, Vector(point)) for point in points]
        if not seen or any(place is None for place in seen):
            continue
        places = np.array(seen)
        _zoom(region, rv3d, places.min(axis=0), places.max(axis=0))


def _zoom(
    region: bpy.types.Region, rv3d: bpy.types.RegionView3D, low: np.ndarray, high: np.ndarray
) -> None:
    """Bring the box from ``low`` to ``high`` (2,), in the region's pixels at zoom and offset 0, to
    the view's middle.

    Blender's camera view is magnified by (zoom / 50 + sqrt 2)^2 / 2 from there; its offset is in
    regions.
    """
    size = np.array([region.width, region.height], float)
    factor = max(1.0, FACE_SHARE * float((size / np.maximum(high - low, 1.0)).min()))
    rv3d.view_camera_zoom = min(50.0 * (math.sqrt(2.0 * factor) - math.sqrt(2.0)), ZOOM_LIMIT)
    rv3d.view_camera_offset = 0.5 * (low + high) / size - 0.5

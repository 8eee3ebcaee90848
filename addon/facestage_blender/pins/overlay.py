"""Draws the face as a wireframe over the photo, and its pins."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from facestage.contract.camera import Camera
from facestage.contract.errors import InputError
from facestage.contract.face_model import EYES, SKIN

from ..landmarks.overlay import Color, discs, paint
from ..landmarks.screen_drawing import ScreenDrawing
from ..rig.own_marks import slot_parts
from ..scene.camera import camera_pose, read_camera
from .picking import facing
from .record import Record
from .rig_shapes import current_vertices
from .screen import PhotoOnScreen

PIN_COLOR, RING_COLOR = (1.0, 0.45, 0.1, 1.0), (0.0, 0.0, 0.0, 0.8)
OFF_COLOR = (1.0, 0.45, 0.1, 0.9)
WIRE_COLOR = (0.35, 0.85, 1.0)
# How opaque a wire is whose lines are this far apart on the screen, and further; in pixels.
WIRE_ALPHA, WIRE_GAP = 0.55, 9.0
PIN_RADIUS, RING_RADIUS = 4.0, 5.5  # pixels of the screen at a scale of 1


@dataclass(frozen=True)
class Mesh:
    """What of a rig's mesh is drawn: e edges, c corners of t polygons of skin and eyes."""

    edges: np.ndarray  # (e, 2) vertices
    corner_edge: np.ndarray  # (c,)
    corner_polygon: np.ndarray  # (c,)
    triangles: np.ndarray  # (t, 3) the first three vertices of each polygon

    @classmethod
    def of(cls, rig: bpy.types.Object) -> Mesh:
        """Reads the mesh."""
        mesh = rig.data
        corners, count = len(mesh.loops), len(mesh.polygons)
        edges = np.empty(2 * len(mesh.edges), np.int32)
        vertex, edge = np.empty(corners, np.int32), np.empty(corners, np.int32)
        start, slot = np.empty(count, np.int32), np.empty(count, np.int32)
        mesh.edges.foreach_get("vertices", edges)
        mesh.loops.foreach_get("vertex_index", vertex)
        mesh.loops.foreach_get("edge_index", edge)
        mesh.polygons.foreach_get("loop_start", start)
        mesh.polygons.foreach_get("material_index", slot)
        parts = slot_parts(rig)
        wanted = [index for index, part in enumerate(parts) if part in (SKIN, EYES)]
        drawn = np.isin(slot, wanted) if wanted else np.ones(count, bool)
        polygon = np.repeat(np.arange(count), np.diff(np.append(start, corners)))
        kept = drawn[polygon]
        new = np.cumsum(drawn) - 1
        triangles = vertex[start[drawn][:, None] + np.arange(3)]
        return cls(edges.reshape(-1, 2), edge[kept], new[polygon[kept]], triangles)

    def front_edges(self, pixels: np.ndarray) -> np.ndarray:
        """(k, 2) the edges of polygons that face the camera, which sees the vertices at ``pixels``
        (n, 2).
        """
        seen = np.zeros(len(self.edges), bool)
        seen[self.corner_edge[facing(pixels, self.triangles)[self.corner_polygon]]] = True
        return self.edges[seen]


def draw() -> None:
    """Draw into the 3D View being drawn, if it shows the photo and the face is being pinned."""
    context = bpy.context
    scene, view = context.scene, context.region_data
    rig, camera = scene.facestage.rig, scene.camera
    if not scene.facestage.pinning or not context.space_data.overlay.show_overlays:
        return
    if view.view_perspective != "CAMERA" or rig is None or camera is None:
        return
    lens = photo_lens(scene)
    pose = camera_pose(camera)
    screen = PhotoOnScreen.of(
        np.array(view.perspective_matrix), (context.region.width, context.region.height), pose, lens
    )
    points = shown_vertices(rig, context.evaluated_depsgraph_get())
    to_camera = np.linalg.inv(pose) @ np.array(rig.matrix_world)
    pixels = lens.project(points @ to_camera[:3, :3].T + to_camera[:3, 3])
    edges = drawn_mesh(rig).front_edges(pixels)
    on_screen = screen.to_region(pixels)
    paint("LINES", np.nan_to_num(on_screen), wire_color(on_screen, edges), edges)
    try:
        pins = Record.of(scene.facestage, rig).pins
    except InputError:
        return  # the panel says so
    scale = context.preferences.system.ui_scale
    places = screen.to_region(pins.points)
    shown = np.einsum("pi,pix->px", pins.weights, on_screen[pins.corners])
    paint("LINES", np.stack([places, shown], axis=1).reshape(-1, 2), OFF_COLOR)
    paint("TRIS", discs(places, RING_RADIUS * scale), RING_COLOR)
    paint("TRIS", discs(places, PIN_RADIUS * scale), PIN_COLOR)


def photo_lens(scene: bpy.types.Scene) -> Camera:
    """The scene's camera for the photo that is shown behind it."""
    data, render = scene.camera.data, scene.render
    shown = next((each.image for each in data.background_images if each.image is not None), None)
    size = (render.resolution_x, render.resolution_y) if shown is None else tuple(shown.size)
    return read_camera(data, *size)


def shown_vertices(rig: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> np.ndarray:
    """(n, 3) the mesh as Blender shows it; under its sliders alone where a modifier divides it."""
    vertices = rig.evaluated_get(depsgraph).data.vertices
    if len(vertices) != len(rig.data.vertices):
        return current_vertices(rig)
    points = np.empty(3 * len(vertices), np.float32)
    vertices.foreach_get("co", points)
    return points.reshape(-1, 3).astype(np.float64)


def drawn_mesh(rig: bpy.types.Object) -> Mesh:
    """What of the rig's mesh is drawn, read anew only when it is another one."""
    mesh = rig.data
    made_of = (rig.name, mesh.name, len(mesh.vertices), len(mesh.loops), *slot_parts(rig))
    return OVERLAY.kept(made_of, lambda: Mesh.of(rig))


def wire_color(pixels: np.ndarray, edges: np.ndarray) -> Color:
    """The closer its lines, the fainter the wire, so that the photo shows through a fine mesh."""
    lengths = np.linalg.norm(pixels[edges[:, 0]] - pixels[edges[:, 1]], axis=1)
    gap = float(np.median(lengths)) if len(lengths) else WIRE_GAP
    return (*WIRE_COLOR, WIRE_ALPHA * float(np.clip(gap / WIRE_GAP, 0.25, 1.0)))


OVERLAY: ScreenDrawing[Mesh] = ScreenDrawing(draw)

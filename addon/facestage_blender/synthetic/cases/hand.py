"""A hand that leans against the cheek: capsules for fingers, palm and wrist, blended into one
skin.
"""

from __future__ import annotations

import bpy
import numpy as np

from facestage.contract.face_model import FaceModel

from ..truth import Worn, landmark_points
from .mesh import front, joined_parts, sheet, skin_vertices

# Index finger to little finger: length in m from knuckle to tip; radius in m at knuckle and tip.
LENGTHS = (0.072, 0.080, 0.074, 0.058)
RADII = (0.0098, 0.0078)
SPACING, FAN = 0.0185, 9.0  # m between knuckles; degrees between neighboring fingers
PALM, PALM_RADIUS = 0.085, 0.0125  # m from the knuckles to the wrist
WRIST_RADIUS = 0.024
BEND = 0.004  # m that a finger's middle joint stands off the skin
VOXEL, SMOOTHING = 0.0016, 12  # m; steps that round off the joints


def hand(model: FaceModel, vertices: np.ndarray, rng: np.random.Generator) -> Worn:
    """Four fingers on the cheek, the palm below the jaw, a wrist; on a side that is drawn, of the
    face's own skin.
    """
    marks, side = landmark_points(model, vertices), rng.choice([-1.0, 1.0])
    jaw, mouth = (marks[4], marks[48]) if side < 0 else (marks[12], marks[54])
    skin = vertices[skin_vertices(model)].astype(np.float64)
    lean = np.radians(rng.uniform(-8, 8))
    knuckle = np.array([0.75 * jaw[0] + 0.25 * mouth[0], jaw[1] - 0.012]) + 0.004 * rng.uniform(
        -1, 1, 2
    )
    parts, bases = [], []
    for finger, length in enumerate(LENGTHS):
        place = finger - 1.5  # from the index finger, nearest the mouth, outward
        angle = lean + np.radians(FAN) * place * side
        direction = np.array([np.sin(angle), np.cos(angle)])
        base = knuckle + np.array([side * SPACING * place, -0.004 * abs(place)])
        along = np.linspace(0, 1, 12)
        path = base + length * along[:, None] * direction
        radius = RADII[0] + (RADII[1] - RADII[0]) * along
        height = front(skin, path)
        # A finger is stiff: straight between its joints, and nowhere inside the cheek.
        joints = np.array([0.0, 0.45, 0.75, 1.0])
        straight = np.interp(along, joints, np.interp(joints, along, height))
        z = (
            straight
            + max(float((height - straight).max()), 0.0)
            + 0.9 * radius
            + BEND * np.sin(np.pi * along)
        )
        parts.append(_capsules(np.column_stack([path, z]), radius))
        bases.append(np.array([*base, z[0]]))
    wrist = np.mean(bases, axis=0) + np.array([side * 0.02 - PALM * np.sin(lean), -PALM, -0.004])
    for place, base in zip((-1.0, -0.3, 0.3, 1.0), bases, strict=True):
        end = wrist + np.array([side * 0.012 * place, 0.0, 0.0])
        parts.append(
            _capsules(np.linspace(base, end, 9), np.linspace(RADII[0] + 0.002, PALM_RADIUS, 9))
        )
    # The thumb lies along the jaw.
    thumb = np.linspace(
        wrist + np.array([0.0, 0.02, 0.008]), bases[0] + np.array([-side * 0.028, 0.0, 0.002]), 9
    )
    parts.append(_capsules(thumb, np.linspace(0.013, 0.0085, 9)))
    arm = np.linspace(wrist, wrist + np.array([side * 0.05, -0.16, 0.0]), 9)
    parts.append(_capsules(arm, np.linspace(WRIST_RADIUS, 1.4 * WRIST_RADIUS, 9)))
    points, triangles = _blended(*joined_parts(parts))
    return Worn("Hand", points, triangles, (0.5, 0.35, 0.28), roughness=0.45, of_skin=True)


def _capsules(path: np.ndarray, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points and triangles of a round bar along a path (m, 3) of radius (m,), with round ends."""
    ends = np.linspace(0, np.pi / 2, 6)
    along = (path[-1] - path[0]) / np.linalg.norm(path[-1] - path[0])
    cap = np.sin(ends)[:, None] * along
    rings = np.concatenate(
        [path[:1] - radius[0] * cap[::-1], path[1:-1], path[-1:] + radius[-1] * cap]
    )
    size = np.concatenate([radius[0] * np.cos(ends[::-1]), radius[1:-1], radius[-1] * np.cos(ends)])
    first = np.cross(along, np.array([0.31, 0.37, 0.86]))
    first /= np.linalg.norm(first)
    second = np.cross(along, first)
    turn = np.linspace(0, 2 * np.pi, 17)[:, None]
    circle = np.cos(turn) * first + np.sin(turn) * second
    points, triangles = sheet(rings[:, None] + size[:, None, None] * circle[None])
    return points, triangles if _volume(points, triangles) > 0 else triangles[:, ::-1]


def _volume(points: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = np.moveaxis(points[triangles] - points.mean(axis=0), 1, 0)
    return float(np.einsum("ti,ti->t", a, np.cross(b, c)).sum()) / 6.0


def _blended(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One smooth surface around overlapping solids, by Blender's voxel remesher."""
    mesh = bpy.data.meshes.new("Solids")
    mesh.from_pydata(points.tolist(), [], triangles.tolist())
    solid = bpy.data.objects.new("Solids", mesh)
    bpy.context.scene.collection.objects.link(solid)
    try:
        remesh = solid.modifiers.new("Remesh", "REMESH")
        remesh.mode, remesh.voxel_size = "VOXEL", VOXEL
        smooth = solid.modifiers.new("Smooth", "SMOOTH")
        smooth.iterations = SMOOTHING
        evaluated = solid.evaluated_get(bpy.context.evaluated_depsgraph_get())
        result = evaluated.to_mesh()
        found = np.empty(3 * len(result.vertices), np.float32)
        result.vertices.foreach_get("co", found)
        result.calc_loop_triangles()
        corners = np.empty(3 * len(result.loop_triangles), np.int32)
        result.loop_triangles.foreach_get("vertices", corners)
        evaluated.to_mesh_clear()
    finally:
        bpy.data.objects.remove(solid)
        bpy.data.meshes.remove(mesh)
    return found.reshape(-1, 3).astype(float), corners.reshape(-1, 3)

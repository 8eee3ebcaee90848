"""Where a rig has its lids, brows and eyeballs, for what grows on them: objects of their own,
children of the rig, that geometry nodes carry with it.
"""

from __future__ import annotations

import bpy
import numpy as np
from mathutils.bvhtree import BVHTree

from facestage.contract.errors import InputError
from facestage.contract.face_model import PARTS, SKIN, FaceModel

from ..scene.several import link_beside

SCHEME = "mediapipe478"
# Of the rig's mesh.
LIDS_KEY, BROWS_KEY = "facestage_lids", "facestage_brows"
BORDERS_KEY = "facestage_brow_borders"
# Each lid from the outer to the inner corner of the eye.
LIDS = {
    ("right", True): (33, 246, 161, 160, 159, 158, 157, 173, 133),
    ("right", False): (33, 7, 163, 144, 145, 153, 154, 155, 133),
    ("left", True): (263, 466, 388, 387, 386, 385, 384, 398, 362),
    ("left", False): (263, 249, 390, 373, 374, 380, 381, 382, 362),
}
BROWS = (70, 63, 105, 66, 107, 336, 296, 334, 293, 300)
# Of each brow the upper and the lower border, from the inner to the outer end.
BORDERS = (
    (107, 66, 105, 63, 70),
    (55, 65, 52, 53, 46),
    (336, 296, 334, 293, 300),
    (285, 295, 282, 283, 276),
)


def remember_lids(mesh: bpy.types.Mesh, model: FaceModel) -> None:
    """Note on a rig's mesh where its face model has lids and brows; on a model that does not say
    nothing grows.
    """
    table = model.landmarks.get(SCHEME)
    if table is None:
        return
    rows = np.concatenate([table[list(lid)] for lid in LIDS.values()])
    mesh[LIDS_KEY] = np.asarray(rows, np.float64).ravel().tolist()
    mesh[BROWS_KEY] = np.asarray(table[list(BROWS)], np.float64).ravel().tolist()
    mesh[BORDERS_KEY] = np.asarray(table[np.ravel(BORDERS)], np.float64).ravel().tolist()


def has_lids(rig: bpy.types.Object) -> bool:
    """Whether lashes could grow on a rig, and its eyes be wet."""
    return LIDS_KEY in rig.data and {"eye_left", "eye_right"} <= set(rig.vertex_groups.keys())


def require_lids(rig: bpy.types.Object) -> None:
    """Raises InputError for a rig whose lids are not known."""
    if not has_lids(rig):
        raise InputError(
            "Nobody said where this rig's lids are; build the rig of a face model again."
        )


def grown(rig: bpy.types.Object, name: str) -> bpy.types.Object | None:
    """What grew on a rig under a name, or None."""
    return next((each for each in rig.children if each.get(name)), None)


def new_growth(
    rig: bpy.types.Object, name: str, group: bpy.types.NodeTree, material: bpy.types.Material
) -> bpy.types.Object:
    """An object with an empty mesh that the ``group`` of geometry nodes puts on the rig."""
    mesh = bpy.data.meshes.new(name)
    growth = bpy.data.objects.new(name, mesh)
    growth[name] = True
    link_beside(rig, growth)
    growth.parent = rig
    growth.modifiers.new(name, "NODES").node_group = group
    mesh.materials.append(material)
    return growth


def remove_growth(growth: bpy.types.Object | None) -> None:
    """Take away what grew on a rig, and all that only it uses."""
    if growth is None:
        return
    mesh, groups = growth.data, [each.node_group for each in growth.modifiers]
    materials = list(mesh.materials)
    bpy.data.objects.remove(growth)
    bpy.data.meshes.remove(mesh)
    for group in groups:
        if group is not None and not group.users:
            bpy.data.node_groups.remove(group)
    for material in materials:
        if material is not None and not material.users:
            bpy.data.materials.remove(material)


def color_growth(growth: bpy.types.Object, color: tuple[float, float, float]) -> None:
    """Give what grew on a rig a color (linear RGB)."""
    material = growth.data.materials[0]
    surface = next(each for each in material.node_tree.nodes if "Base Color" in each.inputs)
    surface.inputs["Base Color"].default_value = (*color, 1.0)
    # In Solid views, whose gloss makes thin hairs sparkle.
    material.diffuse_color, material.specular_intensity = (*color, 1.0), 0.0


def rest_points(mesh: bpy.types.Mesh) -> np.ndarray:
    """(n, 3) a mesh's vertices without its shape keys' motion, metres."""
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    return points.reshape(-1, 3).astype(np.float64)


def lid_table(mesh: bpy.types.Mesh) -> np.ndarray:
    """(lids, places, 6) of each lid of LIDS three vertices and their weights at each place."""
    return np.array(mesh[LIDS_KEY]).reshape(len(LIDS), -1, 6)


def lid_axes(root: np.ndarray, middle: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(3, 3) away from the eyeball, along the eye, across both: as the nodes have them."""
    away = root - middle
    away /= np.linalg.norm(away)
    across = np.cross(away, corners[1] - corners[0])
    across /= np.linalg.norm(across)
    return np.stack([away, np.cross(across, away), across])


def along_curve(lid: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Points at shares of the way along a lid (k, 3), on a curve through it."""
    before = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(lid, axis=0), axis=1))])
    at = share * before[-1]
    segment = np.clip(np.searchsorted(before, at, side="right") - 1, 0, len(lid) - 2)
    t = ((at - before[segment]) / np.diff(before)[segment])[:, None]
    padded = np.concatenate([[2 * lid[0] - lid[1]], lid, [2 * lid[-1] - lid[-2]]])
    a, b, c, d = (padded[segment + k] for k in range(4))  # Catmull and Rom 1974
    curve: np.ndarray = 0.5 * (
        2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t**2 + (3 * b - a - 3 * c + d) * t**3
    )
    return curve


def triangle_weights(point: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(3,) barycentric weights of a point of a triangle (3, 3)."""
    edges = (corners[:2] - corners[2]).T
    first = np.linalg.lstsq(edges, point - corners[2], rcond=None)[0]
    return np.array([*first, 1 - first.sum()])


def opposite_pair(points: np.ndarray, ball: np.ndarray) -> tuple[int, int]:
    """Two opposite vertices of an eyeball, whose middle is its own."""
    own = points[ball]
    behind = own[own[:, 1] > 0.5 * (own[:, 1].min() + own[:, 1].max())]  # no cornea bulges there
    given = np.column_stack([2 * behind, np.ones(len(behind))])
    middle = np.linalg.lstsq(given, (behind**2).sum(axis=1), rcond=None)[0][:3]
    from_middle = own - middle
    square = (from_middle**2).sum(axis=1)
    off = square[:, None] + square[None] + 2 * from_middle @ from_middle.T
    first, other = np.unravel_index(off.argmin(), off.shape)
    return int(ball[first]), int(ball[other])


def group_members(rig: bpy.types.Object, group: str) -> np.ndarray:
    """The vertices of a vertex group."""
    index = rig.vertex_groups[group].index
    found = [v.index for v in rig.data.vertices if any(each.group == index for each in v.groups)]
    return np.array(found)


def part_tree(
    mesh: bpy.types.Mesh, points: np.ndarray, part: int = SKIN
) -> tuple[BVHTree, np.ndarray]:
    """What finds the nearest point of a part of the face, and its triangles' vertices."""
    mesh.calc_loop_triangles()
    count = len(mesh.loop_triangles)
    corners, material = np.empty(3 * count, np.int32), np.empty(count, np.int32)
    mesh.loop_triangles.foreach_get("vertices", corners)
    mesh.loop_triangles.foreach_get("material_index", material)
    triangles = corners.reshape(-1, 3)[np.isin(material, part_slots(mesh, part))]
    return BVHTree.FromPolygons(points.tolist(), triangles.tolist()), triangles


def part_slots(mesh: bpy.types.Mesh, part: int) -> list[int]:
    """The material slots of a part of the face."""
    names = ["" if each is None else each.name for each in mesh.materials]
    wanted = f"Facestage {PARTS[part].capitalize()}"
    return [index for index, name in enumerate(names) if name.startswith(wanted)]

"""How sure the fit is of each vertex, on the rig's mesh: in mm, and in the report's colors."""

from __future__ import annotations

import bpy
import numpy as np

from facestage.contract import certainty
from facestage.contract.face_model import FaceModel
from facestage.contract.files.color import srgb_to_linear

from ..scene.color_views import hide_colors, is_shown, show_colors, take_marks_off

DEVIATION = "facestage_deviation_mm"
CERTAINTY = "Facestage Certainty"
REGION = "facestage_narrow_face"  # on a mesh of the user's: numbers of the vertices


def remember_region(mesh: bpy.types.Mesh, model: FaceModel) -> None:
    """Keep on a mesh of the user's which vertices the scale of colors goes by."""
    numbers = _region(model.regions.get(certainty.FACE)).tolist()
    if numbers:
        mesh[REGION] = numbers
    elif REGION in mesh:
        del mesh[REGION]


def write_certainty(rig: bpy.types.Object, deviation: np.ndarray | None) -> None:
    """Write the standard deviations (n, 3) in mm of a result's vertices onto the mesh, or take
    those of an older one away. What is shown stays shown, and no other color attribute changes.
    """
    mesh = rig.data
    shown = is_shown(mesh)
    remove_certainty(mesh)
    if deviation is None or len(deviation) != len(mesh.vertices):
        return
    names = mesh.attributes.active_color_name, mesh.attributes.default_color_name
    total = np.linalg.norm(certainty.finite_mm(deviation), axis=1)
    face = _face_of(rig)
    end = certainty.scale_end(total, face if len(face) else np.arange(len(total)))
    colors = np.ones((len(total), 4), np.float32)
    colors[:, :3] = srgb_to_linear(certainty.colors(total / end))
    plain = mesh.attributes.new(DEVIATION, "FLOAT", "POINT")
    plain.data.foreach_set("value", total.astype(np.float32))
    colored = mesh.attributes.new(CERTAINTY, "FLOAT_COLOR", "POINT")
    colored.data.foreach_set("color", colors.ravel())
    # The first color attribute of a mesh becomes the one that is drawn, rendered and exported.
    mesh.attributes.active_color_name, mesh.attributes.default_color_name = names
    if shown:
        show_certainty(mesh, True)


def has_certainty(mesh: bpy.types.Mesh) -> bool:
    """Whether there is something to show."""
    return CERTAINTY in mesh.attributes


def shows_certainty(mesh: bpy.types.Mesh) -> bool:
    """Whether the 3D views show it."""
    return has_certainty(mesh) and is_shown(mesh)


def show_certainty(mesh: bpy.types.Mesh, on: bool) -> None:
    """Let the 3D views show it, or what they showed before."""
    if on:
        show_colors(mesh, CERTAINTY)
    else:
        hide_colors(mesh, CERTAINTY)


def remove_certainty(mesh: bpy.types.Mesh) -> None:
    """Take it off a mesh, and out of the views."""
    hide_colors(mesh, CERTAINTY)
    names = mesh.attributes.active_color_name, mesh.attributes.default_color_name
    for name in (DEVIATION, CERTAINTY):
        attribute = mesh.attributes.get(name)
        if attribute is not None:
            mesh.attributes.remove(attribute)
    left = [name if name in mesh.attributes else "" for name in names]
    mesh.attributes.active_color_name, mesh.attributes.default_color_name = left


def leave_out(mesh: bpy.types.Mesh) -> None:
    """Take it, and all that is said of views, off a copy of a mesh that is exported."""
    take_marks_off(mesh, CERTAINTY)
    remove_certainty(mesh)


def _face_of(rig: bpy.types.Object) -> np.ndarray:
    """Numbers of the narrow face's vertices; none where the mesh does not say."""
    group = rig.vertex_groups.get(certainty.FACE)
    if rig.facestage_face.own_mesh:
        numbers = _region(rig.data.get(REGION))
    elif group is not None:
        numbers = _region(
            [
                vertex.index
                for vertex in rig.data.vertices
                if any(each.group == group.index for each in vertex.groups)
            ]
        )
    else:
        numbers = _region(None)
    return numbers[numbers < len(rig.data.vertices)]


def _region(numbers: object) -> np.ndarray:
    return np.array([] if numbers is None else numbers, np.int64)

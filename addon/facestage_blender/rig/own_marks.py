"""What a user's mesh says of its face: the landmarks marked on it, the parts its materials name."""

from __future__ import annotations

import re

import bpy
import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.face_model import EYES, MOUTH, OTHER, PARTS, SKIN, TEETH
from facestage.contract.rig_file import MARKS, UNKNOWN_PART

MARK_GROUP = "facestage/"

# Shells before the eyes that nobody should see as they are.
_VEILS = r"lash|tear|lacrimal|fluid|cornea|occlusion|eye_?blend|wet"
# What a material's name says; the first that fits counts.
_PART_WORDS = (
    (OTHER, rf"{_VEILS}|brow|hair|beard|cloth|shirt|glass|transparent|\bother\b"),
    (EYES, r"eye(?!lid)|iris|sclera|pupil"),
    (TEETH, r"teeth|tooth|denture"),
    (MOUTH, r"mouth|gum|tongue|saliva"),
    (SKIN, r"skin|face|head|body"),
)


def read_marks(item: bpy.types.Object) -> dict[str, np.ndarray]:
    """Marked landmarks: name in MARKS -> vertex indices.

    They are vertex groups, so that they survive editing.
    """
    group_name = {
        group.index: group.name[len(MARK_GROUP) :]
        for group in item.vertex_groups
        if group.name.startswith(MARK_GROUP)
    }
    found: dict[str, list[int]] = {}
    if group_name:
        for vertex in item.data.vertices:
            for member in vertex.groups:
                if member.group in group_name and member.weight > 0:
                    found.setdefault(group_name[member.group], []).append(vertex.index)
    return {name: np.array(indices, np.int32) for name, indices in found.items() if name in MARKS}


def mark(item: bpy.types.Object, name: str, vertex: int | None = None) -> int:
    """Make the selected vertices, or the one that is given, a landmark's place; returns how many.

    Raises InputError when none is selected, or there is no such vertex.
    """
    if vertex is not None and vertex >= len(item.data.vertices):
        raise InputError(
            f"'{item.name}' has no vertex {vertex}; it has {len(item.data.vertices)}, from 0 on."
        )
    chosen = [each.index for each in item.data.vertices if each.select]
    if vertex is not None:
        chosen = [vertex]
    if not chosen:
        raise InputError(
            f"No vertex of '{item.name}' is selected; select the vertex of the landmark in "
            "Edit Mode."
        )
    clear_mark(item, name)
    item.vertex_groups.new(name=MARK_GROUP + name).add(chosen, 1.0, "REPLACE")
    return len(chosen)


def clear_mark(item: bpy.types.Object, name: str) -> None:
    """Forget a landmark's place."""
    group = item.vertex_groups.get(MARK_GROUP + name)
    if group is not None:
        item.vertex_groups.remove(group)


def guessed_part(name: str) -> int:
    """The part of the face that a material's name speaks of, or UNKNOWN_PART."""
    for part, words in _PART_WORDS:
        if re.search(words, name, re.IGNORECASE):
            return part
    return UNKNOWN_PART


def veils_eyes(material: bpy.types.Material) -> bool:
    """Whether a material is that of a shell before the eyes (tear film, lashes, what shades them),
    by its name, and would hide them: it is opaque, as those of a mesh whose own materials got lost
    on the way into Blender are.
    """
    if re.search(_VEILS, material.name, re.IGNORECASE) is None:
        return False
    nodes = () if material.node_tree is None else material.node_tree.nodes
    for node in nodes:
        if node.type in ("BSDF_TRANSPARENT", "BSDF_REFRACTION", "BSDF_GLASS", "TEX_IMAGE"):
            return False
        for name in ("Alpha", "Transmission Weight"):
            socket = node.inputs.get(name) if node.type == "BSDF_PRINCIPLED" else None
            opaque = float(name == "Alpha")
            if socket is not None and (socket.is_linked or socket.default_value != opaque):
                return False
    return True


def slot_parts(item: bpy.types.Object) -> list[int]:
    """The part of the face in each material slot: as the user marked the material, else by its
    name.
    """
    parts = []
    for slot in item.material_slots:
        material = slot.material
        marked = material.facestage_part if material is not None else "AUTO"
        if marked != "AUTO":
            parts.append(PARTS.index(marked.lower()))
        else:
            parts.append(guessed_part(material.name) if material is not None else UNKNOWN_PART)
    return parts

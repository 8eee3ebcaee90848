"""Relief: what a fitted face has beyond the sliders of its face model, as one shape key."""

from __future__ import annotations

import bpy
import numpy as np

from facestage.contract.errors import InputError

NAME = "Facestage Relief"


def check_relief(rig: bpy.types.Object, relief: np.ndarray) -> None:
    """Raise InputError unless ``relief`` (n, 3) is of as many vertices as the rig has."""
    if len(relief) != len(rig.data.vertices):
        raise InputError(
            f"The result's relief has {len(relief)} vertices, the face rig '{rig.name}' "
            f"{len(rig.data.vertices)}; build the rig of the same face model."
        )


def write_relief(rig: bpy.types.Object, relief: np.ndarray | None) -> None:
    """Show ``relief`` (n, 3), in the mesh's own coordinates; None: take away an earlier one."""
    keys = rig.data.shape_keys
    key = None if keys is None else keys.key_blocks.get(NAME)
    if relief is None:
        if key is not None:
            rig.shape_key_remove(key)
        return
    if key is None:
        if keys is None:
            rig.shape_key_add(name="Basis", from_mix=False)
        key = rig.shape_key_add(name=NAME, from_mix=False)
    reference = rig.data.shape_keys.reference_key
    key.relative_key, key.mute, key.vertex_group = reference, False, ""
    key.slider_min, key.slider_max, key.value = 0.0, 1.0, 1.0
    points = np.empty(3 * len(relief), np.float32)
    reference.data.foreach_get("co", points)
    key.data.foreach_set("co", points + relief.astype(np.float32).ravel())
    rig.data.update()


def shown_relief(rig: bpy.types.Object) -> float:
    """How much of it the slider shows; 0 where there is none."""
    keys = rig.data.shape_keys
    key = None if keys is None else keys.key_blocks.get(NAME)
    return 0.0 if key is None or key.mute else float(key.value)

"""Leaves the user where they were: mode, active object and selection."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy


@contextmanager
def preserved(layer: bpy.types.ViewLayer) -> Iterator[None]:
    """Run the block in object mode, then restore the layer's mode, active object and selection."""
    active = layer.objects.active
    mode = active.mode if active is not None else "OBJECT"
    selected = [item for item in layer.objects if item.select_get(view_layer=layer)]
    if mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    try:
        yield
    finally:
        present = set(layer.objects)
        for item in present:
            item.select_set(item in selected, view_layer=layer)
        if active is None or active in present:
            layer.objects.active = active
            if active is not None and mode != "OBJECT":
                bpy.ops.object.mode_set(mode=mode)

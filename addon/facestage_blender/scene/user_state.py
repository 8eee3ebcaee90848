"""Leaves the user where they were: mode, active object and selection."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy


@contextmanager
def preserved(layer: bpy.types.ViewLayer) -> Iterator[None]:
    """Run the block in object mode, then restore the layer's mode, active object and selection.

    By name, because the block may remove an object, or make it anew.
    """
    active = layer.objects.active
    mode = active.mode if active is not None else "OBJECT"
    active_name = active.name if active is not None else ""
    selected = {item.name for item in layer.objects if item.select_get(view_layer=layer)}
    if mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    try:
        yield
    finally:
        layer.update()  # until then it lists objects that are gone
        for item in layer.objects:
            item.select_set(item.name in selected, view_layer=layer)
        layer.objects.active = layer.objects.get(active_name)
        if layer.objects.active is not None and mode != "OBJECT":
            bpy.ops.object.mode_set(mode=mode)

"""What is drawn over every 3D View: begun and ended with the add-on, made anew when it changes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar

import bpy

Made = TypeVar("Made")


class ScreenDrawing(Generic[Made]):
    """Blender's handle of a drawing, and what it draws with what that was made of last."""

    def __init__(self, draw: Callable[[], None]) -> None:
        """``draw`` paints into the 3D View that Blender draws just then, in pixels."""
        self._draw = draw
        self._handle: Any = None
        self._made: tuple[object, Made] | None = None

    def register(self) -> None:
        """Draw in every 3D View from now on."""
        if not bpy.app.background:
            self._handle = bpy.types.SpaceView3D.draw_handler_add(
                self._draw, (), "WINDOW", "POST_PIXEL"
            )

    def unregister(self) -> None:
        """Undo :meth:`register`."""
        if self._handle is not None:
            bpy.types.SpaceView3D.draw_handler_remove(self._handle, "WINDOW")
        self._handle = self._made = None

    def kept(self, made_of: object, make: Callable[[], Made]) -> Made:
        """What ``make`` made of the same last time, or makes now."""
        if self._made is None or self._made[0] != made_of:
            self._made = (made_of, make())
        return self._made[1]

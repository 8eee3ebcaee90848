"""Operators that act at once: one function of another room, and what they report of it."""

from collections.abc import Callable
from contextlib import nullcontext
from typing import ClassVar

import bpy

from facestage.contract.errors import FacestageError

from ..scene.user_state import preserved
from ..translations import said


class Action:
    """Mixin of operators that act at once; a user's error becomes the operator's report.

    One that changes the scene (as ``UNDO`` among its options says) leaves the user's mode, active
    object and selection as they were.
    """

    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}
    report: Callable[[set[str], str], None]  # Blender's operators have it

    def act(self, context: bpy.types.Context) -> None:
        """Do it. Raises FacestageError when something is missing or wrong."""
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Do it, and report a user's error."""
        changes = "UNDO" in type(self).bl_options
        try:
            with preserved(context.view_layer) if changes else nullcontext():
                self.act(context)
        except FacestageError as error:
            self.report({"ERROR"}, said(str(error)))
            return {"CANCELLED"}
        return {"FINISHED"}

"""Operators that act at once: one function of another room, and what they report of it."""

import time
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from typing import ClassVar

import bpy
from bpy.props import EnumProperty

from facestage.contract.errors import FacestageError

from ..scene.user_state import preserved
from ..translations import said

STEP_SECONDS = 0.01  # between steps
BUSY_SECONDS = 0.01  # of steps without a drawing between them, and what the last one takes longer


def go_on(work: Iterator[None], seconds: float) -> bool:
    """Do one step of ``work``, and more until ``seconds`` have passed. Whether it is done."""
    end = time.monotonic() + seconds
    return all(time.monotonic() < end for _ in work)


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


class Toggle(Action):
    """Mixin of actions that turn something on, or off where it is on; scripts say which."""

    state: EnumProperty(
        name="State",
        description="What it is to be",
        items=[
            ("TOGGLE", "Toggle", "The other state"),
            ("ON", "On", "On, whatever it is now"),
            ("OFF", "Off", "Off, whatever it is now"),
        ],
        default="TOGGLE",
        options={"SKIP_SAVE"},
    )

    def is_on(self, context: bpy.types.Context) -> bool:
        """Whether it is on now. Raises FacestageError as :meth:`act` does."""
        raise NotImplementedError

    def turn(self, context: bpy.types.Context, on: bool) -> None:
        """Turn it on or off, which it is not. Raises FacestageError as :meth:`act` does."""
        raise NotImplementedError

    def act(self, context: bpy.types.Context) -> None:
        """Change the state where another one is wanted."""
        is_on = self.is_on(context)
        wanted = not is_on if self.state == "TOGGLE" else self.state == "ON"
        if wanted != is_on:
            self.turn(context, wanted)


class SteppedAction(Action):
    """Mixin of actions that hold the window for long: from the interface they are done in steps,
    between which Blender draws but takes no input; from scripts at once.
    """

    busy_seconds = BUSY_SECONDS
    _work: Iterator[None] | None = None
    _timer: bpy.types.Timer | None = None

    def steps(self, context: bpy.types.Context) -> Iterator[None]:
        """Do it, yielding between steps. Raises FacestageError as :meth:`act` does."""
        raise NotImplementedError

    def act(self, context: bpy.types.Context) -> None:
        """Do all of it."""
        for _ in self.steps(context):
            pass

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Begin."""
        self._work = self.steps(context)
        manager = context.window_manager
        self._timer = manager.event_timer_add(STEP_SECONDS, window=context.window)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Do some steps."""
        if event.type != "TIMER" or self._work is None:
            return {"RUNNING_MODAL"}
        try:
            with preserved(context.view_layer):
                if not go_on(self._work, self.busy_seconds):
                    return {"RUNNING_MODAL"}
        except FacestageError as error:
            self.report({"ERROR"}, said(str(error)))
            self.cancel(context)
            return {"CANCELLED"}
        self.cancel(context)
        return {"FINISHED"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Leave off: it is done, or Blender closes the window."""
        self._work = None
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = None

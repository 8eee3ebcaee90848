"""Operators that run the backend: started, watched from a timer, cancelled; never blocking."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import ClassVar

import bpy

from facestage.contract.errors import FacestageError, InputError
from facestage.contract.events import Event
from facestage.contract.face_model import FaceModel

from ..backend.commands import doctor_command, model_command
from ..backend.process import CANCELLED, BackendProcess, Outcome
from ..preferences import CHECKING, addon_preferences, backend_command, online_access
from ..scene.user_state import preserved
from ..translations import said
from .action import BUSY_SECONDS, STEP_SECONDS, go_on

POLL_SECONDS = 0.1
GOING_ON, FINISHED = {"RUNNING_MODAL"}, {"FINISHED"}


class Running:
    """The one backend process of this Blender, so that it can be stopped when the add-on goes
    away.
    """

    process: ClassVar[BackendProcess | None] = None


def stop_running() -> None:
    """Stop the backend if it runs, and let the next one start."""
    if Running.process is not None:
        Running.process.cancel()
        Running.process = None
    for manager in bpy.data.window_managers:
        manager.facestage.task = ""


@bpy.app.handlers.persistent
def _on_load(*_arguments: object) -> None:
    """Another file takes the place of the one that the backend works for, and was asked about."""
    stop_running()
    for manager in bpy.data.window_managers:
        state = manager.facestage
        state.verdict = state.failure = state.notice = ""


def register() -> None:
    """Stop the backend when another file is opened."""
    bpy.app.handlers.load_pre.append(_on_load)


def unregister() -> None:
    """Undo :func:`register`; a fit still running is stopped."""
    bpy.app.handlers.load_pre.remove(_on_load)
    stop_running()


class BackendTask:
    """Mixin of operators that start the backend, watch it from a timer, and act when it is done.

    Called from a script (``execute``) the operator waits; from the interface (``invoke``) it does
    not, and lives in a window that stays.
    """

    task = ""
    busy_seconds = BUSY_SECONDS
    resumable = False  # whether a run that was stopped can go on
    report: Callable[[set[str], str], None]  # Blender's operators have it
    _timer: bpy.types.Timer | None = None
    _process: BackendProcess | None = None
    _work: Iterator[None] | None = None  # what follows, once the backend is done
    _scene = ""  # that it was started in: the window may show another one when it is done

    def command(self, context: bpy.types.Context) -> list[str]:
        """The command line to run. Raises FacestageError when something is missing."""
        raise NotImplementedError

    def finish(self, context: bpy.types.Context, process: BackendProcess) -> None:
        """Use what the backend wrote. Raises FacestageError when that is not usable."""

    def following(self, _context: bpy.types.Context) -> Iterator[None]:
        """What is done after :meth:`finish`, in steps: in the window Blender draws between them and
        takes no input. Raises FacestageError as that does.
        """
        yield from ()

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """One backend at a time."""
        cls.poll_message_set(  # type: ignore[attr-defined]
            "Facestage works at something already; cancel it, or wait until it is done"
        )
        return not context.window_manager.facestage.task

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Run the backend and wait for it."""
        if not self._start(context):
            return {"CANCELLED"}
        process = Running.process
        assert process is not None  # _start has just made it
        outcome = process.wait(lambda event: show_event(context.window_manager, event))
        verdict = self._begin_following(context, self._end(context, process, outcome))
        while verdict == GOING_ON:
            verdict = self._step(context)
        return verdict

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Run the backend in the background of the user interface."""
        if not self._start(context):
            return {"CANCELLED"}
        manager, window = context.window_manager, lasting_window(context.window)
        self._process = Running.process
        self._timer = manager.event_timer_add(POLL_SECONDS, window=window)
        with context.temp_override(window=window):
            manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Stop the backend: Blender closes the window that the operator lives in."""
        if Running.process is self._process:  # not one that was started since
            stop_running()
        self._stop(context, {"CANCELLED"})

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Take over the backend's events."""
        manager, process = context.window_manager, self._process
        if self._work is not None:
            return self._step(context) if event.type == "TIMER" else GOING_ON
        if process is None or process is not Running.process:  # the add-on is being disabled
            return self._stop(context, {"CANCELLED"})
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        if manager.facestage.cancel:
            process.cancel()
        outcome = process.outcome()
        for message in process.poll():
            show_event(manager, message)
        redraw(manager)
        if outcome is None:
            return {"PASS_THROUGH"}
        verdict = self._stop(context, self._end(context, process, outcome))
        if verdict == FINISHED:
            self._timer = manager.event_timer_add(STEP_SECONDS, window=context.window)
        return self._begin_following(context, verdict)

    def _start(self, context: bpy.types.Context) -> bool:
        state = context.window_manager.facestage
        state.failure = state.notice = ""
        state.began, self._scene = self.task, context.scene.name
        try:
            Running.process = BackendProcess(self.command(context), online_access())
        except FacestageError as error:
            self._fail(context, str(error))
            return False
        state.task, state.stage, state.cancel = self.task, "Starting", False
        state.fraction, state.photo_error, state.seconds_left = 0.0, -1.0, -1.0
        return True

    def _end(
        self, context: bpy.types.Context, process: BackendProcess, outcome: Outcome
    ) -> set[str]:
        Running.process = None
        context.window_manager.facestage.task = ""
        if outcome.code == CANCELLED:  # as the user asked: no error
            notice = outcome.message if self.resumable else "Cancelled."
            context.window_manager.facestage.notice = notice
            self.report({"INFO"}, said(notice))
            return {"CANCELLED"}
        if not outcome.ok:
            self._fail(context, outcome.message)
            return {"CANCELLED"}
        try:
            with self._there(context), preserved(context.view_layer):
                self.finish(context, process)
        except FacestageError as error:
            self._fail(context, str(error))
            return {"CANCELLED"}
        return FINISHED

    def _begin_following(self, context: bpy.types.Context, verdict: set[str]) -> set[str]:
        if verdict != FINISHED:
            return verdict
        self._work = self.following(context)
        return self._step(context)

    def _step(self, context: bpy.types.Context) -> set[str]:
        """Some steps of what follows."""
        assert self._work is not None  # _begin_following has made it
        try:
            with self._there(context), preserved(context.view_layer):
                if not go_on(self._work, self.busy_seconds):
                    return GOING_ON
        except FacestageError as error:
            self._fail(context, str(error))
            return self._stop(context, {"CANCELLED"})
        return self._stop(context, FINISHED)

    @contextmanager
    def _there(self, context: bpy.types.Context) -> Iterator[None]:
        """Work in the scene that the task was started in. Raises InputError where it is gone."""
        scene, window = bpy.data.scenes.get(self._scene), context.window
        if scene is None:
            raise InputError(f"The scene '{self._scene}', which this was for, is gone.")
        shown = context.scene
        if shown == scene or window is None:
            yield
            return
        window.scene = scene
        try:
            yield
        finally:
            window.scene = shown

    def _stop(self, context: bpy.types.Context, verdict: set[str]) -> set[str]:
        self._work = None
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = None
        redraw(context.window_manager, everything=True)
        return verdict

    def _fail(self, context: bpy.types.Context, sentence: str) -> None:
        context.window_manager.facestage.failure = sentence
        self.report({"ERROR"}, said(sentence))


class ModelTask(BackendTask):
    """Mixin of tasks for which the backend exports a face model."""

    def specification(self, context: bpy.types.Context) -> str:
        """What the backend calls the model. Raises FacestageError when something is missing."""
        raise NotImplementedError

    def use(self, context: bpy.types.Context, model: FaceModel) -> Iterator[None]:
        """Use the model, yielding between steps. Raises FacestageError when it cannot be."""
        raise NotImplementedError

    def command(self, context: bpy.types.Context) -> list[str]:
        """Ask the backend for the model as one file."""
        backend = backend_command(context)
        return model_command(backend, self.specification(context), self._file())

    def following(self, context: bpy.types.Context) -> Iterator[None]:
        """Load the file, remove it, and use the model: loading holds the window, too."""
        model = FaceModel.load(self._file())
        self._file().unlink()
        yield
        yield from self.use(context, model)

    @staticmethod
    def _file() -> Path:
        return Path(bpy.app.tempdir) / "facestage_model.npz"


class FACESTAGE_OT_cancel(bpy.types.Operator):
    """Stop the backend; its last checkpoint is kept"""

    bl_idname = "facestage.cancel"
    bl_label = "Cancel"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only while something runs."""
        cls.poll_message_set("Nothing runs")
        return bool(context.window_manager.facestage.task)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Ask the running task to stop."""
        context.window_manager.facestage.cancel = True
        return {"FINISHED"}


class FACESTAGE_OT_check_backend(BackendTask, bpy.types.Operator):
    """Ask the backend what works on this machine"""

    bl_idname = "facestage.check_backend"
    bl_label = "Check Backend"

    task = CHECKING

    def command(self, context: bpy.types.Context) -> list[str]:
        """Run the backend's own check."""
        return doctor_command(backend_command(context))

    def _end(
        self, context: bpy.types.Context, process: BackendProcess, outcome: Outcome
    ) -> set[str]:
        preferences = addon_preferences(context)
        if preferences is not None:
            preferences.report = process.output or outcome.message
        return super()._end(context, process, outcome)


def show_event(manager: bpy.types.WindowManager, event: Event) -> None:
    """Copy an event of the backend to where the panel looks."""
    state = manager.facestage
    state.stage, state.fraction = event.stage or state.stage, event.fraction or state.fraction
    state.photo_error = -1.0 if event.error is None else event.error
    state.seconds_left = -1.0 if event.seconds_left is None else event.seconds_left


def lasting_window(window: bpy.types.Window) -> bpy.types.Window:
    """The window that ``window`` (the preferences, say) was opened from, which shows the same
    scene.
    """
    return window if window.parent is None else lasting_window(window.parent)


def redraw(manager: bpy.types.WindowManager, everything: bool = False) -> None:
    """Have the sidebars and the preferences drawn again, which show the progress; the views only
    with ``everything``.

    Drawing a view ten times a second takes from the backend what it computes with.
    """
    for window in manager.windows:
        for area in window.screen.areas:
            for region in area.regions if area.type in {"VIEW_3D", "PREFERENCES"} else ():
                if everything or area.type == "PREFERENCES" or region.type == "UI":
                    region.tag_redraw()


CLASSES = (FACESTAGE_OT_cancel, FACESTAGE_OT_check_backend)

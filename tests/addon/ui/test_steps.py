"""What holds the window for long is done in steps from the interface, and at once from scripts."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from facestage.contract.errors import InputError

TIMER, MOUSE = SimpleNamespace(type="TIMER"), SimpleNamespace(type="LEFTMOUSE")


class Manager:
    """Blender's window manager, as far as modal operators ask it."""

    def __init__(self) -> None:
        import bpy

        self.windows: list[Any] = []
        self.timers = 0
        self.facestage = bpy.context.window_manager.facestage

    def event_timer_add(self, _seconds: float, window: Any) -> int:
        self.timers += 1
        return self.timers

    def event_timer_remove(self, _timer: int) -> None:
        self.timers -= 1

    def modal_handler_add(self, _operator: Any) -> None:
        pass


def in_a_window() -> Any:
    import bpy

    return SimpleNamespace(
        window_manager=Manager(),
        window=None,
        scene=bpy.context.scene,
        view_layer=bpy.context.view_layer,
    )


def action(count: int, fails: bool = False) -> Any:
    from facestage_blender.ui.action import SteppedAction

    class Work(SteppedAction):
        done, words, busy_seconds = 0, "", 0.0

        def steps(self, _context: Any) -> Iterator[None]:
            for _ in range(count):
                self.done += 1
                yield
            if fails:
                raise InputError("It is gone.")

        def report(self, _kind: set[str], words: str) -> None:
            self.words = words

    return Work()


def test_an_action_does_a_step_at_each_tick_and_takes_no_input(scene) -> None:
    context, work = in_a_window(), action(2)
    assert work.invoke(context, None) == {"RUNNING_MODAL"} and work.done == 0
    assert work.modal(context, MOUSE) == {"RUNNING_MODAL"} and work.done == 0
    for done in (1, 2):
        assert work.modal(context, TIMER) == {"RUNNING_MODAL"} and work.done == done
    assert work.modal(context, TIMER) == {"FINISHED"}
    assert context.window_manager.timers == 0
    assert work.execute(context) == {"FINISHED"} and work.done == 4


@pytest.mark.parametrize("at_once", [True, False])
def test_an_error_in_a_step_is_reported(scene, at_once: bool) -> None:
    context, work = in_a_window(), action(1, fails=True)
    if at_once:
        assert work.execute(context) == {"CANCELLED"}
    else:
        work.invoke(context, None)
        work.modal(context, TIMER)
        assert work.modal(context, TIMER) == {"CANCELLED"}
    assert work.words == "It is gone." and context.window_manager.timers == 0


def test_short_steps_are_done_without_a_drawing_between_them() -> None:
    from facestage_blender.ui.action import go_on

    work = iter([None] * 5)
    assert not go_on(work, 0.0) and not go_on(work, 0.0)
    assert go_on(work, 3600.0) and not list(work)


def task(fails: bool = False) -> Any:
    from facestage_blender.backend.process import Outcome
    from facestage_blender.ui.backend_task import BackendTask, Running

    class Fitting(BackendTask):
        done, words, busy_seconds = 0, "", 0.0

        def finish(self, _context: Any, _process: Any) -> None:
            self.done = 1

        def following(self, _context: Any) -> Iterator[None]:
            self.done += 1
            yield
            if fails:
                raise InputError("It is gone.")
            self.done += 1

        def report(self, _kind: set[str], words: str) -> None:
            self.words = words

    made: Any = Fitting()
    ended = SimpleNamespace(outcome=lambda: Outcome(0, ""), poll=lambda: ())
    Running.process = made._process = ended  # type: ignore[assignment]
    made._scene, made._timer = "Scene", 1
    return made


@pytest.mark.parametrize("fails", [False, True])
def test_what_follows_a_task_is_done_in_steps(scene, fails: bool) -> None:
    context, work = in_a_window(), task(fails)
    context.window_manager.timers = 1
    assert work.modal(context, MOUSE) == {"PASS_THROUGH"} and work.done == 0
    assert work.modal(context, TIMER) == {"RUNNING_MODAL"} and work.done == 2
    assert work.modal(context, MOUSE) == {"RUNNING_MODAL"} and work.done == 2
    assert work.modal(context, TIMER) == ({"CANCELLED"} if fails else {"FINISHED"})
    assert work.done == (2 if fails else 3) and work.words == ("It is gone." if fails else "")
    assert context.window_manager.timers == 0


def test_a_rig_is_loaded_painted_and_built_in_steps_of_their_own(
    scene, head_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from facestage_blender.backend.process import Outcome
    from facestage_blender.pictures.texture import paint_vertices
    from facestage_blender.ui.backend_task import ModelTask, Running
    from facestage_blender.ui.face import FACESTAGE_OT_build_rig

    exported = tmp_path / "model.npz"
    shutil.copyfile(head_file, exported)
    painted: list[int] = []

    def watched(*arguments: Any) -> Any:
        painted.append(1)
        return paint_vertices(*arguments)

    monkeypatch.setattr("facestage_blender.skin.material.paint_vertices", watched)

    class Building(ModelTask):
        busy_seconds = 0.0
        use = FACESTAGE_OT_build_rig.use

        @staticmethod
        def _file() -> Path:
            return exported

    made: Any = Building()
    ended = SimpleNamespace(outcome=lambda: Outcome(0, ""), poll=lambda: ())
    Running.process = made._process = ended  # type: ignore[assignment]
    made._scene, made._timer = scene.name, 1
    context = in_a_window()
    context.window_manager.timers = 1
    seen = []
    while made.modal(context, TIMER) == {"RUNNING_MODAL"}:
        seen.append((exported.exists(), len(painted), scene.facestage.rig is not None))
    # The last one has aimed the photo's camera.
    assert seen == [(False, 0, False), (False, 1, False), *2 * [(False, 1, True)]]
    assert context.window_manager.timers == 0

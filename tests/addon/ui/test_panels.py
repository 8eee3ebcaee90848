"""What the panels say, and where: drawn into a list instead of a window."""

from __future__ import annotations

import itertools
from types import SimpleNamespace
from typing import Any

import pytest


class Drawn:
    """A layout that remembers the words drawn into it."""

    def __init__(self, words: list[str] | None = None) -> None:
        self.words = [] if words is None else words

    def label(self, text: str = "", icon: str = "NONE") -> None:
        self.words.append(text)

    def progress(self, text: str = "", **_: object) -> None:
        self.words.append(text)

    def operator(self, name: str, text: str | None = None, **_: object) -> SimpleNamespace:
        self.words.append(text or name)
        return SimpleNamespace()

    def prop(self, *_: object, **__: object) -> None:
        """Settings are no words here."""

    menu = operator_menu_enum = separator = prop

    def box(self, **_: object) -> Drawn:
        return Drawn(self.words)

    row = column = grid_flow = split = box


@pytest.fixture
def drawn(scene):
    """The words that a panel draws."""
    import bpy

    from facestage_blender.ui import face, fit, light_stage, photo, result

    panels = {
        "photo": photo.FACESTAGE_PT_photo,
        "stage": light_stage.FACESTAGE_PT_stage,
        "face": face.FACESTAGE_PT_face,
        "fit": fit.FACESTAGE_PT_fit,
        "result": result.FACESTAGE_PT_result,
    }

    def draw(step: str) -> list[str]:
        layout = Drawn()
        context = SimpleNamespace(
            scene=scene,
            window_manager=bpy.context.window_manager,
            preferences=SimpleNamespace(system=SimpleNamespace(ui_scale=1.0)),
            region=SimpleNamespace(width=291),
        )
        panel: Any = panels[step]
        panel.draw(SimpleNamespace(layout=layout), context)
        return layout.words

    return draw


STEPS = {"Looking for the face": "photo", "Loading the face model": "face", "Fitting": "fit"}


@pytest.mark.parametrize("task", STEPS)
def test_a_task_shows_its_progress_in_its_own_step_alone(drawn, task: str) -> None:
    import bpy

    state = bpy.context.window_manager.facestage
    state.task = state.began = task
    shown = {step for step in set(STEPS.values()) if any(task in word for word in drawn(step))}
    assert shown == {STEPS[task]}


@pytest.mark.parametrize("task", STEPS)
def test_a_task_says_why_it_failed_in_its_own_step_alone(drawn, task: str) -> None:
    import bpy

    state = bpy.context.window_manager.facestage
    state.began, state.failure = task, "Unlucky."
    shown = {step for step in set(STEPS.values()) if "Unlucky." in drawn(step)}
    assert shown == {STEPS[task]}


def test_several_photos_are_listed_and_counted(drawn, scene) -> None:
    assert "facestage.add_photos" not in drawn("photo")
    scene.facestage.photo = "/somewhere/a.png"
    assert "Add" in drawn("photo") and "facestage.remove_photo" not in drawn("photo")
    for name in ("a.png", "b.png", "c.png"):
        scene.facestage.photos.add().photo = f"/somewhere/{name}"
    scene.facestage.photos[0].doubtful, scene.facestage.photos[0].advice = True, "Someone else."
    words = drawn("photo")
    assert words[:6:2] == ["a.png", "b.png", "c.png"] and "Someone else." in words
    assert "Fit to 3 Photos" in drawn("fit")


def test_a_fit_is_judged_below_its_button(drawn) -> None:
    import bpy

    state = bpy.context.window_manager.facestage
    state.verdict = "Converged."
    words = drawn("fit")
    assert words.index("Converged.") > words.index("facestage.fit")
    assert "Converged." not in drawn("result")


def test_a_long_stage_stands_alone_in_the_bar(drawn) -> None:
    import bpy

    state = bpy.context.window_manager.facestage
    state.task = state.began = "Fitting"
    state.stage = "pose"
    assert "0%  Fitting: pose" in drawn("fit")
    state.stage = "what is to be read in full, step 12"
    assert f"0%  {state.stage}" in drawn("fit")


def test_what_is_in_the_way_is_named_in_full(drawn, scene) -> None:
    import bpy

    from facestage_blender.scene.stage import new_stage

    new_stage(scene)
    for name in ("Lamp of the default scene", "Second lamp of the scene"):
        lamp = bpy.data.objects.new(name, bpy.data.lights.new(name, "POINT"))
        lamp.data.energy = 10
        scene.collection.objects.link(lamp)
    words = " ".join(drawn("stage"))
    assert "In the way: Lamp of the default scene, Second lamp of the scene" in words


def test_no_line_is_wider_than_it_may_be() -> None:
    import blf
    import bpy  # noqa: F401

    from facestage_blender.drawing import FONT, wrapped

    text = (
        "The photo shows no face that can be found; choose another, or a landmark file of it. " * 2
    )
    for width in (120.0, 195.0, 400.0):
        lines = wrapped(text, width)
        assert " ".join(lines).split() == text.split()
        assert max(blf.dimensions(FONT, line)[0] for line in lines) <= width
        longest = [f"{line} {after.split()[0]}" for line, after in itertools.pairwise(lines)]
        assert all(blf.dimensions(FONT, line)[0] > width for line in longest)  # none is cut short


def test_a_chosen_photo_is_looked_at(scene, photo) -> None:
    import bpy

    window = bpy.context.window_manager.windows[0]
    areas = [area for area in window.screen.areas if area.type == "VIEW_3D"]
    assert areas
    with bpy.context.temp_override(window=window):
        assert bpy.ops.facestage.choose_photo(filepath=str(photo)) == {"FINISHED"}
    for area in areas:
        space = area.spaces.active
        assert space.region_3d.view_perspective == "CAMERA"
        assert not space.overlay.show_relationship_lines

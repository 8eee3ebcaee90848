"""The white balance by a click: what is read, what the job gets, what is refused."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from addon.ui.refusal import refused
from facestage.contract.files.color import srgb_to_linear

CODES = np.array([200, 150, 100])  # red, green, blue


@pytest.fixture
def grey_photo(tmp_path: Path) -> Path:
    """Black on the left, saturated on the right, a tinted card in the upper middle."""
    import cv2

    pixels = np.zeros((40, 90, 3), np.uint8)
    pixels[:, 60:] = 255
    pixels[:20, 30:60] = CODES[::-1]
    path = tmp_path / "grey.png"
    assert cv2.imwrite(str(path), pixels)
    return path


@pytest.fixture
def ready(scene, grey_photo: Path):
    import bpy

    assert bpy.ops.facestage.choose_photo(filepath=str(grey_photo)) == {"FINISHED"}
    return scene


def test_a_click_reads_the_light(ready, photo: Path) -> None:
    import bpy

    settings = ready.facestage
    assert not settings.white_balance_known
    assert bpy.ops.facestage.pick_white_balance(x=45, y=10) == {"FINISHED"}
    linear = srgb_to_linear(CODES / 255)
    np.testing.assert_allclose(settings.white_balance, linear / linear.max(), rtol=1e-4)
    assert settings.white_balance_known
    assert bpy.ops.facestage.choose_photo(filepath=str(photo)) == {"FINISHED"}
    assert not settings.white_balance_known, "another photo, another light"


def test_the_job_knows_it_where_it_is_on(ready) -> None:
    import bpy

    from facestage_blender.exchange.scene_read import read_job

    bpy.ops.facestage.build_stage()
    bpy.ops.facestage.build_rig()
    settings = ready.facestage
    settings.white_balance = (1.0, 0.5, 0.25)
    assert read_job(ready).white_balance is None
    settings.white_balance_known = True
    assert read_job(ready).white_balance == (1.0, 0.5, 0.25)


@pytest.mark.parametrize(
    ("x", "y", "words"), [(10, 5, "black"), (80, 5, "saturated"), (45, 100, "outside")]
)
def test_what_has_no_color_is_refused(ready, x: float, y: float, words: str) -> None:
    import bpy

    refused(bpy.ops.facestage.pick_white_balance, words, x=x, y=y)
    assert not ready.facestage.white_balance_known


def test_deep_pictures_are_linear_already(scene, tmp_path: Path) -> None:
    import cv2

    from facestage_blender.pictures.grey import read_grey
    from facestage_blender.pictures.render import save_exr

    deep = np.full((20, 20, 3), CODES[::-1] * 257, np.uint16)
    assert cv2.imwrite(str(tmp_path / "deep.png"), deep)
    linear = srgb_to_linear(CODES / 255)
    found = read_grey(tmp_path / "deep.png", 10, 10)
    np.testing.assert_allclose(found, linear / linear.max(), rtol=1e-3)
    bright = np.full((20, 20, 3), [4.0, 3.0, 2.0], np.float32)
    save_exr(tmp_path / "bright.exr", bright)
    np.testing.assert_allclose(read_grey(tmp_path / "bright.exr", 3, 3), [1, 0.75, 0.5], rtol=1e-3)


class Clicking:
    """An operator in the user interface, which Blender alone can make."""

    def __init__(self, area: Any) -> None:
        from facestage_blender.ui.white_balance import FACESTAGE_OT_pick_white_balance as Operator

        self.reports: list[str] = []
        operator: Any = Operator
        self._operator, self._area, self._was = operator, area, "VIEW_3D"
        self.x = self.y = -1.0

    def modal(self, context: Any, **event: Any) -> set[str]:
        given = {"type": "LEFTMOUSE", "value": "PRESS", "mouse_x": 150, "mouse_y": 75}
        return self._operator.modal(self, context, SimpleNamespace(**given | event))

    def invoke(self, context: Any) -> set[str]:
        return self._operator.invoke(self, context, None)

    def report(self, _kind: set[str], words: str) -> None:
        self.reports.append(words)

    def execute(self, _context: Any) -> set[str]:
        return {"FINISHED"}

    def _under(self, event: Any) -> Any:
        return self._operator._under(self, event)

    def _give_back(self, context: Any) -> None:
        self._operator._give_back(self, context)


def clicking(at: tuple[float, float]) -> tuple[Clicking, Any, Any]:
    """The operator, Blender's context and an editor in which the mouse is ``at`` the picture."""
    import bpy

    view = SimpleNamespace(region_to_view=lambda _x, _y: at)
    region = SimpleNamespace(type="WINDOW", x=100, y=50, width=100, height=50, view2d=view)
    area = SimpleNamespace(type="IMAGE_EDITOR", regions=[region])
    window = SimpleNamespace(cursor_modal_restore=lambda: None)
    return Clicking(area), SimpleNamespace(window=window, scene=bpy.context.scene), area


def test_a_click_is_a_pixel_from_the_upper_left_corner(ready) -> None:
    operator, context, area = clicking((0.5, 0.75))
    for passed in ({"type": "MOUSEMOVE"}, {"value": "RELEASE"}, {"mouse_x": 99}, {"mouse_y": 101}):
        assert operator.modal(context, **passed) == {"PASS_THROUGH"}
    assert area.type == "IMAGE_EDITOR"
    assert operator.modal(context) == {"FINISHED"}
    assert (operator.x, operator.y) == (45.0, 10.0)
    assert area.type == "VIEW_3D", "what the user had there"


def test_nothing_is_read_beside_the_photo_or_after_escape(ready) -> None:
    operator, context, area = clicking((1.2, 0.5))
    assert operator.modal(context) == {"CANCELLED"} and operator.x == -1
    assert "beside the photo" in operator.reports[0]
    operator, context, area = clicking((0.5, 0.5))
    assert operator.modal(context, type="ESC") == {"CANCELLED"} and not operator.reports
    assert area.type == "VIEW_3D"


def test_the_view_shows_the_photo_until_then(ready, grey_photo: Path) -> None:
    import bpy

    area = next(one for one in bpy.context.window.screen.areas if one.type == "VIEW_3D")
    asked: list[object] = []
    operator = Clicking(None)
    context = SimpleNamespace(
        scene=ready,
        area=area,
        window=SimpleNamespace(
            screen=bpy.context.window.screen,
            cursor_modal_set=asked.append,
            cursor_modal_restore=lambda: None,
        ),
        window_manager=SimpleNamespace(modal_handler_add=asked.append),
    )
    assert operator.invoke(context) == {"RUNNING_MODAL"} and asked == ["EYEDROPPER", operator]
    assert area.type == "IMAGE_EDITOR"
    assert Path(area.spaces.active.image.filepath).name == grey_photo.name
    assert operator.modal(context, type="ESC") == {"CANCELLED"}
    assert area.type == "VIEW_3D"
    ready.facestage.photo = ""
    assert operator.invoke(context) == {"CANCELLED"}
    assert "No photo is chosen" in operator.reports[0]

"""Frames of glasses on drawn faces, and the dark lines of faces that wear none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_dilation

from facestage.fit.given import problem as problem_module
from facestage.fit.given.problem import read_problem
from facestage.fit.given.spectacles import clear_of_frame, crossing_depth, spectacle_frame
from facestage.models.anatomy.landmark_schemes import scheme_of
from reference.drawn_glasses import (
    APART,
    BRIDGE,
    BROW,
    BROWS,
    EYES,
    FRAME,
    LENS,
    MIDDLE,
    RING,
    SIDE,
    SIZES,
    X,
    Y,
    drawn,
    landmarks,
)
from reference.small_fit import QUICK
from reference.synthetic_case import Case


@pytest.mark.parametrize("scheme", SIZES)
@pytest.mark.parametrize("exposure", [1.0, 9.0])
def test_a_frame_is_found_and_little_else(scheme: str, exposure: float):
    color, skin = drawn(RING, BRIDGE)
    found = spectacle_frame(exposure * color, skin, landmarks(scheme))
    # Where it runs along a brow, both together are no line, or the brow passes for part of it.
    assert found[FRAME].mean() > 0.98
    beside = binary_dilation(RING | BRIDGE | BROW, np.ones((3, 3)), iterations=5)
    assert not found[~beside].any()


def test_skin_behind_glass_is_clear_of_the_frame_and_brows_beside_it_are_not():
    color, skin = drawn(RING, BRIDGE)
    seen = landmarks("ibug68")
    found = spectacle_frame(color, skin, seen)
    clear = clear_of_frame(found, seen)
    assert not clear[found].any()
    near, around = (binary_dilation(found, np.ones((3, 3)), iterations=n) for n in (4, 9))
    around &= ~near
    below, above = around & (EYES + 10 < Y), around & binary_dilation(BROW, iterations=9)
    print(clear[below].mean(), clear[above].mean())
    assert (clear[below] == 1).all() and above.any() and clear[above].mean() < 0.4
    assert (clear_of_frame(np.zeros_like(found), seen) == 1).all()


def test_lashes_that_touch_a_frame_are_no_part_of_it():
    lashes = (np.abs(X - MIDDLE) > APART + 24) & (np.abs(X - MIDDLE) < APART + LENS)
    color, skin = drawn(RING, BRIDGE, lashes & (np.abs(Y - EYES) < 4))
    found = spectacle_frame(color, skin, landmarks("ibug68"))
    assert found[FRAME].mean() > 0.98
    assert not found[(np.abs(np.abs(X - MIDDLE) - APART) < 25) & (np.abs(Y - EYES) < 8)].any()


@pytest.mark.parametrize("exposure", [0.02, 1.0])
def test_a_faint_line_is_no_frame_at_any_exposure(exposure: float):
    color, skin = drawn()
    color[RING | BRIDGE] *= 0.5
    assert not spectacle_frame(exposure * color, skin, landmarks("ibug68")).any()


@pytest.mark.parametrize("turn", [-80.0, 25.0])
def test_a_head_may_lie_on_its_side(turn: float):
    marks = landmarks("ibug68")
    cosine, sine = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    turned = np.array([[cosine, -sine], [sine, cosine]])
    points = (marks.points - SIDE / 2) @ turned.T + SIDE / 2
    x, y = ((np.stack([X, Y], -1) - SIDE / 2) @ turned + SIDE / 2).transpose(2, 0, 1)
    column, row = (np.clip(axis, 0, SIDE - 1).astype(int) for axis in (x, y))
    color, skin = (image[row, column] for image in drawn(RING, BRIDGE))
    found = spectacle_frame(color, skin, replace(marks, points=points))
    assert found[FRAME[row, column]].mean() > 0.98


@pytest.mark.parametrize(
    "dark",
    [
        pytest.param((), id="bare"),
        pytest.param((RING,), id="rings under the eyes that nothing joins"),
        pytest.param(((np.abs(X - MIDDLE) < 60) & (np.abs(Y - BROWS) < 7),), id="joined brows"),
        pytest.param((BRIDGE, (np.abs(X - MIDDLE) < 20) & (np.abs(Y - 120) < 4)), id="frown"),
        pytest.param((RING & (Y < EYES), BRIDGE), id="nothing below the eyes"),
        pytest.param((Y < 160,), id="a shadow down to the cheeks"),
    ],
)
def test_a_face_without_glasses_has_no_frame(dark: tuple[np.ndarray, ...]):
    color, skin = drawn(*dark)
    assert not spectacle_frame(color, skin, landmarks("mediapipe478")).any()


def test_what_cannot_be_looked_at_has_no_frame():
    color, skin = drawn(RING, BRIDGE)
    marks = landmarks("ibug68")
    assert spectacle_frame(color, skin, marks).any()
    unknown = marks.points.copy()
    unknown[scheme_of("ibug68").openings[2]] = np.nan
    assert not spectacle_frame(color, skin, replace(marks, points=unknown)).any()
    assert not spectacle_frame(color, np.zeros_like(skin), marks).any()
    assert not spectacle_frame(np.full_like(color, np.nan), skin, marks).any()
    outside = replace(marks, points=marks.points - 2.0 * SIDE)
    assert not spectacle_frame(color, skin, outside).any()
    tiny = replace(marks, points=marks.points / 10)
    assert not spectacle_frame(color[::10, ::10], skin[::10, ::10], tiny).any()


def test_the_deepest_way_across_is_as_deep_as_its_shallowest_place():
    lines = np.zeros((6, 8))
    lines[1] = [2.0, 2.0, 0.4, 2.0, 2.0, 2.0, 2.0, 2.0]
    lines[3:5] = np.where(np.arange(8) % 2 == np.arange(2)[:, None], 0.9, 0.1)
    ends = np.zeros((6, 8), bool), np.zeros((6, 8), bool)
    ends[0][:, 0] = ends[1][:, -1] = True
    assert crossing_depth(lines, ends) == pytest.approx(0.9, abs=0.01)
    lines[3:5, 4] = 0.0
    assert crossing_depth(lines, ends) == pytest.approx(0.4, abs=0.01)
    assert crossing_depth(np.zeros_like(lines), ends) == 0.0


@pytest.mark.parametrize("found", ["spectacle_frame", "sunglasses"])
def test_a_fit_neither_reads_nor_paints_glasses(
    found: str, case: Case, monkeypatch: pytest.MonkeyPatch
):
    problem = read_problem(case.job(), fineness=QUICK)
    assert not problem.frame.any()
    colored = problem.skin
    frame = (colored > 0.9) & (np.arange(colored.shape[1]) % 8 < 3)
    monkeypatch.setattr(problem_module, found, lambda *_: frame)
    worn = read_problem(case.job(), fineness=QUICK)
    for name in ("skin", "paintable"):
        assert (getattr(problem, name)[frame] > 0).any()
        np.testing.assert_array_equal(
            getattr(worn, name), np.where(frame, 0.0, getattr(problem, name))
        )


def test_skin_is_clear_of_a_frame_close_to_it_and_of_dark_glass_farther_off(
    case: Case, monkeypatch: pytest.MonkeyPatch
):
    face = np.ones_like(read_problem(case.job(), fineness=QUICK).frame)
    worn = np.zeros_like(face)
    worn[60:66, 40:56] = True  # on the cheeks
    beside = np.zeros_like(face)
    beside[67, 42:54] = True  # two pixels away
    clear = {}
    for found in ("spectacle_frame", "sunglasses"):
        with monkeypatch.context() as patch:
            patch.setattr(problem_module, found, lambda *_: worn)
            clear[found] = read_problem(case.job(), fineness=QUICK).clear(face)
        assert not clear[found][worn].any()
    assert (clear["spectacle_frame"][beside] == 1).all()
    assert (clear["sunglasses"][beside] < 0.7).all()

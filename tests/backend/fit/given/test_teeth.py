"""Closed teeth between parted lips: pictures painted row by row."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.files.color import REC709
from facestage.contract.landmarks import Landmarks
from facestage.fit.face.unknowns import EXPRESSION_SIGMA
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given import teeth
from facestage.fit.given.problem import read_problem
from facestage.fit.given.teeth import CLOSED_SIGMA, closed_teeth, expression_deviations, teeth_color
from facestage.fit.stages.phases import PHASES
from facestage.fit.stages.view import View
from facestage.models.anatomy.landmark_schemes import scheme_of
from facestage.models.registry import load_model
from reference.small_fit import QUICK
from reference.synthetic_case import Case

SKIN, TOOTH, TONGUE, DARK = (0.5, 0.32, 0.25), (0.55, 0.5, 0.42), (0.4, 0.15, 0.15), (0.03,) * 3
TOP, HEIGHT, SIZE = 100, 40, 240
EVERYWHERE = np.ones((SIZE, SIZE), bool)
SIZES = {"mediapipe478": 478, "ibug68": 68}


def mouth(scheme: str = "mediapipe478", height: float = HEIGHT) -> Landmarks:
    """An opening of ``height`` pixels from row TOP down in the middle, all other points at 0."""
    ring = scheme_of(scheme).openings[0]
    angle = np.pi + 2 * np.pi * np.arange(len(ring)) / len(ring)
    points = np.zeros((SIZES[scheme], 2))
    middle = np.array([SIZE / 2, TOP + height / 2])
    # From the corner at the left below the middle: ibug68 goes round the other way.
    way = -1.0 if scheme == "mediapipe478" else 1.0
    around = np.stack([60 * np.cos(angle), way * height / 2 * np.sin(angle)], axis=-1)
    points[ring] = middle + around
    return Landmarks(scheme, points, np.ones(len(points), bool))


def painted(*rows: tuple[float, tuple[float, ...]]) -> tuple[np.ndarray, np.ndarray]:
    """(h, w, 3) and its skin (h, w): from the share of the opening on that each row says."""
    color = np.full((SIZE, SIZE, 3), SKIN)
    skin = np.ones((SIZE, SIZE))
    skin[TOP : TOP + HEIGHT] = 0.0
    for start, paint in rows:
        color[TOP + round(start * HEIGHT) : TOP + HEIGHT] = paint
    return color, skin


@pytest.mark.parametrize("scheme", SIZES)
@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ([(0.0, TOOTH)], 1.0),
        ([(0.0, TONGUE), (0.3, TOOTH), (0.8, DARK), (0.9, TONGUE)], 1.0),  # gums, a line of shade
        ([(0.0, TOOTH), (0.6, DARK)], 0.0),
        ([(0.0, TOOTH), (0.3, DARK), (0.7, TOOTH)], 0.0),  # two rows, apart
        ([(0.0, TOOTH), (0.15, TONGUE)], 0.0),
        ([(0.0, DARK)], 0.0),
    ],
)
def test_teeth_are_closed_where_they_fill_the_opening(scheme: str, rows: list, expected: float):
    color, skin = painted(*rows)
    assert closed_teeth(color, skin, mouth(scheme)) == expected


def test_the_shade_of_the_lip_does_not_open_a_small_mouth():
    """Of seven rows of pixels, two are in it and count as dark, before teeth too."""
    color, skin = np.full((SIZE, SIZE, 3), SKIN), np.ones((SIZE, SIZE))
    skin[TOP : TOP + 7] = 0.0
    color[TOP : TOP + 2], color[TOP + 2 : TOP + 7] = DARK, TOOTH
    small = mouth(height=7)
    assert closed_teeth(color, skin, small) > 0.9
    color[TOP : TOP + 4] = DARK
    assert closed_teeth(color, skin, small) == 0.0


def test_exposure_does_not_matter():
    color, skin = painted((0.0, TOOTH), (0.75, DARK))
    found = closed_teeth(color, skin, mouth())
    assert 0.1 < found < 0.9
    assert closed_teeth(7.0 * color, skin, mouth()) == pytest.approx(found)


@pytest.mark.parametrize(
    ("light", "red", "expected"),
    [
        (1.4, 1.01, 1.0),  # teeth in a photo of paled colors
        (1.4, 1.2, 0.0),  # a tongue that lies in the light
        (0.9, 1.03, 0.0),  # pink gums
    ],
)
def test_what_is_lighter_than_skin_may_be_as_red(light: float, red: float, expected: float):
    luminance = np.array(SKIN) * REC709
    paint = np.array(SKIN) * [red, 1.0, 1.0]
    paint *= light * luminance.sum() / (luminance @ [red, 1.0, 1.0])
    color, skin = painted((0.0, tuple(paint)))
    assert closed_teeth(color, skin, mouth()) == expected


def test_nothing_is_said_of_lips_that_meet_or_do_not_show():
    color, skin = painted((0.0, TOOTH))
    assert closed_teeth(color, skin, mouth()) == 1.0
    assert closed_teeth(color, skin, mouth(height=3.0)) == 0.0
    assert closed_teeth(color, np.zeros_like(skin), mouth()) == 0.0
    assert closed_teeth(color[: TOP + 10], skin[: TOP + 10], mouth()) == 0.0
    assert closed_teeth(color[:, : SIZE // 2 - 5], skin[:, : SIZE // 2 - 5], mouth()) == 0.0
    hidden = mouth()
    hidden.visible[13] = False
    assert closed_teeth(color, skin, hidden) == 0.0
    unknown = mouth()
    unknown.points[14] = np.nan
    assert closed_teeth(color, skin, replace(unknown, weights=None)) == 0.0
    assert closed_teeth(np.full_like(color, np.nan), skin, mouth()) == 0.0


@pytest.mark.parametrize("scheme", SIZES)
@pytest.mark.parametrize("brightness", [0.2, 1.0])
def test_teeth_have_the_color_of_those_that_are_lit_best(scheme: str, brightness: float):
    """Above them gums, in the middle they shine, below a lip shades them."""
    shaded, wet = 0.5 * np.array(TOOTH), 1.8 * np.array(TOOTH)
    rows = (0.0, TONGUE), (0.2, TOOTH), (0.42, tuple(wet)), (0.45, TOOTH), (0.7, tuple(shaded))
    color, skin = painted(*rows)
    found = teeth_color(brightness * color, skin, mouth(scheme), EVERYWHERE)
    assert found is not None
    np.testing.assert_allclose(found, brightness * np.array(TOOTH), rtol=0.02)


@pytest.mark.parametrize("paint", [TONGUE, DARK, (0.6, 0.3, 0.25)])
def test_what_is_no_tooth_has_no_color_of_teeth(paint: tuple[float, ...]):
    color, skin = painted((0.0, paint))
    assert teeth_color(color, skin, mouth(), EVERYWHERE) is None
    some, _ = painted((0.0, paint), (0.5, TOOTH))
    assert teeth_color(some, skin, mouth(), EVERYWHERE) is not None


def test_teeth_in_the_dark_of_the_mouth_say_nothing_of_their_color():
    for brightness, expected in ((1.0, True), (0.8, False)):
        color, skin = painted((0.0, tuple(brightness * np.array(TOOTH))))
        assert (teeth_color(color, skin, mouth(), EVERYWHERE) is not None) is expected


def test_few_teeth_say_nothing_of_their_color():
    color, skin = painted((0.0, DARK))
    color[TOP + HEIGHT // 2, SIZE // 2 : SIZE // 2 + 10] = TOOTH
    assert teeth_color(color, skin, mouth(), EVERYWHERE) is not None
    large = mouth()
    large.points[scheme_of(large.scheme).outline[0]] = SIZE
    assert teeth_color(color, skin, large, EVERYWHERE) is None
    color, skin = painted((0.0, TOOTH))
    assert teeth_color(color, np.zeros_like(skin), mouth(), EVERYWHERE) is None
    assert teeth_color(color, skin, mouth(), EVERYWHERE) is not None
    shown = EVERYWHERE.copy()
    shown[TOP : TOP + HEIGHT] = False
    assert teeth_color(color, skin, mouth(), shown) is None
    assert teeth_color(color, skin, mouth(), ~shown) is None
    unknown = mouth()
    unknown.points[14] = np.nan
    assert teeth_color(color, skin, replace(unknown, weights=None), EVERYWHERE) is None


@pytest.mark.parametrize("closed", [0.0, 0.5, 1.0])
def test_closed_teeth_hold_the_jaw_and_nothing_else(closed: float):
    model = load_model("default")
    found = expression_deviations(model, closed)
    jaw = model.expression_names.index("jawOpen")
    expected = EXPRESSION_SIGMA ** (1 - closed) * CLOSED_SIGMA**closed
    assert found[jaw] == pytest.approx(expected)
    np.testing.assert_allclose(np.delete(found, jaw), EXPRESSION_SIGMA)


def test_a_fit_holds_the_jaw_of_a_photo_with_closed_teeth(
    case: Case, monkeypatch: pytest.MonkeyPatch
):
    problem = read_problem(case.job(), fineness=QUICK)
    assert problem.closed_teeth == closed_teeth(
        problem.photograph.color, problem.skin, problem.landmarks
    )
    jaw = problem.geometry.model.expression_names[1]
    monkeypatch.setattr(teeth, "JAW_OPEN", jaw)
    for closed, sigma in ((0.0, EXPRESSION_SIGMA), (1.0, CLOSED_SIGMA)):
        monkeypatch.setitem(vars(problem), "closed_teeth", closed)
        view = View(problem, ForwardModel(problem.geometry, problem.lights))
        found = np.asarray(view.known(PHASES[0], view.start_state()).expression_sigma)
        expected = np.where(np.arange(len(found)) == 1, sigma, EXPRESSION_SIGMA)
        np.testing.assert_allclose(found, expected)

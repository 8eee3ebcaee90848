"""Steps across drawn hairlines of known height."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.fit.given.hairline import CHANGE_LEAST, STEP_MIN, hairline_step

SIDE, LENGTH = 200, 100.0
UP = np.array([0.0, -LENGTH])
ROW, COLUMN = np.mgrid[:SIDE, :SIDE].astype(float)
# Brows in row 100, the border of the face in row 70 and 70 pixels beside the middle.
HEIGHT = (100 - ROW) / LENGTH
WITHIN = np.minimum(ROW - 70, 70 - np.abs(COLUMN - 100)) / LENGTH
HAIR = ROW < 70


def looks(step: np.ndarray) -> np.ndarray:
    return np.where(HAIR[..., None], step, 0.0)


def test_a_step_counts_in_what_a_face_changes_by():
    step = np.array([0.1, -0.08, 0.4, 1.0])
    found = hairline_step(HAIR, looks(step), WITHIN, HEIGHT, UP)
    assert found == pytest.approx(np.sqrt(np.mean((step / CHANGE_LEAST) ** 2)), rel=1e-3)


def test_a_face_that_changes_as_much_has_no_line_there():
    """Shading that goes on over the line, four times as steep as the least."""
    shading = 4 * CHANGE_LEAST * ROW[..., None] / 10
    assert hairline_step(HAIR, shading, WITHIN, HEIGHT, UP) == pytest.approx(1.0, rel=1e-3)
    assert hairline_step(HAIR, looks(np.zeros(4)), WITHIN, HEIGHT, UP) == 0.0 < STEP_MIN


@pytest.mark.parametrize(
    "hair", [np.zeros_like(HAIR), ROW < 97, ROW > 110, np.abs(COLUMN - 100) > 60]
)
def test_borders_below_the_brows_and_upright_ones_are_no_hairlines(hair: np.ndarray):
    assert hairline_step(hair, looks(np.ones(4)), WITHIN, HEIGHT, UP) == np.inf


def test_a_turned_face_has_the_same_step():
    step = np.array([0.1, -0.08, 0.4, 1.0])
    upright = hairline_step(HAIR, looks(step), WITHIN, HEIGHT, UP)
    turned = hairline_step(HAIR.T, looks(step).swapaxes(0, 1), WITHIN.T, HEIGHT.T, UP[::-1])
    assert turned == pytest.approx(upright, rel=1e-6)


def test_a_line_is_judged_by_its_middle():
    """A third of it in a highlight does not make it one."""
    bright = np.where((COLUMN < 70)[..., None], looks(np.full(4, 9.0)), 0.0)
    assert hairline_step(HAIR, bright, WITHIN, HEIGHT, UP) < STEP_MIN

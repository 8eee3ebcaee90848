"""Folds of an expression: lines across the way that it presses the skin go with it, all else
stays.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.folds import PLACES
from facestage.fit.face.state import State
from facestage.fit.textures.expression_folds import ExpressionFolds, expression_folds, without
from reference.known import known
from reference.painted_face import PaintedFace, painted_face

SCHEME = "mediapipe478"
SMILE = {"mouthSmileLeft": 0.8, "mouthSmileRight": 0.7}
DEPTH = 0.5
# Metres of the mean face: a smile presses the cheek up and outwards, so that its fold runs down and
# outwards, beside the mouth.
FOLD = [(0.033 + 0.0017 * k, -0.020 - 0.0018 * k, -0.004) for k in range(-5, 6)]
OTHER = [(-0.034 + 0.0016 * k, -0.020 - 0.0017 * k, -0.004) for k in range(-5, 6)]
MOLE = [(-0.044, -0.030, -0.008)]


@pytest.fixture(scope="module")
def face(renderer: str) -> PaintedFace:
    return painted_face(texels=512)


def expressed(face: PaintedFace, **weights: float) -> State:
    names = face.forward.geometry.model.expression_names
    values = np.array([weights.get(name, 0.0) for name in names])
    return replace(face.state, expression=values)


def drawn(face: PaintedFace, points: list[tuple[float, float, float]]) -> np.ndarray:
    """(S, S) 0..1."""
    return np.max([face.uv_blob(face.atlas.size, each, 0.0022) for each in points], axis=0)


def painted(face: PaintedFace) -> np.ndarray:
    """(S, S, 3) log albedo: the model's, with a fold, a other line, and a mole."""
    logs = face.atlas.bake(face.forward.log_albedo(face.state))
    for points in (FOLD, OTHER, MOLE):
        logs = logs - DEPTH * drawn(face, points)[..., None] * np.array([0.8, 1.0, 1.2])
    return logs


def found_in(face: PaintedFace, state: State, logs: np.ndarray) -> ExpressionFolds | None:
    size = len(logs)
    times = size // face.atlas.size
    seen = np.repeat(np.repeat(face.atlas.skin, times, axis=0), times, axis=1)
    return expression_folds(face.forward.geometry, state, SCHEME, face.atlas, logs, seen)


@pytest.fixture(scope="module")
def smiling(face: PaintedFace) -> ExpressionFolds:
    return known(found_in(face, expressed(face, **SMILE), painted(face)))


def test_a_fold_of_the_smile_is_one_and_other_lines_and_moles_are_none(
    face: PaintedFace, smiling: ExpressionFolds
):
    logs = np.log(smiling.ratio)
    fold, other, mole = (drawn(face, each) > 0.9 for each in (FOLD, OTHER, MOLE))
    on = np.median(logs[fold], axis=0)
    print("fold", on, "other line", logs[other].mean(0), "mole", logs[mole].mean(0))
    np.testing.assert_allclose(on, -DEPTH * np.array([0.8, 1.0, 1.2]), atol=0.12)
    assert np.abs(logs[other]).mean() < 0.1 * DEPTH
    assert np.abs(logs[mole]).mean() < 0.1 * DEPTH
    beside = (drawn(face, [*FOLD, *OTHER, *MOLE]) == 0) & face.atlas.skin
    assert np.abs(logs[beside]).mean() < 0.01


def test_a_light_ridge_goes_with_its_fold(face: PaintedFace):
    """Up and down alike: only the sign differs."""
    dark = face.atlas.bake(face.forward.log_albedo(face.state))
    mark, state = DEPTH * drawn(face, FOLD)[..., None], expressed(face, **SMILE)
    there = drawn(face, FOLD) > 0.9
    down, up = (
        np.log(known(found_in(face, state, dark + sign * mark)).ratio[there]).mean()
        for sign in (-1.0, 1.0)
    )
    assert down < -0.3 and up == pytest.approx(-down, abs=0.06)


def test_skin_between_two_folds_is_no_ridge(face: PaintedFace):
    plain = face.atlas.bake(face.forward.log_albedo(face.state))
    second = [(x + 0.006, y + 0.0055, z - 0.002) for x, y, z in FOLD]
    between = [(x + 0.003, y + 0.00275, z - 0.001) for x, y, z in FOLD]
    dark = np.maximum(drawn(face, FOLD), drawn(face, second))
    found = known(found_in(face, expressed(face, **SMILE), plain - DEPTH * dark[..., None]))
    logs = np.log(found.ratio).mean(axis=-1)
    folds, middle = dark > 0.9, (drawn(face, between) > 0.9) & (dark == 0)
    print("folds", logs[folds].mean(), "between", logs[middle].mean(), middle.sum())
    assert middle.sum() > 20 and logs[folds].mean() < -0.25
    assert logs[middle].mean() < 0.1


def test_lines_where_a_smile_presses_nothing_stay(face: PaintedFace):
    plain = face.atlas.bake(face.forward.log_albedo(face.state))
    middle, steps = (0.02, 0.085, 0.0), 0.002 * np.arange(-5, 6)
    cross = [(middle[0] + step, middle[1], middle[2]) for step in steps]
    cross += [(middle[0], middle[1] + step, middle[2]) for step in steps]
    marks = np.maximum(drawn(face, cross), drawn(face, FOLD))
    found = known(found_in(face, expressed(face, **SMILE), plain - DEPTH * marks[..., None]))
    assert np.log(found.ratio[drawn(face, FOLD) > 0.9]).mean() < -0.25
    np.testing.assert_allclose(found.ratio[drawn(face, cross) > 0], 1.0, atol=0.01)


def test_textures_of_more_texels_have_the_same(face: PaintedFace, smiling: ExpressionFolds):
    larger = np.repeat(np.repeat(painted(face), 2, axis=0), 2, axis=1)
    again = known(found_in(face, expressed(face, **SMILE), larger))
    np.testing.assert_allclose(again.ratio, smiling.ratio, atol=1e-4)


@pytest.mark.parametrize("weights", [{}, {"mouthSmileLeft": 0.05}, {"jawOpen": 0.6}])
def test_where_nothing_presses_the_cheeks_lines_are_paint(face: PaintedFace, weights: dict):
    assert found_in(face, expressed(face, **weights), painted(face)) is None


def test_bare_skin_has_none(face: PaintedFace):
    plain = face.atlas.bake(face.forward.log_albedo(face.state))
    assert found_in(face, expressed(face, **SMILE), plain) is None


def test_models_without_these_landmarks_have_none(face: PaintedFace):
    geometry, logs = face.forward.geometry, painted(face)
    state, seen = expressed(face, **SMILE), face.atlas.skin
    assert expression_folds(geometry, state, "another", face.atlas, logs, seen) is None


def test_they_follow_the_sliders_of_their_side(face: PaintedFace, smiling: ExpressionFolds):
    geometry = face.forward.geometry
    folds = smiling.folds
    cheek = np.linalg.norm(geometry.model.vertices[:, :2] - np.array(FOLD[5][:2]), axis=1) < 0.01

    def gone(**weights: float) -> float:
        return float(folds.gone(expressed(face, **weights).expression)[cheek].mean())

    assert folds.place[cheek, PLACES.index("left")].mean() > 0.9
    assert gone(**SMILE) == 0.0
    assert gone() == pytest.approx(1.0, abs=1e-3)
    assert gone(mouthSmileLeft=0.4) == pytest.approx(0.5, abs=0.1)
    assert gone(mouthSmileRight=0.7) > 0.85 and gone(mouthSmileLeft=0.8) < 0.15
    assert gone(mouthPucker=1.0) == pytest.approx(1.0, abs=1e-3)  # stretches it


def test_at_rest_the_albedo_is_that_without_the_fold(face: PaintedFace, smiling: ExpressionFolds):
    geometry = face.forward.geometry
    albedo = np.exp(painted(face)).astype(np.float32)
    fitted = smiling.folds.gone(expressed(face, **SMILE).expression)
    np.testing.assert_array_equal(without(albedo, smiling.ratio, fitted, geometry), albedo)
    rest = without(
        albedo, smiling.ratio, smiling.folds.gone(np.zeros(len(face.state.expression))), geometry
    )
    plain = np.exp(face.atlas.bake(face.forward.log_albedo(face.state)))
    fold, mole = (drawn(face, each) > 0.9 for each in (FOLD, MOLE))
    off = [np.abs(np.log(each / plain))[fold].mean() for each in (albedo, rest)]
    print("off by, before and at rest", off)
    assert off[1] < 0.3 * off[0]
    np.testing.assert_allclose(rest[mole], albedo[mole], rtol=0.1)

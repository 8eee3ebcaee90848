"""Lids: residuals, Jacobian, where the term is silent, and eyes that a landmark stage shuts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.landmarks import Landmarks
from facestage.fit.energy.lid_term import PRESSED, SIGMA_SHARE, LidTerm
from facestage.fit.face.state import State
from facestage.fit.given.lids import seen_lids, shut_weights, shutters
from facestage.models.anatomy.landmark_schemes import scheme_of
from reference.landmarked_face import SCHEME, check_jacobian, landmarked_face
from reference.landmarked_face import LandmarkedFace as Face


@pytest.fixture(scope="module")
def face() -> Face:
    return landmarked_face()


def found_by(face: Face, landmarks: Landmarks) -> LidTerm:
    term = LidTerm.seen(face.geometry, landmarks)
    assert term is not None
    return term


def opening(face: Face, state: State) -> list[float]:
    """Of both eyes, in shares of their width."""
    return [float(eye.apart.mean()) for eye in seen_lids(face.landmarks(state)) if eye is not None]


def test_residuals_are_zero_at_the_truth_and_count_what_lids_are_further_apart(face: Face):
    half = face.with_weights(eyeBlinkLeft=0.5, eyeBlinkRight=0.3)
    term = found_by(face, face.landmarks(half))
    assert np.abs(term.residuals(half)).max() < 1e-9
    off = term.residuals(face.state).reshape(2, -1).mean(axis=1) * SIGMA_SHARE
    expected = np.subtract(opening(face, face.state), opening(face, half))
    np.testing.assert_allclose(off, expected, rtol=0.02)


def test_the_loss_is_quadratic(face: Face):
    term = found_by(face, face.landmarks(face.with_weights(eyeBlinkLeft=1.0)))
    residuals = term.residuals(face.state)
    assert np.ptp(term.robust_weights(residuals)) == 0
    energy = term.weighed(face.state).energies["lids"]
    assert term.weighed(face.state).robust["lids"] == pytest.approx(energy)


@pytest.mark.parametrize("block", ["pose", "focal", "identity", "expression"])
def test_jacobian_equals_finite_differences(face: Face, block: str):
    term = found_by(face, face.landmarks(face.with_weights(eyeBlinkLeft=0.5)))
    check_jacobian(term, face.state, block)


def test_an_eye_that_does_not_show_says_nothing(face: Face):
    landmarks = face.landmarks(face.state)
    right, left = scheme_of(SCHEME).eyes
    hidden = landmarks.visible.copy()
    hidden[left.lids[3][0]] = False
    assert len(found_by(face, replace(landmarks, visible=hidden)).apart) == len(right.lids)
    hidden[right.corners[0]] = False
    assert LidTerm.seen(face.geometry, replace(landmarks, visible=hidden)) is None
    sparse = Landmarks("ibug68", np.zeros((68, 2)), np.ones(68, bool))
    assert LidTerm.seen(face.geometry, sparse) is None


def test_a_shut_eye_is_known_and_what_shuts_it(face: Face):
    model = face.geometry.model
    names = [None if each is None else each.expression for each in shutters(model, SCHEME)]
    assert [model.expression_names[each] for each in names if each is not None] == [
        "eyeBlinkRight",
        "eyeBlinkLeft",
    ]
    wink = face.landmarks(face.with_weights(eyeBlinkLeft=1.0))
    likely = shut_weights(model, wink)
    assert dict(zip(model.expression_names, likely, strict=True))["eyeBlinkLeft"] == 1.0
    assert likely.sum() == 1.0
    assert not shut_weights(model, face.landmarks(face.state)).any()
    # Wherever the network sees the borders of lids that touch, they shall.
    left = shutters(model, SCHEME)[1]
    assert left is not None
    np.testing.assert_allclose(
        found_by(face, wink).apart.reshape(2, -1)[1], (left.left - PRESSED) / SIGMA_SHARE
    )


@pytest.mark.parametrize(("blink", "least", "most"), [(1.0, -0.02, 0.012), (0.6, 0.1, 0.15)])
def test_a_landmark_stage_brings_lids_together(face: Face, blink: float, least: float, most: float):
    """Points alone left shut eyes open by a twentieth of their width."""
    model, random = face.geometry.model, np.random.default_rng(5)
    true = face.with_weights(eyeBlinkLeft=blink, eyeBlinkRight=blink)
    true = replace(true, identity=0.6 * random.normal(size=len(true.identity)))
    landmarks = face.found(true, random)
    shut = shut_weights(model, landmarks)
    state = face.landmark_stage(landmarks, found_by(face, landmarks), expression_mean=shut)
    there, here = opening(face, true), opening(face, state)
    print(f"true opening {there}, found {here}")
    assert all(least < each < most for each in here)

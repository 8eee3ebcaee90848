"""ARKit's names, as face models write them."""

from __future__ import annotations

from facestage.contract.arkit import ARKIT_NAMES, slider_weights


def test_there_are_52_names():
    assert len(set(ARKIT_NAMES)) == 52


def test_weights_find_the_sliders_whatever_they_are_called():
    weights = {"mouthSmileLeft": 0.5, "browInnerUp": 0.25, "jawOpen": 1.0, "tongueOut": 0.1}
    assert slider_weights(weights, ["mouthSmileLeft", "browInnerUp", "jawOpen"]) == {
        "mouthSmileLeft": 0.5,
        "browInnerUp": 0.25,
        "jawOpen": 1.0,
    }
    assert slider_weights(weights, ["mouthSmile_L", "browInnerUp_L", "browInnerUp_R"]) == {
        "mouthSmile_L": 0.5,
        "browInnerUp_L": 0.25,
        "browInnerUp_R": 0.25,
    }

"""The CSV of Live Link Face."""

from __future__ import annotations

import csv

import numpy as np

from facestage.contract.sequence import SequenceFrame
from facestage.fit.sequence.live_link import WEIGHTS, live_link_csv


def test_weights_of_either_spelling_find_their_column():
    names = [name[0].lower() + name[1:] for name in WEIGHTS if name != "BrowInnerUp"]
    names = [name.replace("Left", "_L") if "eye" in name else name for name in names]
    names += ["browInnerUp_L", "browInnerUp_R", "another"]
    weights = np.zeros((2, len(names)))
    weights[1, names.index("eyeBlink_L")] = 0.75
    weights[1, -3:] = [0.2, 0.4, 1.0]
    frames = [SequenceFrame(1, 0.0, "1", "seen"), SequenceFrame(2, 61.5, "2", "seen")]
    text = live_link_csv(names, weights, frames, np.array([[0, 0, 0], [0.1, 0.2, 0.3]]), 24.0)
    assert text is not None
    first, second = csv.DictReader(text.splitlines())
    assert len(WEIGHTS) == 52 and first["BlendshapeCount"] == "61"
    assert float(second["EyeBlinkLeft"]) == 0.75 and float(first["EyeBlinkLeft"]) == 0
    assert float(second["BrowInnerUp"]) == 0.3 and float(second["HeadPitch"]) == 0.2
    assert second["Timecode"] == "00:01:01:12.000"


def test_a_model_of_another_language_has_none():
    frames = [SequenceFrame(1, 0.0, "1", "seen")]
    assert live_link_csv(["a", "jawOpen"], np.zeros((1, 2)), frames, np.zeros((1, 3)), 24) is None

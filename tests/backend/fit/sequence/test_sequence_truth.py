"""Figures of a sequence against its truth."""

from __future__ import annotations

import numpy as np

from facestage.fit.sequence.sequence_truth import jitter, lag


def test_lag_is_counted_in_frames():
    time = np.arange(80)
    true = np.sin(time / 5) + 0.3 * np.sin(time / 2)
    for late in (-2, 0, 3):
        assert lag([(np.roll(true, late), true)]) == late


def test_jitter_is_of_second_differences():
    still = np.zeros((10, 4, 3))
    moving = still + np.arange(10)[:, None, None] * [1.0, 2.0, 0.0]
    assert jitter(moving) < 1e-12
    assert np.isclose(jitter(np.where(np.arange(10)[:, None, None] % 2, [1.0, 0, 0], still)), 2.0)

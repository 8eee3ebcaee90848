"""Errors against known truth, by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from facestage.fit.given.metrics import aligned_distance, psnr, relative_error, scaled_rmse


@pytest.mark.parametrize("scale", [1.0, 1.07])
def test_alignment_removes_what_it_may_and_nothing_else(scale: float):
    random = np.random.default_rng(0)
    truth = random.normal(size=(200, 3))
    rotation = Rotation.from_rotvec([0.4, -1.2, 0.3]).as_matrix()
    found = scale * truth @ rotation.T + [3, -2, 1]
    similarity = aligned_distance(found, truth, scale=True)
    rigid = aligned_distance(found, truth, scale=False)
    assert similarity.max() < 1e-9
    assert rigid.mean() == pytest.approx(
        (scale - 1) * np.linalg.norm(truth - truth.mean(0), axis=1).mean(), abs=1e-6
    )


def test_alignment_never_mirrors():
    truth = np.random.default_rng(1).normal(size=(50, 3))
    assert aligned_distance(truth * [-1, 1, 1], truth, scale=True).mean() > 0.3


def test_psnr_by_hand():
    truth = np.full((4, 4, 3), 0.5)
    mask = np.ones((4, 4), bool)
    assert psnr(truth + 0.1, truth, mask) == pytest.approx(20.0)
    assert psnr(truth + 9, truth + 7, mask) == pytest.approx(120.0), "both are clipped to 1"
    assert np.isnan(psnr(truth, truth, ~mask))
    half = mask.copy()
    half[:2] = False
    broken = truth + 0.1
    broken[:2] = 99
    assert psnr(broken, truth, half) == pytest.approx(20.0)


def test_scale_is_factored_out():
    truth = np.random.default_rng(2).random((30, 3))
    assert scaled_rmse(3 * truth, truth) == pytest.approx(0, abs=1e-12)
    assert relative_error(0.1 * truth, truth) == pytest.approx(0, abs=1e-12)
    assert relative_error(np.zeros_like(truth), truth) == pytest.approx(1)
    noisy = truth + 0.1
    assert 0 < scaled_rmse(noisy, truth) < 0.1

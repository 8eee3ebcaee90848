"""Spherical harmonics in place of ray-traced lights."""

from __future__ import annotations

import numpy as np

from facestage.bench.harmonics import harmonic_basis, run_harmonics
from facestage.bench.trace import Judge
from facestage.fit.given.problem import Problem
from facestage.fit.given.truth import Truth
from reference.tiny_bench import TINY


def test_basis_of_known_normals():
    values, _ = harmonic_basis(np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]))
    first, second, polar = 2 / np.sqrt(3), np.sqrt(15) / 4, np.sqrt(5) / 8
    np.testing.assert_allclose(values[0], [1, 0, first, 0, 0, 0, 2 * polar, 0, 0], atol=1e-12)
    np.testing.assert_allclose(values[1], [1, 0, 0, first, 0, 0, -polar, 0, second / 2], atol=1e-12)


def test_basis_is_orthogonal_with_the_cosine_lobes_bands():
    normals = np.random.default_rng(0).normal(size=(200_000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    values, _ = harmonic_basis(normals)
    gram = values.T @ values / len(values)
    # Squares of A_l / pi: 1, 2/3, 1/4, times the constant function's own share.
    expected = np.diag([1.0, *[4 / 9] * 3, *[1 / 16] * 5])
    assert np.abs(gram - expected).max() < 0.01


def test_gradients_agree_with_finite_differences():
    normals = np.random.default_rng(1).normal(size=(20, 3))
    _, gradients = harmonic_basis(normals)
    for axis in range(3):
        step = 1e-5 * np.eye(3)[axis]
        numeric = (harmonic_basis(normals + step)[0] - harmonic_basis(normals - step)[0]) / 2e-5
        np.testing.assert_allclose(gradients[:, :, axis], numeric, atol=1e-8)


def test_a_run_explains_the_photo_better_at_its_end(opened: tuple[Problem, Truth, Judge]):
    problem, _, judge = opened
    track = run_harmonics(problem, TINY[2])
    rows = judge.rows("tiny", "harmonics", "Harmonics", track)
    lit = [row.psnr for row in rows if row.psnr is not None]
    print(f"{lit[0]:.2f} dB -> {lit[-1]:.2f} dB")
    assert lit[-1] > lit[0] > 15
    assert all(np.isfinite([row.similarity_mm, row.rigid_mm]).all() for row in rows)
    assert (track.snapshots[-1].state.lights < 0).any()

"""Errors against known truth: geometry after alignment, photometric PSNR, light and albedo."""

from __future__ import annotations

import numpy as np


def aligned_distance(found: np.ndarray, truth: np.ndarray, scale: bool) -> np.ndarray:
    """(n,) distances in metres after the best rigid (or similarity) alignment of ``found`` to ``truth``.

    Both (n, 3), row for row; Umeyama (1991), eqs. 38-42.
    """
    a, b = found - found.mean(0), truth - truth.mean(0)
    u, singular, vt = np.linalg.svd(b.T @ a)
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = (u * sign) @ vt
    factor = float((singular * sign).sum() / max((a**2).sum(), 1e-30)) if scale else 1.0
    return np.linalg.norm(factor * a @ rotation.T - b, axis=1)


def psnr(found: np.ndarray, truth: np.ndarray, mask: np.ndarray) -> float:
    """Peak signal-to-noise ratio in dB inside ``mask``; both images clipped to 0..1, linear."""
    if not mask.any():
        return float("nan")
    difference = np.clip(found[mask], 0, 1) - np.clip(truth[mask], 0, 1)
    return float(-10.0 * np.log10(max(float((difference**2).mean()), 1e-12)))


def scaled_rmse(found: np.ndarray, truth: np.ndarray) -> float:
    """Root mean square error of ``found`` times the best single scale against ``truth``."""
    factor = float((found * truth).sum() / max(float((found**2).sum()), 1e-30))
    return float(np.sqrt(np.mean((factor * found - truth) ** 2)))


def relative_error(found: np.ndarray, truth: np.ndarray) -> float:
    """|found - truth| / |truth| after the best single scale (light and albedo share one)."""
    factor = float((found * truth).sum() / max(float((found**2).sum()), 1e-30))
    return float(np.linalg.norm(factor * found - truth) / max(float(np.linalg.norm(truth)), 1e-30))

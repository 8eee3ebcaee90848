"""Errors against known truth: geometry after alignment, photometric PSNR, light and albedo."""

from __future__ import annotations

import numpy as np

from facestage.models.mesh.similarity import procrustes

# Skin whose brightest percent lies outside this range was not exposed for a display.
DISPLAY_WHITE_MIN, DISPLAY_WHITE_MAX = 0.02, 4.0


def aligned_distance(found: np.ndarray, truth: np.ndarray, scale: bool) -> np.ndarray:
    """(n,) distances in metres after the alignment of :func:`aligned_difference`."""
    return np.linalg.norm(aligned_difference(found, truth, scale), axis=1)


def aligned_difference(found: np.ndarray, truth: np.ndarray, scale: bool) -> np.ndarray:
    """(n, 3) metres, ``found`` less ``truth`` after the best rigid (or similarity) alignment of
    ``found`` to ``truth``.

    Both (n, 3), row for row.
    """
    return procrustes(found, truth, rigid=not scale).apply(found) - truth


def psnr(found: np.ndarray, truth: np.ndarray, mask: np.ndarray, white: float = 1.0) -> float:
    """Peak signal-to-noise ratio in dB inside ``mask``; both images, linear, clipped to
    0..``white``.
    """
    if not mask.any():
        return float("nan")
    difference = np.clip(found[mask] / white, 0, 1) - np.clip(truth[mask] / white, 0, 1)
    return float(-10.0 * np.log10(max(float((difference**2).mean()), 1e-12)))


def white_level(photo: np.ndarray, mask: np.ndarray) -> float:
    """The radiance that :func:`psnr` takes for white: 1, or the brightest skin where the photo has
    other units.

    Against a white of 1, a photo of radiance 10^-6 would be explained perfectly by darkness, and
    one of 10^6 by any light at all.
    """
    bright = float(np.percentile(photo[mask], 99)) if mask.any() else 1.0
    return 1.0 if DISPLAY_WHITE_MIN <= bright <= DISPLAY_WHITE_MAX or bright <= 0 else bright


def scaled_rmse(found: np.ndarray, truth: np.ndarray) -> float:
    """Root mean square error of ``found`` times the best single scale against ``truth``."""
    factor = float((found * truth).sum() / max(float((found**2).sum()), 1e-30))
    return float(np.sqrt(np.mean((factor * found - truth) ** 2)))


def relative_error(found: np.ndarray, truth: np.ndarray) -> float:
    """|found - truth| / |truth| after the best single scale (light and albedo share one)."""
    factor = float((found * truth).sum() / max(float((found**2).sum()), 1e-30))
    return float(np.linalg.norm(factor * found - truth) / max(float(np.linalg.norm(truth)), 1e-30))

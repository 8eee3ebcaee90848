"""What a fit says of itself: a status, and one sentence of what it means and what to do."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from facestage.contract.result import BUDGET_SPENT, CONVERGED, STOPPED
from facestage.contract.skin_tone import skin_type
from facestage.fit.forward.rendering import Picture
from facestage.fit.given.problem import Problem
from facestage.fit.trust.fitted import Fitted
from facestage.fit.trust.guard import INFORMATIVE_SHARE_MIN

# Median distance of the landmarks, as a share of the face's size, beyond which they and the fit
# disagree.
LANDMARK_SHARE_MAX = 0.05
# PSNR in dB on the skin below which a photo counts as poorly explained: a hand and hair over half a
# face leave 22.8, other photographs of faces 28 and more.
PSNR_MIN = 24.0
# Shares of the face that may be hidden: worth a word, and too much to call the rest a face.
HIDDEN_MENTIONED, HIDDEN_MAX = 0.02, 0.6
# Of the skin's red over blue, from which on its deviation is worth a word.
COLOR_MENTIONED = 0.15


def verdict(
    problem: Problem,
    fitted: Fitted,
    picture: Picture,
    errors: Mapping[str, float],
    eyes_told: bool = False,
) -> tuple[str, str]:
    """Status and advice: CONVERGED only when nothing speaks against the fit, then the advice begins
    "Converged:". ``eyes_told``: the eyes are as this or another photo shows them.
    """
    value = errors.get("psnr_skin", np.nan)
    if not fitted.in_time:
        return BUDGET_SPENT, (
            f"The time budget ended before the last step of the schedule (PSNR {value:.1f} dB so "
            "far); give more --budget, or continue with --resume."
        )
    hidden = _hidden_share(fitted, picture)
    against = _against(problem, fitted, picture, errors, hidden)
    if against:
        return STOPPED, against
    hidden_words = (
        f"; {hidden:.0%} of the face is behind something or in its shadow, and was left out"
        if hidden > HIDDEN_MENTIONED
        else ""
    )
    if problem.dark_glass.any() and not eyes_told:
        hidden_words += "; eyes and brows are the model's own, because sunglasses hide them"
    explained = f"the render explains the skin with a PSNR of {value:.1f} dB"
    skin_words = f"{_toned(problem, fitted, errors)}{_uncolored(problem, fitted)}"
    return CONVERGED, f"Converged: {explained}{hidden_words}{skin_words}{_unsupported(fitted)}."


def _toned(problem: Problem, fitted: Fitted, errors: Mapping[str, float]) -> str:
    """What a fit says that had to find out how light the skin is; else empty."""
    tone = errors.get("skin_tone", np.nan)
    if problem.job.skin_tone is not None or fitted.color is None or not np.isfinite(tone):
        return ""
    return f"; the skin came out {skin_type(tone)}, which is a guess (--skin-tone corrects it)"


def _uncolored(problem: Problem, fitted: Fitted) -> str:
    """What a fit says that does not know what is the light's color and what the skin's; else
    empty.
    """
    if problem.photograph.tinted:
        return "; the photo is black and white: its skin has the usual hue"
    doubt = fitted.color
    if doubt is None or doubt.skin < COLOR_MENTIONED:
        return ""
    words = (
        f"; the light's red over blue is known to {doubt.light:.0%} and the skin's to "
        f"{doubt.skin:.0%}, so that the skin may be that much redder or bluer"
    )
    return words if problem.grey is not None else f"{words}: say what is grey (--white-balance)"


def _unsupported(fitted: Fitted) -> str:
    """What a fit says whose photo told next to nothing of the shape, or nothing that it can rely
    on; else empty.
    """
    support = fitted.support
    if support is None or not support.weak:
        return ""
    remedy = "light the face from one side, or fit several photos of the person together"
    if support.little:
        return (
            "; but the photo hardly adds to what the landmarks tell of the shape, which is known "
            f"to {support.photo_mm:.1f} mm with it and {support.landmarks_mm:.1f} mm without: "
            f"{remedy}"
        )
    return (
        "; but the shape may be no better than by landmarks alone: it is known to "
        f"{support.photo_mm:.1f} mm with the photo and {support.landmarks_mm:.1f} mm without, and "
        "of heads outside the face model such fits gained a fifth at most; check the landmarks, "
        f"{remedy}"
    )


def _against(
    problem: Problem, fitted: Fitted, picture: Picture, errors: Mapping[str, float], hidden: float
) -> str:
    """The first thing that speaks against a fit, with a remedy; empty when nothing does."""
    value, pixels = errors.get("psnr_skin", np.nan), errors.get("landmark_px", np.nan)
    share = informative_share(problem, picture)
    if not np.isfinite(pixels):
        return (
            "The fit ended with landmarks behind the camera; check the landmark file and "
            "the focal length."
        )
    if pixels > LANDMARK_SHARE_MAX * problem.face_size_px / problem.window.factor:
        return (
            f"The fit ended with landmarks that are {pixels:.1f} px off (median); check the "
            "landmark file, or free the pose and expression."
        )
    if hidden > HIDDEN_MAX:
        return (
            f"{hidden:.0%} of the face shows none of the shading that these lights must cast on "
            "it, so the shape is the landmarks' own; check the landmarks, lights that are held, "
            "and what stands in front of the face."
        )
    if not np.isfinite(value):
        return (
            "The face covers no usable pixel of the photo; check the landmarks and the "
            "photo's mask."
        )
    if share < INFORMATIVE_SHARE_MIN:
        return (
            f"Only {share:.0%} of the face's pixels say anything, the rest is masked, black or "
            "saturated: shape, skin and light are little more than landmarks and statistics; give "
            "a photo of another exposure, or mask less."
        )
    if fitted.company:
        return fitted.company
    if fitted.doubt:
        return (
            f"The shape is the landmarks' own, because {fitted.doubt}; check the landmarks, and "
            "mask what is not the face with an alpha channel."
        )
    if value < PSNR_MIN:
        return (
            f"The fit explains the photo poorly (PSNR {value:.1f} dB); hair, glasses, strong "
            "make-up or wrong landmarks are the usual reasons: mask them with an alpha channel."
        )
    if fitted.lens is not None and fitted.lens.doubtful:
        return (
            f"The landmarks speak against the given focal length: {fitted.lens.ratio:g} times it "
            f"fits them better (F = {fitted.lens.statistic:.0f}); check the camera, or leave it "
            "out to have the lens fitted."
        )
    if problem.job.weights.prior == 0 and not {"identity", "expression"} <= set(problem.job.freeze):
        return (
            "The statistical prior is off, so what one photo cannot tell, depth above all, is held "
            f"by nothing (PSNR {value:.1f} dB); give the prior a weight above 0."
        )
    if not fitted.settled:
        return (
            "The schedule ended while its steps still changed the fit, or found none that improves "
            f"it (PSNR {value:.1f} dB); the priors may be too weak, or held values contradict the "
            "photo."
        )
    return ""


def informative_share(problem: Problem, picture: Picture) -> float:
    """Share of the rendered skin's pixels where the photo says more than "masked", "black" or
    "saturated".
    """
    photo = problem.photograph
    says = photo.mask & (photo.color > 0).any(axis=2) & ~photo.clipped.all(axis=2)
    return float(says[picture.fitted].mean()) if picture.fitted.any() else 0.0


def _hidden_share(fitted: Fitted, picture: Picture) -> float:
    left_out = (fitted.hidden | fitted.shadowed)[picture.fitted]
    return float(left_out.mean()) if left_out.size else 0.0

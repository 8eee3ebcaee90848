"""What pixels tell of the teeth between the lips: whether they fill what these leave open, and
their color.

If they do, the jaw is not open. Points on the lips cannot tell lips that part before closed teeth
from a jaw that opens. What is seen between them can: teeth are less red than the skin, lips, gums
and tongue are redder, and behind parted teeth it is dark.
"""

from __future__ import annotations

import numpy as np

from facestage.contract.arrays import Bool, Float, Num
from facestage.contract.face_model import FaceModel
from facestage.contract.files.color import REC709
from facestage.contract.landmarks import Landmarks
from facestage.fit.face.unknowns import EXPRESSION_SIGMA
from facestage.fit.given.face_areas import face_size_px, mouth_share
from facestage.fit.given.skin_mask import SURE_SKIN
from facestage.models.anatomy.landmark_schemes import scheme_of

# A tooth's luminance and red over green, and the luminance of what is dark, beside the skin's.
TOOTH_LIGHT, TOOTH_RED, DARK_LIGHT = 0.35, 1.0, 0.3
# Colors made paler or warmer leave teeth hardly less red than skin. What is lighter than skin may
# be a tooth as long as it is no redder than this, more likely the nearer to TOOTH_RED it comes;
# tongues that lie in the light have 1.15 to 1.3.
BRIGHT_LIGHT, BRIGHT_RED = 1.0, 1.2
# Shares of the way between the lips: teeth are seen from the first to the second on, nothing behind
# them from the first to the second down.
TEETH_SHARE, DARK_SHARE = (0.25, 0.4), (0.27, 0.2)
SAMPLES = 24
# Pixels between the lips below which their borders are all that is seen.
OPENING_MIN = 4.0
LIP_SHADOW = 1.0  # pixels below the upper lip that are dark before teeth too
# Among the pixels of teeth, by luminance: those that lips shade least, without what is wet and
# shines. Of a smile they are this share of the face's square at least, and so much lighter than the
# skin: 0.005 to 0.034 and 1.3 to 8 times on 23 photographs; what passes for teeth between lips that
# hardly part, 0.0006 to 0.006 and 0.5 to 1.2.
SHADED_LESS, SHINES_MORE = 0.6, 0.9
SMILE_MIN, SMILE_LIGHT = 0.004, 1.2
# Standard deviation of the weight that opens a jaw whose teeth are seen closed.
CLOSED_SIGMA = 0.04
# Red over green, of the logarithm, above which what belongs to the teeth is gum.
GUM_RED = 0.4
JAW_OPEN = "jawOpen"


def closed_teeth(
    color: Num[np.ndarray, "height width 3"],
    skin: Float[np.ndarray, "height width"],
    landmarks: Landmarks,
) -> float:
    """0 where closed teeth are not seen, to 1; ``color`` is linear, ``skin`` as of
    :func:`facestage.fit.given.skin_mask.skin_weight`.
    """
    ring = scheme_of(landmarks.scheme).openings[0]
    half = len(ring) // 2
    across = np.stack([ring[:half:-1], ring[1:half]], axis=1)
    across = across[len(across) // 3 : len(across) - len(across) // 3]
    bare = color[skin > SURE_SKIN]
    upper, lower = landmarks.points[across].transpose(1, 0, 2)
    shown = landmarks.counted[across].all()
    if not (shown and len(bare) and np.isfinite([upper, lower]).all()):
        return 0.0
    opening = np.linalg.norm(upper - lower, axis=1)
    if opening.min() < OPENING_MIN:
        return 0.0
    way = (np.arange(SAMPLES) + 0.5) / SAMPLES
    points = upper + way[:, None, None] * (lower - upper)
    column, row = np.moveaxis(np.floor(points).astype(int), -1, 0)
    height, width = color.shape[:2]
    if min(column.min(), row.min()) < 0 or column.max() >= width or row.max() >= height:
        return 0.0
    light, red = beside_skin(color[row, column], bare)
    pale = np.interp(red, [TOOTH_RED, BRIGHT_RED], [1.0, 0.0])
    tooth = np.where(light > BRIGHT_LIGHT, pale, 0.0)
    teeth = float(np.maximum(of_teeth(light, red), tooth).mean())
    dark = float((light < DARK_LIGHT).mean() - LIP_SHADOW / opening.mean())
    return _ramp(teeth, *TEETH_SHARE) * _ramp(dark, *DARK_SHARE)


def teeth_color(
    color: Num[np.ndarray, "height width 3"],
    skin: Float[np.ndarray, "height width"],
    landmarks: Landmarks,
    mask: Bool[np.ndarray, "height width"],
) -> Float[np.ndarray, " 3"] | None:
    """Radiance of the teeth that a smile shows, where they are lit best, of a linear ``color`` with
    its ``skin`` as above, within its ``mask``; None where nobody smiles.
    """
    shape = color.shape[0], color.shape[1]
    bare = color[mask & (skin > SURE_SKIN)]
    between = color[mask & (mouth_share(shape, landmarks) == 1)]
    if not (len(bare) and len(between)):
        return None
    light, red = beside_skin(between, bare)
    teeth = between[like_teeth(light, red)]
    if not len(teeth) > SMILE_MIN * face_size_px(landmarks) ** 2:
        return None
    luminance = teeth @ np.array(REC709)
    low, high = np.quantile(luminance, (SHADED_LESS, SHINES_MORE))
    best = teeth[(luminance >= low) & (luminance <= high)].mean(axis=0, dtype=np.float64)
    return np.maximum(best, 1e-6) if beside_skin(best, bare)[0] > SMILE_LIGHT else None


def beside_skin(
    color: Num[np.ndarray, "*points 3"], bare: Num[np.ndarray, "pixels 3"]
) -> tuple[Float[np.ndarray, "*points"], Float[np.ndarray, "*points"]]:
    """Luminance, and red over green, of linear ``color`` beside those of ``bare`` skin's median."""
    usual = np.median(bare, axis=0)
    beside = color.astype(np.float64) / np.maximum(usual, 1e-6)
    luminance = usual * REC709
    light = beside @ (luminance / max(luminance.sum(), 1e-9))
    return light, beside[..., 0] / np.maximum(beside[..., 1], 1e-6)


def of_teeth(
    light: Float[np.ndarray, "*points"], red: Float[np.ndarray, "*points"]
) -> Bool[np.ndarray, "*points"]:
    """What is surely a tooth of that which lips leave open, by what :func:`beside_skin` gives."""
    return (light > TOOTH_LIGHT) & (red < TOOTH_RED)


def like_teeth(
    light: Float[np.ndarray, "*points"], red: Float[np.ndarray, "*points"]
) -> Bool[np.ndarray, "*points"]:
    """What may be a tooth: beside dark or grey skin they are as red, and much lighter."""
    return of_teeth(light, red) | ((light > BRIGHT_LIGHT) & (red < BRIGHT_RED))


def is_gum(log_albedo: Float[np.ndarray, "*vertices 3"]) -> Bool[np.ndarray, "*vertices"]:
    """Of that which belongs to a model's teeth."""
    return log_albedo[..., 0] - log_albedo[..., 1] > GUM_RED


def expression_deviations(model: FaceModel, closed: float) -> Float[np.ndarray, " expressions"]:
    """Standard deviations of the weights of ``model`` in a photo that shows ``closed`` teeth, 0 to
    1.
    """
    opens = np.array([name == JAW_OPEN for name in model.expression_names], bool)
    return EXPRESSION_SIGMA * (CLOSED_SIGMA / EXPRESSION_SIGMA) ** (closed * opens)


def _ramp(value: float, none: float, full: float) -> float:
    return float(np.clip((value - none) / (full - none), 0.0, 1.0))

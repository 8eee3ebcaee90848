"""Which pixels show hair, or a hat, where they have a skin's color: blond hair is a tan's, brown
hair that of a cheek in shadow.

No color of its own tells it then, but two things do: where it is, and what else is there. Two
mixtures of Gaussians, of the face and of all around it, are learnt from this photo alone, in color
and in how rough it is from pixel to pixel, each pixel counting to either by where it lies and, in
turn, by what they say (expectation-maximisation, as in Carson et al. 2002; GrabCut's hard labels
start from colors, and end there). What is the surroundings' then, and reaches the face from
outside, hides it. A hairline where nothing changes is none: the forehead goes on.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter, label

from facestage.contract.landmarks import Landmarks
from facestage.fit.given.face_areas import (
    above_brows,
    brow_pixels,
    chin_to_brows,
    face_size_px,
    hull_pixels,
    opening_share,
    with_forehead,
)
from facestage.fit.given.hairline import STEP_MIN, hairline_step
from facestage.fit.given.mixture import Mixture
from facestage.images.opencv import opencv

# Lengths are in ways from chin to brows, if they are not pixels.
# Where hair begins above the brows: usually, and where no hairline is seen there, as on a bald
# head; how far from that border what is seen is as likely one as the other, times e.
FOREHEADS, BORDER = (0.3, 0.6, 0.9), 0.065
# How far around that the surroundings are learnt, and how far up and down.
AROUND, BELOW_CHIN = 0.35, -1.0
# Beside and below the jaw lies the neck, which is skin and is no face, and beside the cheeks, so
# far down from here and so far out, lie ears.
NECK, EARS_TOP, EARS_OUT = -0.55, 0.05, 0.25
# Cheeks and chin are the face's: by how much more likely, of the logarithm, from where down.
CHEEK_LOG, CHEEK = 2.0, -0.3
# Bounds of the logarithm of the odds that the place alone gives, and that place and look give.
PLACE_MAX, LOOK_MAX = 5.0, 6.0
# The surroundings are learnt up to this far within the border, the face as far outside of it.
OVERLAP = 0.03
# Gaussians of a face and of what is around it: a wall, hair in light and in shadow, cloth.
FACE_PARTS, OTHER_PARTS = 3, 4
# Least standard deviations of a part in (log red/green, log blue/green, log luminance, roughness).
LEAST = np.array([0.03, 0.03, 0.06, 0.15])
# Brightness over the face's median tells little: highlights. It counts up to about this much.
BRIGHT = 0.15
# Roughness: logarithm of the deviation of log luminance from its blurred self, within a window;
# widths of both in pixels, and what no photo is smoother than.
FINE_PX, WINDOW_PX, SMOOTH = 2.0, 3.0, 0.01
# Pixels that colors are smoothed by, and as far as the odds are, along edges: radius in pixels,
# variance of an edge (guided filter, He et al. 2013).
COLOR_PX, EDGE_PX, EDGE_VARIANCE = 1.0, 16, 0.02
# Pixels that are learnt from at most; of the surroundings at least.
SAMPLES, OTHER_MIN = 7000, 0.02
# Steps of learning: of the face alone, from what is not like it, and of both.
STEPS, FACE_STEPS, BOTH_STEPS = 3, 5, 8
# How much broader than all that is seen the unlike is.
UNLIKE = 1.5
# The face's size in pixels below which strands are too fine to see.
FACE_MIN = 80.0


def hair_pixels(looks: np.ndarray, landmarks: Landmarks) -> np.ndarray:
    """(h, w) bool, what hides the face from outside, in whatever color.

    ``looks`` (h, w, 3) float32: log red/green, log blue/green and log luminance, 0 for the median
    of the face, highlights given the hue of its skin.
    """
    height, width = looks.shape[:2]
    up = chin_to_brows(landmarks)
    length = float(np.linalg.norm(up))
    if not (length > 1.0 and face_size_px(landmarks) >= FACE_MIN):
        return np.zeros((height, width), bool)
    part = _around((height, width), landmarks, (AROUND + 0.1) * length)
    low = np.array([part[1].start, part[0].start])
    near = Landmarks(landmarks.scheme, landmarks.points - low, landmarks.visible)
    result = np.zeros((height, width), bool)
    features = _features(looks[part])
    shape = (features.shape[0], features.shape[1])
    height_up = above_brows(shape, near)
    for forehead in FOREHEADS:
        within = _within(shape, near, forehead, length)
        result[part] = _outside(features, near, within, height_up)
        if hairline_step(result[part], features, within, height_up, up) >= STEP_MIN:
            break
    return result


def _outside(
    features: np.ndarray, landmarks: Landmarks, within: np.ndarray, height: np.ndarray
) -> np.ndarray:
    """(h, w) bool, whose ``features`` (h, w, 4) are those of what is not ``within`` the face."""
    cv2 = opencv()
    shape = (features.shape[0], features.shape[1])
    cheek = np.where(within > -0.02, CHEEK_LOG * np.clip(height / CHEEK, 0, 1), 0.0)
    place = np.clip(within / BORDER + cheek, -PLACE_MAX, PLACE_MAX).astype(np.float32)
    learnt = (within > -AROUND) & (height > BELOW_CHIN) & ~((height < NECK) & (within < 0))
    learnt &= ~((height < EARS_TOP) & (within < 0) & (within > -EARS_OUT))
    learnt &= (opening_share(shape, landmarks) < 0.2) & ~brow_pixels(shape, landmarks)
    chosen = np.flatnonzero(learnt)
    chosen = chosen[:: max(1, len(chosen) // SAMPLES)]
    flat = features.reshape(-1, features.shape[-1])
    models = _learnt(flat[chosen], place.ravel()[chosen], within.ravel()[chosen])
    if models is None:
        return np.zeros(shape, bool)
    face, other = models
    look = (face.log_density(flat) - other.log_density(flat)).reshape(shape)
    odds = np.clip(look + place, -LOOK_MAX, LOOK_MAX).astype(np.float32)
    guide = np.ascontiguousarray(features[..., :3], np.float32)
    odds = cv2.ximgproc.guidedFilter(guide, odds, EDGE_PX, EDGE_VARIANCE)
    regions, count = label(odds < 0)
    reaching = np.zeros(count + 1, bool)
    reaching[np.unique(regions[within < 0])] = True
    reaching[0] = False
    return reaching[regions]


def _learnt(
    samples: np.ndarray, place: np.ndarray, within: np.ndarray
) -> tuple[Mixture, Mixture] | None:
    """The mixtures of the face and of its surroundings; None where hardly any surroundings are
    seen. ``samples`` (n, 4) lie ``within`` (n,) the border, with ``place`` (n,) for their odds.
    """
    floor = LEAST**2
    of_face, of_other = within > -OVERLAP, within < OVERLAP
    share = _logistic(place)
    if (of_other * (1 - share)).sum() < OTHER_MIN * len(samples):
        return None
    # A bald scalp lies outside the border and looks as the face does: it is the face's before the
    # surroundings are learnt.
    face = Mixture.spread(samples, share * of_face, FACE_PARTS, floor)
    face = face.stepped(samples, share * of_face, STEPS)
    every = np.ones(len(samples))
    unlike = Mixture.spread(samples, every, 1, floor).stepped(samples, every)
    unlike = Mixture(unlike.shares, unlike.means, unlike.covariances * UNLIKE, floor)
    for _ in range(FACE_STEPS):
        share = _logistic(face.log_density(samples) - unlike.log_density(samples) + place)
        face = face.stepped(samples, share * of_face)
    if (of_other * (1 - share)).sum() < OTHER_MIN * len(samples):
        return None
    other = Mixture.spread(samples, (1 - share) * of_other, OTHER_PARTS, floor)
    other = other.stepped(samples, (1 - share) * of_other, STEPS)
    for _ in range(BOTH_STEPS):
        share = _logistic(face.log_density(samples) - other.log_density(samples) + place)
        face = face.stepped(samples, share * of_face)
        other = other.stepped(samples, (1 - share) * of_other)
    return face, other


def _features(looks: np.ndarray) -> np.ndarray:
    """(h, w, 4) colors and roughness."""
    fine = looks[..., 2] - gaussian_filter(looks[..., 2], FINE_PX)
    rough = np.log(np.sqrt(np.maximum(gaussian_filter(fine**2, WINDOW_PX), 0)) + SMOOTH)
    result = np.empty((*looks.shape[:2], 4), np.float32)
    result[..., :3] = gaussian_filter(looks, (COLOR_PX, COLOR_PX, 0))
    bright = np.maximum(result[..., 2], 0)
    result[..., 2] += BRIGHT * np.tanh(bright / BRIGHT) - bright
    result[..., 3] = rough
    return result


def _within(
    shape: tuple[int, int], landmarks: Landmarks, forehead: float, length: float
) -> np.ndarray:
    """(h, w) how far inside the face with such a ``forehead``, negative outside."""
    cv2 = opencv()
    face = hull_pixels(shape, with_forehead(landmarks, forehead)).astype(np.uint8)
    inside = cv2.distanceTransform(face, cv2.DIST_L2, 5)
    return (inside - cv2.distanceTransform(1 - face, cv2.DIST_L2, 5)) / np.float32(length)


def _around(shape: tuple[int, int], landmarks: Landmarks, margin: float) -> tuple[slice, slice]:
    """The rows and columns of the face and ``margin`` pixels around it."""
    points = with_forehead(landmarks, FOREHEADS[-1])
    low = np.nanmin(points, axis=0) - margin
    high = np.nanmax(points, axis=0) + margin
    left, top = np.clip(np.floor(low), 0, [shape[1] - 1, shape[0] - 1]).astype(int)
    right, bottom = np.clip(np.ceil(high), [left + 1, top + 1], [shape[1], shape[0]]).astype(int)
    return slice(int(top), int(bottom)), slice(int(left), int(right))


def _logistic(odds: np.ndarray) -> np.ndarray:
    return np.asarray(1 / (1 + np.exp(-np.clip(odds, -30, 30))))

"""Where a photo shows a beard: below the nose, rough as strands are where skin and shadows on it
are smooth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter, label

from facestage.contract.arrays import Bool, Float, Num
from facestage.contract.landmarks import Landmarks
from facestage.fit.given.face_areas import (
    above_brows,
    around_mouth,
    below_mouth,
    face_pixels,
    face_size_px,
    hull_pixels,
    no_larger,
    opening_share,
)
from facestage.images.image_io import resize
from facestage.images.opencv import opencv
from facestage.models.anatomy.landmark_schemes import scheme_of

# The face's size in pixels beyond which it is looked at smaller, and below which strands are too
# fine to see.
LOOKED_AT_PX, FACE_MIN = 256.0, 120.0
# Where the nose ends, in ways from chin to brows above the brows.
NOSE_ENDS = -0.45
# The deviation of log luminance from its blurred self, within a window, both in pixels, over that
# of a quarter of the face's bare skin: 1.0 to 1.9 in the middle of 23 beardless faces (at the 90th
# percentile 1.7 to 6.7: folds, rims), 2.4 to 4.4 between the quartiles of five beards.
FINE_PX, WINDOW_PX, SMOOTH = 2.0, 3.0, 0.02
NONE, SURE = 2.0, 3.0
# Added to the radiance before its logarithm, as a share of the face's median.
DARK_SHARE = 0.1
# Between the lips the darkest meets the lightest: how far around nothing is told, in shares of the
# face.
LIPS = 0.02
# Luminance over that of bare skin, below which hair covers the skin; the mean over some hairs, as
# deviation in shares of the face; the share of the chin below which it is the lower lip's shadow
# (0.13 and 0.17 on two photographs of a goatee, at most 0.09 on 29 without).
COVERS, HAIRS, OF_CHIN = 0.5, 0.01, 0.1
# What is narrower, as a share of the face, is a border, a fold or a nostril.
WIDTH = 0.08


@dataclass(frozen=True)
class Beard:
    """What a photo shows of one."""

    # 0..1, how surely a pixel, if it is darker than the skin, shows hair of a beard
    share: Float[np.ndarray, "height width"]
    # hair on the chin so much darker than the face that it covers the skin
    covers: Bool[np.ndarray, "height width"]


def beard_of(photo: Num[np.ndarray, "height width 3"], landmarks: Landmarks) -> Beard:
    """The beard of the face with such ``landmarks`` in a linear ``photo``."""
    height, width = photo.shape[:2]
    if not face_size_px(landmarks) >= FACE_MIN:
        return Beard(np.zeros((height, width)), np.zeros((height, width), bool))
    size, smaller = no_larger(landmarks, (height, width), LOOKED_AT_PX)
    small = resize(photo, *size)
    share = _share(small, smaller)
    covers = _covers(small, share, smaller)
    share, covering = (resize(each.astype(np.float32), width, height) for each in (share, covers))
    return Beard(np.clip(share, 0.0, 1.0).astype(np.float64), covering > 0.5)


def _share(photo: np.ndarray, landmarks: Landmarks) -> np.ndarray:
    cv2 = opencv()
    shape, face_px = (photo.shape[0], photo.shape[1]), face_size_px(landmarks)
    bare = hull_pixels(shape, landmarks.points[scheme_of(landmarks.scheme).skin])
    height = above_brows(shape, landmarks)
    if not bare.any() or not np.isfinite(height).all():
        return np.zeros(shape)
    luminance = np.maximum(photo.mean(axis=2), 0.0)
    dark = max(DARK_SHARE * float(np.median(luminance[bare])), 1e-9)
    looks = np.log(luminance + dark)
    fine = looks - gaussian_filter(looks, FINE_PX)
    rough = np.sqrt(gaussian_filter(fine**2, WINDOW_PX))
    usual = max(float(np.quantile(rough[bare], 0.25)), SMOOTH)
    lips = (opening_share(shape, landmarks) > 0.1).astype(np.float32)
    beside = gaussian_filter(lips, LIPS * face_px) > 0.1
    where = face_pixels(shape, landmarks) & (height < NOSE_ENDS) & ~beside
    share = np.where(where, np.clip((rough / usual - NONE) / (SURE - NONE), 0.0, 1.0), 0.0)
    side = 2 * max(round(0.5 * WIDTH * face_px), 1) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    # Among strands there is always a smooth place; around all of them hair goes on a little.
    filled = cv2.morphologyEx(share.astype(np.float32), cv2.MORPH_CLOSE, disc)
    wide = cv2.morphologyEx(np.where(where, filled, 0.0), cv2.MORPH_OPEN, disc)
    found = np.minimum(filled, cv2.dilate(wide, disc))
    # Beards grow around the mouth; what is rough beside a cheek alone is the head's own hair.
    regions, count = label(found > 0)
    around = np.isin(np.arange(count + 1), regions[around_mouth(shape, landmarks)])
    return np.where(around[regions], found, 0.0)


def _covers(photo: np.ndarray, share: np.ndarray, landmarks: Landmarks) -> np.ndarray:
    shape = photo.shape[0], photo.shape[1]
    nothing = np.zeros(shape, bool)
    if not share.any():
        return nothing
    bare = hull_pixels(shape, landmarks.points[scheme_of(landmarks.scheme).skin])
    chin = below_mouth(shape, landmarks)
    luminance = gaussian_filter(photo.mean(axis=2), HAIRS * face_size_px(landmarks))
    covered = chin & (share > 0.5) & (luminance < COVERS * np.median(luminance[bare]))
    return covered if covered.sum() > OF_CHIN * chin.sum() else nothing

"""Black-and-white photographs, which say nothing of hue.

Taken at their word, they show grey skin, or skin as it is in blue light; whites of eyes and relit
skin come out blue and yellow then. Instead the face is given the hue that skin has in white light,
and the fit goes on as with any photo: what a result says of hue is that of usual skin.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from facestage.contract.files.color import REC709
from facestage.contract.landmarks import Landmarks
from facestage.fit.given.face_areas import opening_share
from facestage.images.image_io import Photograph

# Linear red, green and blue of a luminance of 1: the median of the built-in head's skin, 1 % from
# that of ICT-FaceKit.
SKIN_HUE = np.array([1.4727, 0.8921, 0.6765])
# How far red and blue of most pixels may be from green, as toned paper and old film have it, and
# what part of the pixels those are. Skin in color is redder than green by 0.3 and more.
GREY_LOG, GREY_SHARE = np.array([0.06, 0.2]), 0.98
# Radiance below which a pixel has no hue, as a share of the brightest percent.
DARK = 0.05
PIXELS = 100_000  # that are looked at


def is_black_and_white(photograph: Photograph) -> bool:
    """Whether all of a photo has one hue, that of grey."""
    color = photograph.color[photograph.mask]
    color = color[:: max(1, len(color) // PIXELS)]
    if not len(color):
        return False
    light = color[color.min(axis=1) > DARK * np.percentile(color, 99)]
    if not len(light):
        return False
    away = np.abs(np.log(light[:, [0, 2]] / light[:, 1:2]))
    return bool(np.mean((away < GREY_LOG).all(axis=1)) >= GREY_SHARE)


def as_seen_in_color(photograph: Photograph, landmarks: Landmarks) -> Photograph:
    """The photo itself, or a black-and-white one in the hue of skin, ``tinted``; what shows between
    the lids and between the lips stays grey.
    """
    if not is_black_and_white(photograph):
        return photograph
    height, width = photograph.mask.shape
    skin = (1.0 - opening_share((height, width), landmarks))[..., None]
    tint = 1.0 + skin * (SKIN_HUE - 1.0)
    grey = photograph.color @ np.array(REC709)
    color = (grey[..., None] * tint).astype(np.float32)
    space = f"{photograph.color_space}; black and white, in the usual hue of skin"
    return replace(photograph, color=color, color_space=space, tinted=True)

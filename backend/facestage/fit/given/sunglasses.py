"""Which pixels sunglasses hide: what is no skin from below one eye, over the nose, to below the
other.

Dark glass has no frame that a line could be followed along, and its upper edge passes for brows.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import binary_fill_holes, label

from facestage.contract.arrays import Bool, Float
from facestage.contract.landmarks import Landmarks
from facestage.fit.given.face_areas import face_size_px
from facestage.fit.given.spectacles import FACE_MIN, FACE_PX, REACH, Eyes, with_rim
from facestage.images.image_io import resize

# In widths of an eye: how far around and from how far below its middle glass is looked for.
AROUND, BELOW = 0.85, 0.15
# Share of that, below either eye, that one region hides: at most 0.18 without sunglasses (30
# rendered faces, one with a frame, and 24 photographs: 0 in all but two), 0.99 with them.
HIDDEN_MIN = 0.6


def sunglasses(
    skin: Float[np.ndarray, "height width"], landmarks: Landmarks
) -> Bool[np.ndarray, "height width"]:
    """Where they are; nowhere on a face without any. ``skin`` as of
    :func:`facestage.fit.given.skin_mask.skin_weight`.
    """
    result = np.zeros(skin.shape, bool)
    size, eyes = face_size_px(landmarks), Eyes.of(landmarks)
    if eyes is None or size < FACE_MIN:
        return result
    window = eyes.window((skin.shape[1], skin.shape[0]), min(1.0, FACE_PX / size))
    if window is None:
        return result
    left, top, right, bottom = window.box
    near = resize(np.ascontiguousarray(skin[top:bottom, left:right], np.float32), *window.size)
    found = _hiding(near < 0.5, eyes.in_window(window))
    return with_rim(found, window, size)


def _hiding(
    other: Bool[np.ndarray, "height width"], eyes: Eyes
) -> Bool[np.ndarray, "height width"]:
    """What of ``other`` than skin is glasses."""
    shape = (other.shape[0], other.shape[1])
    row, column = np.indices(shape)
    place = np.stack([column, row], axis=-1) + 0.5
    bridge, ends = eyes.bridge(place)
    regions, _ = label(other)
    crossing = np.intersect1d(regions[bridge & ends[0]], regions[bridge & ends[1]])
    hiding = np.isin(regions, crossing[crossing > 0])
    distance = eyes.distance(place)
    for middle, far in zip(eyes.middles, distance, strict=True):
        below = (far < AROUND) & ((place - middle) @ -eyes.up > BELOW * eyes.width)
        if not below.any() or hiding[below].mean() < HIDDEN_MIN:
            return np.zeros(shape, bool)
    # What mirrors in them is part of them.
    return np.asarray(binary_fill_holes(hiding & (distance.min(axis=0) < REACH)))

"""Squares of a photo as the networks want them: sRGB in 0..1, resampled without aliasing."""

from __future__ import annotations

from functools import cached_property
from threading import Lock

import numpy as np

from facestage.contract.files.color import linear_to_srgb
from facestage.images.image_io import Photograph, resize
from facestage.images.opencv import opencv
from facestage.landmarks.crop import Crop

# Each sample of a view is the mean of so many squared samples of the photo.
SUPERSAMPLES = 2
# Share of the pixels that may be brighter than white once a picture is exposed.
HIGHLIGHTS = 0.02
STOPS_MIN = 0.7  # factors of two
CODES = 4096


class PhotoViews:
    """Samples squares of a photograph; halved copies of it are made when they are first needed."""

    def __init__(self, photograph: Photograph) -> None:
        self.photograph = photograph
        self.width, self.height = photograph.size
        unmasked = photograph.mask.all()
        color = photograph.color if unmasked else photograph.color * photograph.mask[..., None]
        self._levels = [color.astype(np.float32, copy=False)]
        self._halving = Lock()  # a square and its mirror image are sampled at once
        # Multiplies the linear color; a picture that a display shows as it is stays so.
        self.gain = 1.0 if self._levels[0].max(initial=0.0) <= 1.0 else self.exposure_gain

    def gains(self) -> list[float]:
        """The exposures to try: the picture's own, and one that brightens it where that makes a
        difference.
        """
        other = self.exposure_gain
        return [self.gain] if abs(np.log2(other / self.gain)) < STOPS_MIN else [self.gain, other]

    @cached_property
    def exposure_gain(self) -> float:
        """The factor that makes the brightest pixels, but a few, white; 1 for a black picture."""
        level = self._level(max(0, int(np.log2(max(self.width, self.height) / 512 + 1e-9))))
        white = float(np.quantile(level.max(axis=2), 1.0 - HIGHLIGHTS))
        return 1.0 / white if white > 0 else 1.0

    def _level(self, number: int) -> np.ndarray:
        """The linear picture halved ``number`` times."""
        with self._halving:
            while len(self._levels) <= number:
                last = self._levels[-1]
                height, width = max(1, (last.shape[0] + 1) // 2), max(1, (last.shape[1] + 1) // 2)
                self._levels.append(resize(last, width, height))
            return self._levels[number]

    def sample(self, crop: Crop, size: int, repeat_border: bool) -> np.ndarray:
        """(size, size, 3) float32 sRGB in 0..1 of ``crop``; outside the photo black, or its border
        repeated.
        """
        cv2 = opencv()
        fine = size * SUPERSAMPLES
        step = crop.side / fine
        # Between one and two pixels of the level per sample: bilinear weights then skip none.
        level = self._level(max(0, int(np.floor(np.log2(max(step, 1.0))))))
        scale = np.array([level.shape[1] / self.width, level.shape[0] / self.height])
        axes = crop.axes / fine * scale[:, None]
        # OpenCV counts from the first pixel's centre, the contract from its corner.
        origin = crop.to_photo(np.zeros(2)) * scale + axes @ [0.5, 0.5] - 0.5
        border = cv2.BORDER_REPLICATE if repeat_border else cv2.BORDER_CONSTANT
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        warped = cv2.warpAffine(
            level, np.column_stack([axes, origin]), (fine, fine), flags=flags, borderMode=border
        )
        linear = resize(warped, size, size) * np.float32(self.gain)
        return _encode(linear)


_TABLE = linear_to_srgb((np.arange(CODES) / (CODES - 1)) ** 2).astype(np.float32)


def _encode(linear: np.ndarray) -> np.ndarray:
    """sRGB of linear color, from a table over its square root, which has no dark gap."""
    root = np.sqrt(np.clip(linear, 0.0, 1.0))
    return np.asarray(_TABLE[(root * np.float32(CODES - 1) + np.float32(0.5)).astype(np.int32)])

"""The fitted head under each light alone: what relighting needs, summed up while a picture is
traced.
"""

from __future__ import annotations

import numpy as np

from facestage.contract.arrays import Float, Int
from facestage.contract.camera import Camera
from facestage.contract.relight_cache import RelightCache
from facestage.fit.forward.reflectance import Skin
from facestage.fit.forward.scattering import Spread
from facestage.render.light_terms import LightTerms

# Numbers that the images may hold (pixels of the head's bounding box x lights x 3 channels): 80 MB
# as half floats, and a product that stays well below a thirtieth of a second. Larger photos are
# relit at a smaller size.
NUMBERS_MAX = 4e7


class OneLightImages:
    """The head under each light alone at radiance 1, summed up sub-pixel by sub-pixel.

    Albedo, c_spec and irradiance vary together within a pixel: only their product may be averaged.
    """

    def __init__(self, camera: Camera, pixels: Int[np.ndarray, "pixels 2"], lights: int) -> None:
        """``pixels`` columns and rows of the head's bounding box, row by row."""
        self.pixels = pixels[:, 1] * camera.width + pixels[:, 0]  # ascending
        self.colors = np.zeros((3, len(pixels), lights), np.float32)
        self._corner = pixels.min(axis=0, initial=camera.width + camera.height)
        self._box_width = int(np.ptp(pixels[:, 0])) + 1 if len(pixels) else 0

    def add(
        self,
        x: Int[np.ndarray, " points"],
        y: Int[np.ndarray, " points"],
        share: float,
        terms: LightTerms,
        skin: Skin,
        spread: Spread | None = None,
    ) -> None:
        """Add ``share`` of what the pixels (``x``, ``y``) (p,) see; ``spread``: below the skin."""
        place = (y - self._corner[1]) * self._box_width + x - self._corner[0]
        images = skin.dimmed(share).by_light(
            terms.diffuse,
            terms.specular,
            np.float32,
            indirect=terms.indirect,
            scattered=None if spread is None else spread.by_light(terms.diffuse),
        )
        for color, image in zip(self.colors, images, strict=True):
            color[place] += image

    def cache(
        self, coverage: Float[np.ndarray, "height width"], samples: int, fingerprint: str
    ) -> RelightCache:
        """The images as a file's contents; ``coverage`` says which pixels see the head."""
        height, width = coverage.shape
        seen = coverage.ravel()[self.pixels] > 0
        images = np.stack([channel[seen].T for channel in self.colors])
        return RelightCache.of_images(
            width,
            height,
            self.pixels[seen],
            coverage.ravel()[self.pixels[seen]],
            images,
            samples,
            fingerprint,
        )


def relight_scale(pixels: int, lights: int, numbers_max: float = NUMBERS_MAX) -> float:
    """The factor, at most 1, on the photo's size at which ``pixels`` of the head's box fit the
    memory.
    """
    return min(1.0, float(np.sqrt(numbers_max / max(3 * pixels * lights, 1))))

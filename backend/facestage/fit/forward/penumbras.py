"""More shadow rays where single ones differ from pixel to pixel: in penumbras, and at folds."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from facestage.contract.arrays import Bool, Float, Int
from facestage.contract.light_stage import LightStage
from facestage.fit.face.state import State
from facestage.fit.forward.shading import ForwardModel, Surface
from facestage.images.opencv import opencv
from facestage.render.light_terms import LightTerms

# Deviation of a light among neighbors from which on it is grainy, as a share of all light there in
# one of the pictures; and the least light that counts, as a share of what skin gets that faces it.
GRAIN, DARK = 0.015, 0.2
NEIGHBORS = 5  # pixels across
CHANNELS = 512  # that OpenCV takes at a time
# What the surface sends on, over what comes from below it, of ordinary skin.
GLOSS = 6.0


@dataclass(frozen=True)
class Penumbras:
    """Looks for grainy light, and traces it again."""

    forward: ForwardModel
    state: State
    stage: LightStage  # camera frame
    radiances: Float[np.ndarray, "pictures lights"]  # of the pictures that are made
    samples: int  # shadow rays for a grainy light of a pixel

    def smoothed(
        self,
        terms: LightTerms,
        surface: Surface,
        seed: int,
        roughness: Float[np.ndarray, " pixels"] | None,
    ) -> LightTerms:
        """``terms`` of the surface, whose pixels are neighbors (such as rows of a picture), with
        more rays where they are grainy; see :meth:`ForwardModel.light_terms`.
        """
        # Light by light, so that rays one after another are alike.
        lights, points = np.nonzero(self.grainy(terms, surface.pixels.astype(int)).T)
        if not len(points):
            return terms
        again = self.forward.light_terms(
            self.state,
            surface,
            self.stage,
            self.samples,
            seed,
            pairs=(points, lights),
            roughness=roughness,
        )
        diffuse, specular = np.array(terms.diffuse), np.array(terms.specular)
        diffuse[points, lights] = again.diffuse[:, 0]
        specular[points, lights] = again.specular[:, 0]
        return replace(terms, diffuse=diffuse, specular=specular)

    def grainy(
        self, terms: LightTerms, pixels: Int[np.ndarray, "pixels 2"]
    ) -> Bool[np.ndarray, "pixels lights"]:
        """Which lights deviate among the neighbors of a pixel."""
        x, y = (pixels - pixels.min(axis=0)).T
        shape = int(y.max()) + 1, int(x.max()) + 1

        def total(values: np.ndarray) -> np.ndarray:
            image = np.zeros((*shape, values.shape[1]), np.float32)
            image[y, x] = values
            return box_sums(image, NEIGHBORS)[y, x]

        count = total(np.ones((len(x), 1)))
        light = terms.diffuse + GLOSS * terms.specular
        mean = total(light) / count
        deviation = np.sqrt(np.maximum(total(light**2) / count - mean**2, 0.0))
        facing = self._facing().astype(np.float32)
        grainy = np.zeros(deviation.shape, bool)
        for radiance in self.radiances.astype(np.float32):
            whole = np.maximum(mean @ radiance, DARK * (facing @ radiance))
            grainy |= deviation * radiance > GRAIN * whole[:, None]
        return grainy

    def _facing(self) -> Float[np.ndarray, " lights"]:
        """Irradiance at unit radiance of skin, where the head is, that faces each light."""
        offset = self.state.translation - self.stage.position
        distance = np.linalg.norm(offset, axis=1)
        cosine = np.einsum("lx,lx->l", offset, self.stage.direction) / distance
        return np.asarray(self.stage.side**2 * np.maximum(cosine, 0.0) / distance**2)


def box_sums(
    image: Float[np.ndarray, "rows columns channels"], size: int
) -> Float[np.ndarray, "rows columns channels"]:
    """Sums over ``size`` x ``size`` pixels, with nothing beyond the border."""
    cv2 = opencv()
    parts = [
        cv2.boxFilter(
            np.ascontiguousarray(image[..., first : first + CHANNELS]),
            -1,
            (size, size),
            normalize=False,
            borderType=cv2.BORDER_CONSTANT,
        ).reshape(*image.shape[:2], -1)
        for first in range(0, image.shape[2], CHANNELS)
    ]
    return np.concatenate(parts, axis=2)

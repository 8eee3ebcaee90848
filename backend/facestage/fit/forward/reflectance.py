"""What skin makes of light: from irradiance to radiance, and its derivatives.

The formula is contract/brdf.py's; here it is applied to pixels, and nowhere else in the fit. Light
comes as what the tracer integrates over the lights: ``irradiance``, of (n.l), and ``lobe``, of
(n.l) D V F. Radiance is linear in both, so that any derivative of theirs becomes one of radiance by
the same functions.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from facestage.contract import brdf
from facestage.contract.arrays import Float, Shaped
from facestage.contract.scattering import emerging
from facestage.fit.face.light_parameters import CHANNELS

# Eyes and teeth are wet: tears or saliva. A real lamp is one sharp spot on an eye; the few of the
# stage that stand for it are larger, and a cornea is more curved than the mesh. So they are dimmed,
# and on eyes as sharp as few shadow rays allow: at the teeth's roughness they veil an iris by as
# much light as all that a dark one sends back.
WET_SPECULAR, WET_ROUGHNESS = 0.5, 0.3
EYE_SPECULAR, EYE_ROUGHNESS = 0.35, 0.1
# What the surface reflects of light that comes from everywhere alike, at c_spec = 1: what does not
# enter the skin (contract/brdf.py).
UNIFORM = 1.0 - brdf.K_DIFFUSE


@dataclass(frozen=True)
class Skin:
    """Reflectance of P points; the roughness is in the lobe."""

    albedo: Float[np.ndarray, "points 3"]  # 0..ALBEDO_MAX
    c_spec: Float[np.ndarray, " points"]  # 0..SPECULAR_MAX
    # how unevenly light comes out from below (contract/scattering.py); None: evenly
    excess: Float[np.ndarray, "points 3"] | None = None

    def part(self, where: Shaped[np.ndarray, " _"] | slice) -> Skin:
        """Some of the points (a mask, indices or a slice)."""
        excess = None if self.excess is None else self.excess[where]
        return Skin(self.albedo[where], self.c_spec[where], excess)

    def dimmed(self, share: float) -> Skin:
        """Skin that sends back ``share`` of the light."""
        return Skin(share * self.sent, share * self.c_spec)

    @property
    def sent(self) -> Float[np.ndarray, "points 3"]:
        """The albedo of opaque skin that sends as much to the viewer."""
        return (
            self.albedo if self.excess is None else self.albedo * emerging(self.albedo, self.excess)
        )

    def matte(
        self, irradiance: Float[np.ndarray, "points ..."]
    ) -> Float[np.ndarray, "points 3 ..."]:
        """Radiance from below the surface; ``irradiance`` (P, 3, ...)."""
        return brdf.matte(_beside(self.sent, irradiance), irradiance)

    def gloss(self, lobe: Float[np.ndarray, "points ..."]) -> Float[np.ndarray, "points ..."]:
        """Radiance from the surface; ``lobe`` (P, 3, ...)."""
        return brdf.gloss(_beside(self.c_spec, lobe), lobe)

    def radiance(
        self, irradiance: Float[np.ndarray, "points ..."], lobe: Float[np.ndarray, "points ..."]
    ) -> Float[np.ndarray, "points 3 ..."]:
        """Radiance towards the viewer; both (P, 3, ...), or (P, 1, ...) for white light."""
        return self.matte(irradiance) + self.gloss(lobe)

    def by_light(
        self,
        irradiance: Float[np.ndarray, "points ..."],
        lobe: Float[np.ndarray, "points ..."],
        dtype: DTypeLike = np.float64,
        *,
        indirect: Float[np.ndarray, ...] | None = None,
        scattered: Float[np.ndarray, ...] | None = None,
    ) -> Iterator[Float[np.ndarray, "points ..."]]:
        """For each color channel (P, ...) radiance under white light of radiance 1, in ``dtype``.

        ``irradiance`` and ``lobe`` (P, ...), such as one column for each light; ``indirect``
        (3, P, ...) is irradiance of each channel beside it, empty or None: none; ``scattered``
        (3, P, ...) what of ``irradiance`` comes out of the skin where, None: where it fell on it. A
        channel at a time: all at once are too many numbers for a photo.
        """
        glossy = self._glossy(lobe, dtype)
        for channel in range(CHANNELS):
            out = np.empty(irradiance.shape, dtype)
            below = irradiance if scattered is None else scattered[channel]
            yield self._image(channel, below, glossy, indirect, out)

    def by_lights(
        self,
        irradiance: Float[np.ndarray, "points ..."],
        lobe: Float[np.ndarray, "points ..."],
        dtype: DTypeLike = np.float64,
        *,
        indirect: Float[np.ndarray, ...] | None = None,
        scattered: Float[np.ndarray, ...] | None = None,
    ) -> Float[np.ndarray, "3 points ..."]:
        """All that :meth:`by_light` gives, at once."""
        glossy, result = self._glossy(lobe, dtype), np.empty((CHANNELS, *irradiance.shape), dtype)
        for channel in range(CHANNELS):
            below = irradiance if scattered is None else scattered[channel]
            self._image(channel, below, glossy, indirect, result[channel])
        return result

    def _glossy(self, lobe: np.ndarray, dtype: DTypeLike) -> np.ndarray:
        return _beside(brdf.gloss(self.c_spec, 1.0).astype(dtype), lobe) * lobe

    def _image(
        self,
        channel: int,
        irradiance: np.ndarray,
        glossy: np.ndarray,
        indirect: np.ndarray | None,
        out: np.ndarray,
    ) -> np.ndarray:
        """``out``, where one channel's radiance is put."""
        white = brdf.matte(self.sent[:, channel], 1.0).astype(out.dtype)
        np.multiply(_beside(white, irradiance), irradiance, out=out)
        out += glossy
        if indirect is not None and indirect.size:
            white += brdf.gloss(self.c_spec, uniform_lobe(1.0)).astype(out.dtype)
            out += _beside(white, irradiance) * indirect[channel]
        return out

    def by_log_albedo(
        self, irradiance: Float[np.ndarray, "points ..."]
    ) -> Float[np.ndarray, "points 3"]:
        """The radiance's derivative by log albedo before :func:`albedo_of` limits it."""
        by_log = brdf.matte(self.albedo, irradiance) * (self.albedo < brdf.ALBEDO_MAX)
        if self.excess is not None:
            by_log *= emerging(2.0 * self.albedo, self.excess)
        return by_log

    def by_excess(self, irradiance: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "points 3"]:
        """The radiance's derivative by how unevenly light comes out."""
        return brdf.matte(self.albedo, irradiance) * (1.0 - brdf.K_DIFFUSE * self.albedo)


def by_albedo(irradiance: Float[np.ndarray, " ..."]) -> Float[np.ndarray, " ..."]:
    """D radiance / d albedo: what a white diffuser sends back. Any shape."""
    return brdf.matte(1.0, irradiance)


def by_c_spec(lobe: Float[np.ndarray, " ..."]) -> Float[np.ndarray, " ..."]:
    """D radiance / d c_spec. Any shape."""
    return brdf.gloss(1.0, lobe)


def albedo_seen(
    color: Float[np.ndarray, "points 3"],
    white: Float[np.ndarray, "points 3"],
    glossy: Float[np.ndarray, "points 3"],
) -> Float[np.ndarray, "points 3"]:
    """The albedo that makes radiance ``color``, not limited.

    ``white`` as of :func:`by_albedo`, ``glossy`` the radiance from the surface.
    """
    return (color - glossy) / np.maximum(white, 1e-9)


def albedo_of(log_albedo: Float[np.ndarray, " ..."]) -> Float[np.ndarray, " ..."]:
    """The albedo of a logarithm that may be too bright, any shape."""
    albedo = np.exp(log_albedo)
    return np.minimum(albedo, brdf.ALBEDO_MAX, out=albedo if albedo.ndim else None)


def by_log(
    by_albedo: Float[np.ndarray, " ..."], albedo: Float[np.ndarray, " ..."]
) -> Float[np.ndarray, " ..."]:
    """A derivative by ``albedo``, through :func:`albedo_of`."""
    return by_albedo * albedo * (albedo < brdf.ALBEDO_MAX)


def uniform_lobe(irradiance: Any) -> Any:
    """What the lobe integrates to of light that comes from everywhere alike, as from other skin."""
    return UNIFORM / np.pi * irradiance


def _beside(
    values: Float[np.ndarray, " ..."], wide: Float[np.ndarray, " ..."]
) -> Float[np.ndarray, " ..."]:
    """``values`` with axes of length 1 behind, as many as ``wide`` has."""
    return values.reshape(values.shape + (1,) * (wide.ndim - values.ndim))

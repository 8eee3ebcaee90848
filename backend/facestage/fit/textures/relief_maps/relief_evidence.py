"""What photos say of pigment and height: residuals of log radiance, and how slopes change it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter

from facestage.contract.arrays import Bool, Float
from facestage.fit.face.state import State
from facestage.fit.forward.shading import Image
from facestage.fit.forward.surface_frame import FrameField
from facestage.fit.textures.albedo_detail import LIT_FULL
from facestage.fit.textures.doubts import in_doubt
from facestage.fit.textures.shown import Shown
from facestage.images.local_mean import local_mean

MILLIMETRES = 1e3
NOISE = 0.03  # of the logarithm, one pixel: sensor, compression, resampling
# How far red, green and blue count where shading is asked for, which changes all alike: pigment
# changes red least. From the covariance of a scan's colors, finer than 4 mm.
CHANNELS = np.array([0.55, 0.26, 0.19])
LOG_MAX = 0.6  # of a residual; what is farther off is no skin


@dataclass(frozen=True)
class Caution:
    """What is not believed of a photo."""

    # Where the log radiance changes more than so by the normal, light grazes: there it is no linear
    # function of the slopes.
    steepest: float
    # Share of the doubts about light that counts here. What they are about changes slowly over the
    # skin, more slowly than relief.
    doubted: float
    longest: float  # mm; longer waves are the mesh's own shape, or light that is wrong


# Whether there is relief at all is asked with more of it than what the relief is.
FIRST, AGAIN = Caution(2.5, 1.0, 30.0), Caution(8.0, 0.25, 20.0)


@dataclass(frozen=True)
class About:
    """A relief that is known already, about which the log radiance is taken for linear."""

    height: Float[np.ndarray, "size size"]  # mm
    image: Image  # of the same pixels, with the light on it


@dataclass(frozen=True)
class Evidence:
    """Sums over pixels, for each texel t: with the weight w, the residual y of the log radiance and
    its derivatives g by the height's differences to the right and below (per mm).
    """

    weight: Float[np.ndarray, "rows columns"]  # w
    value: Float[np.ndarray, "rows columns"]  # w y
    slope: Float[np.ndarray, "2 rows columns"]  # w g
    slope_value: Float[np.ndarray, "2 rows columns"]  # w y g
    slopes: Float[np.ndarray, "3 rows columns"]  # w g g: both to the right, mixed, both below
    paint: Float[np.ndarray, "rows columns"]  # how far log albedo may depart there

    def __add__(self, other: Evidence) -> Evidence:
        """Of the photos of both."""
        return Evidence(
            **{
                name: np.maximum(mine, getattr(other, name))
                if name == "paint"
                else mine + getattr(other, name)
                for name, mine in vars(self).items()
            }
        )

    def smoothed(self) -> Evidence:
        """Each texel with those beside it, so that two photos' pixels lie on the same ones."""
        return Evidence(
            **{
                name: each if name == "paint" else gaussian_filter(each, 1.0, axes=(-2, -1))
                for name, each in vars(self).items()
            }
        )

    def without(self, other: Evidence) -> Evidence:
        """What this photo says beyond another one: pigment, which both show, is gone."""
        mine, its = np.maximum(self.weight, 1e-9), np.maximum(other.weight, 1e-9)
        seen = (self.weight > 1e-6) & (other.weight > 1e-6)
        weight = np.where(seen, mine * its / (mine + its), 0.0)
        value = self.value / mine - other.value / its
        slope = self.slope / mine - other.slope / its
        return Evidence(
            weight,
            weight * value,
            weight * slope,
            weight * value * slope,
            weight * slope[[0, 0, 1]] * slope[[0, 1, 1]],
            np.maximum(self.paint, other.paint),
        )

    def part(self, rows: slice, columns: slice) -> Evidence:
        """Of a part of the texture."""
        return Evidence(**{name: each[..., rows, columns] for name, each in vars(self).items()})


def by_normal(image: Image) -> Float[np.ndarray, "pixels 3"]:
    """The log radiance's derivative by the unit normal, along the surface, in the camera frame;
    the channels weighed as CHANNELS says.
    """
    skin, terms = image.skin, image.terms
    total = np.zeros_like(image.surface.normals)
    color = np.maximum(image.color, 1e-6)
    for axis in range(3):
        change = skin.matte(terms.diffuse_by_normal[..., axis].astype(np.float64))
        change += skin.gloss(terms.specular_by_normal[..., axis].astype(np.float64))
        total[:, axis] = (change / color) @ CHANNELS
    normals = image.surface.normals
    return total - normals * np.einsum("px,px->p", total, normals)[:, None]


def evidence(
    shown: Shown,
    state: State,
    frames: FrameField,
    spacing: Float[np.ndarray, "size size"],
    inner: Bool[np.ndarray, "size size"],
    about: About | None = None,
) -> Evidence:
    """Of one photo, over a texture of ``size`` texels ``spacing`` mm apart.

    ``inner``: texels whose neighbours are skin too. Long waves are taken out: those
    of what the model leaves over without any relief, also where it is taken ``about`` one.
    """
    size = len(inner)
    surface = shown.image.surface
    column, row = (size * shown.uvs[:, 0]).astype(int), (size * (1 - shown.uvs[:, 1])).astype(int)
    texel = row.clip(0, size - 1) * size + column.clip(0, size - 1)

    def summed(values: Float[np.ndarray, " pixels"]) -> Float[np.ndarray, "size size"]:
        return np.bincount(texel, values, size * size).reshape(size, size)

    caution = FIRST if about is None else AGAIN
    weight = _weight(shown, caution.doubted) * inner.ravel()[texel]
    image = shown.image if about is None else about.image
    # A normal n of relief is the smooth one n0 less the slope, divided by the length: 1 / (n . n0).
    length = 1.0 / np.einsum("px,px->p", image.surface.normals, surface.normals)
    by_slope = by_normal(image) / length[:, None]
    turned = by_slope @ state.rotation  # into the model's frame
    by_u, by_v = frames.at(surface.triangle, surface.weights).gradients
    # The normal turns against the slope; a texel is 1 / size of the texture, rows run down.
    right = -np.einsum("px,px->p", turned, by_u) * size / MILLIMETRES
    below = np.einsum("px,px->p", turned, by_v) * size / MILLIMETRES
    residual = _residual(shown, shown.image)
    total = summed(weight)
    width = caution.longest / 4 / float(np.median(spacing[inner]))
    value = summed(weight * residual) / np.maximum(total, 1e-9)
    low = local_mean(value[..., None], total, width)
    residual = _residual(shown, image) - low.ravel()[texel]
    weight *= 1.0 / (1.0 + (residual / LOG_MAX) ** 4)
    weight *= 1.0 / (1.0 + ((by_slope**2).sum(axis=1) / caution.steepest**2) ** 2)
    if about is not None:
        # What a linear model would leave over of the smooth skin.
        residual += right * difference(about.height, 1).ravel()[texel]
        residual += below * difference(about.height, 0).ravel()[texel]
    counts = np.maximum(summed(np.ones(len(texel))), 1.0)
    return Evidence(
        summed(weight),
        summed(weight * residual),
        np.stack([summed(weight * right), summed(weight * below)]),
        np.stack([summed(weight * residual * right), summed(weight * residual * below)]),
        np.stack(
            [summed(weight * a * b) for a, b in ((right, right), (right, below), (below, below))]
        ),
        summed(shown.feature) / counts,
    )


def difference(values: Float[np.ndarray, "... rows columns"], axis: int) -> np.ndarray:
    """Half of what the next texel along ``axis`` has more than the one before; wraps around."""
    return 0.5 * (np.roll(values, -1, axis) - np.roll(values, 1, axis))


def _residual(shown: Shown, image: Image) -> Float[np.ndarray, " pixels"]:
    color = np.log(np.maximum(shown.photo, 1e-5)) - np.log(np.maximum(image.color, 1e-5))
    return np.clip(color @ CHANNELS, -2.0, 2.0)


def _weight(shown: Shown, doubted: float) -> Float[np.ndarray, " pixels"]:
    """Inverse variance of a pixel's residual by all that is neither pigment nor height: the doubts
    that hold the albedo back.
    """
    matte = shown.diffuse.mean(axis=1)
    body = np.maximum((shown.diffuse * shown.albedo).mean(axis=1), 1e-9)
    shading, highlight = in_doubt(shown, body)
    lit = matte / max(float(np.percentile(matte, 90)), 1e-9)
    variance = NOISE**2 + doubted**2 * (shading**2 + highlight**2 + shown.doubt**2)
    return shown.weight * np.minimum(lit / LIT_FULL, 1.0) ** 3 / variance

"""Heights that come with expressions, and all else that does: the most probable fields.

Of texel x in frame t, with the strength s_k of each group of sliders,

    y_t = a + sum_k s_kt (q_k + g_t . grad h_k) + noise:

pigment a, which is in all frames, is eliminated; h_k is the height that comes with group k, q_k
what else does, darkness in the depth of a fold for one. Both are Gaussian fields of which each
octave of wavelengths varies alike, as in :mod:`height_field`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.fft

from facestage.contract.arrays import Float
from facestage.fit.sequence.wrinkles.sheets import LONGEST, Sheet
from facestage.fit.textures.relief_maps.height_field import Spread
from facestage.fit.textures.relief_maps.relief_evidence import difference

STEPS, TOLERANCE = 60, 0.01
# Root mean squares by octave at full strength: of what is no height, and of slopes. Folds of
# 1.5 mm have slopes of 0.5, but cover little of the face.
SPREAD = Spread(pigment=0.02, slope=0.1)


@dataclass(frozen=True, eq=False)
class Moments:
    """Sums over frames, of each texel, the static pigment eliminated: with the regressors
    r = (s_k, s_k g_right, s_k g_below) of all groups k.
    """

    square: Float[np.ndarray, "regressors regressors rows columns"]
    value: Float[np.ndarray, "regressors rows columns"]
    total: Float[np.ndarray, "rows columns"]  # of the values' squares
    weight: Float[np.ndarray, "rows columns"]

    @classmethod
    def of(cls, sheets: Sequence[Sheet], strength: Float[np.ndarray, "groups frames"]) -> Moments:
        """Of ``sheets`` with these strengths of the groups."""
        count = 3 * len(strength)
        shape = sheets[0].value.shape
        square = np.zeros((count, count, *shape), np.float32)
        value, mean = np.zeros((2, count, *shape), np.float32)
        total, middle, weight = np.zeros((3, *shape), np.float32)
        for sheet, own in zip(sheets, strength.T, strict=True):
            w, y = sheet.weight, sheet.value
            terms = (np.ones_like(y), *sheet.slope)
            rows = np.stack([each * term for each in own.astype(np.float32) for term in terms])
            weighted = w * rows
            weight += w
            middle += w * y
            total += w * y * y
            mean += weighted
            value += weighted * y
            for i in range(count):
                square[i, i:] += weighted[i] * rows[i:]
        known = np.maximum(weight, 1e-6)
        for i in range(count):
            square[i, i:] -= mean[i] * mean[i:] / known
            square[i + 1 :, i] = square[i, i + 1 :]
        value -= mean * (middle / known)
        total -= middle**2 / known
        return cls(square, value, total, weight)


@dataclass(frozen=True, eq=False)
class Fields:
    """What comes with each group at full strength."""

    height: Float[np.ndarray, "groups rows columns"]  # mm
    other: Float[np.ndarray, "groups rows columns"]  # log radiance


def solved(
    moments: Moments,
    places: Float[np.ndarray, "groups rows columns"],
    spacing: float,
    spread: Spread = SPREAD,
) -> Fields:
    """The most probable fields, each in its place; ``spacing``: mm between texels."""
    groups, rows, columns = places.shape
    shape = rows, columns
    vertical, horizontal = scipy.fft.fftfreq(rows)[:, None], scipy.fft.rfftfreq(columns)[None]
    wave = 2 * np.pi * np.hypot(vertical, horizontal) / spacing  # per mm
    octave = np.sqrt(2 * np.pi / np.log(2)) / spacing
    cut = wave**2 + (2 * np.pi / LONGEST) ** 2
    amplitude = np.stack([spread.pigment * octave / np.sqrt(cut), spread.slope * octave / cut])
    amplitude = amplitude.astype(np.float32)[None]
    scale = places[:, None].astype(np.float32)

    def colored(white: np.ndarray) -> np.ndarray:
        waves = scipy.fft.rfft2(white, axes=(2, 3)) * amplitude
        return scipy.fft.irfft2(waves, shape, axes=(2, 3)) * scale

    def whitened(fields: np.ndarray) -> np.ndarray:
        waves = scipy.fft.rfft2(fields * scale, axes=(2, 3)) * amplitude
        return scipy.fft.irfft2(waves, shape, axes=(2, 3))

    def regressors(fields: np.ndarray) -> np.ndarray:
        parts = [fields[:, 0], difference(fields[:, 1], 2), difference(fields[:, 1], 1)]
        return np.stack(parts, axis=1).reshape(3 * groups, *shape)

    def transposed(values: np.ndarray) -> np.ndarray:
        each = values.reshape(groups, 3, *shape)
        # A central difference's transpose is its negative.
        height = -difference(each[:, 1], 2) - difference(each[:, 2], 1)
        return np.stack([each[:, 0], height], axis=1)

    def curvature(white: np.ndarray) -> np.ndarray:
        seen = np.einsum("ijrc,jrc->irc", moments.square, regressors(colored(white)))
        return white + whitened(transposed(seen))

    residual = whitened(transposed(moments.value))
    found, direction = np.zeros_like(residual), residual.copy()
    energy = float((residual**2).sum())
    goal = TOLERANCE**2 * energy
    for _ in range(STEPS):
        if energy <= goal:
            break
        image = curvature(direction)
        length = energy / max(float((direction * image).sum()), 1e-30)
        found += length * direction
        residual -= length * image
        before, energy = energy, float((residual**2).sum())
        direction = residual + energy / before * direction
    fields = colored(found)
    return Fields(fields[:, 1], fields[:, 0])

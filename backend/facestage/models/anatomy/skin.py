"""Skin color from pigments, and a statistical basis of skin color for any face mesh.

A melanin-bearing epidermis, a Kubelka-Munk layer, lies on a blood-bearing dermis of infinite depth:
Anderson and Parrish 1981, "The Optics of Human Skin": Kubelka-Munk layers for skin.
Jacques 1998, "Skin Optics" (Oregon Medical Laser Center): absorption of melanosomes and of
bloodless skin, scattering. Prahl 1998, "Optical absorption of hemoglobin": molar extinction of oxy-
and deoxyhaemoglobin. Farrell, Patterson and Wilson 1992 / Jensen et al. 2001, eq. 15: diffuse
reflectance of a semi-infinite medium. Wyman, Sloan and Shirley 2013, "Simple Analytic
Approximations to the CIE XYZ Color Matching Functions". Tsumura et al. 1999, 2003: in log RGB, skin
color varies along one direction for melanin and one for haemoglobin.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from facestage.models.mesh.surface_harmonics import surface_harmonics

# Population mean and spread, as natural logarithms of volume fractions (ranges of Jacques 1998:
# 1.3-43 % melanosomes in the epidermis, 0.2-7 % blood in the dermis).
MELANIN_MEAN, HAEMOGLOBIN_MEAN = 0.035, 0.012
MELANIN_LOG_SD, HAEMOGLOBIN_LOG_SD = 0.6, 0.35
# Of all people's faces, about: Jacques' range but for the darkest bodies, and twice the spread.
_MELANIN_RANGE = (0.013, 0.30)
_BLOOD_RANGE = (
    HAEMOGLOBIN_MEAN * math.exp(-2 * HAEMOGLOBIN_LOG_SD),
    HAEMOGLOBIN_MEAN * math.exp(2 * HAEMOGLOBIN_LOG_SD),
)
# What the layers may be wrong by, in the logarithm: spectrophotometers find dark skin greyer.
_MODEL_SD = 0.04

EPIDERMIS_CM = 60e-4
_EPIDERMIS_SCATTERING = 0.4  # of the dermis: no collagen fibres, only cells and keratin
_OXYGENATION = 0.75
_HAEMOGLOBIN_G_PER_L, _HAEMOGLOBIN_G_PER_MOL = 150.0, 64500.0

_WAVELENGTH = np.arange(400.0, 701.0, 10.0)
_D65 = np.array([
    82.75, 91.49, 93.43, 86.68, 104.86, 117.01, 117.81, 114.86, 115.92, 108.81, 109.35, 107.80,
    104.79, 107.69, 104.41,
    104.05, 100.00, 96.33, 95.79, 88.69, 90.01, 89.60, 87.70, 83.29, 83.70, 80.03, 80.21, 82.28,
    78.28, 69.72, 71.61,
])  # fmt: skip
_EXTINCTION_OXY = np.array([
    266232, 466840, 480360, 246072, 102580, 62816, 44480, 33209, 26629, 23684, 20933, 20035,
    24202, 39957, 53236,
    43016, 32613, 44496, 50104, 14401, 3200, 1506, 942, 610, 442, 368, 320, 294, 278, 276, 290,
], dtype=float)  # fmt: skip
_EXTINCTION_DEOXY = np.array([
    223296, 303956, 407560, 528600, 413280, 103292, 23389, 16156, 14550, 16684, 20862, 25774,
    31590, 39036, 46592,
    53412, 53788, 45072, 37020, 28324, 14677, 9444, 6510, 5149, 4345, 3750, 3227, 2795, 2408,
    2052, 1794,
], dtype=float)  # fmt: skip
_XYZ_TO_RGB = np.array(
    [
        [3.2404542, -1.5371385, -0.4985314],
        [-0.9692660, 1.8760108, 0.0415560],
        [0.0556434, -0.2040259, 1.0572252],
    ]
)


def skin_albedo(melanin: np.ndarray, haemoglobin: np.ndarray) -> np.ndarray:
    """Diffuse albedo of skin.

    melanin (n,): volume fraction of melanosomes in the epidermis; haemoglobin (n,): volume fraction
    of whole blood in the dermis. Returns (n, 3) float64, linear Rec. 709 RGB in (0, 1), for white =
    a perfect diffuser under D65.
    """
    melanin = np.clip(np.asarray(melanin, np.float64), 0.0, 0.6)[:, None]
    blood = np.clip(np.asarray(haemoglobin, np.float64), 0.0, 0.5)[:, None]
    bloodless = 0.244 + 85.3 * np.exp(-(_WAVELENGTH - 154.0) / 66.2)
    melanosome = 6.6e11 * _WAVELENGTH**-3.33
    scattering = 2e5 * _WAVELENGTH**-1.5 + 2e12 * _WAVELENGTH**-4.0
    epidermis = melanin * melanosome + (1 - melanin) * bloodless
    dermis = blood * _blood_absorption() + (1 - blood) * bloodless
    below = _diffuse_reflectance(dermis, scattering)
    layer, through = _kubelka_munk_layer(
        epidermis, _EPIDERMIS_SCATTERING * scattering, EPIDERMIS_CM
    )
    reflectance = layer + through**2 * below / (1 - layer * below)
    return np.clip(reflectance @ _spectrum_to_rgb(), 0.003, 0.99)


def pigment_directions() -> np.ndarray:
    """(2, 3) change of log linear RGB for one population standard deviation more melanin, and more
    haemoglobin.
    """
    step = 0.5
    melanin = MELANIN_MEAN * np.exp(np.array([step, -step, 0, 0]) * MELANIN_LOG_SD)
    haemoglobin = HAEMOGLOBIN_MEAN * np.exp(np.array([0, 0, step, -step]) * HAEMOGLOBIN_LOG_SD)
    log_rgb = np.log(skin_albedo(melanin, haemoglobin))
    return np.stack([log_rgb[0] - log_rgb[1], log_rgb[2] - log_rgb[3]]) / (2 * step)


@cache
def tone_modes() -> np.ndarray:
    """(3, 3) changes of log linear RGB for one standard deviation of the skin tones of all people,
    about the mean tone: darker; then from yellow to red and blue; then towards green or magenta.

    One direction for melanin, as :func:`pigment_directions` has it, is right within a face. From
    person to person it is a curve, which soon turns from yellow to grey: these are the principal
    axes of what the pigments make over the whole of their ranges. No skin is much lighter than the
    mean one, at -0.4 of the first.
    """
    melanin, blood = np.meshgrid(np.geomspace(*_MELANIN_RANGE, 60), np.geomspace(*_BLOOD_RANGE, 20))
    mean = skin_albedo(np.array([MELANIN_MEAN]), np.array([HAEMOGLOBIN_MEAN]))
    change = np.log(skin_albedo(melanin.ravel(), blood.ravel()) / mean)
    second = change.T @ change / len(change) + _MODEL_SD**2 * np.eye(3)
    variances, axes = np.linalg.eigh(second)
    axes = axes.T[::-1] * np.sqrt(variances[::-1, None])
    return np.asarray(axes * np.where(axes[:, 2:] > 0, -1.0, 1.0))


def albedo_basis(
    vertices: np.ndarray, triangles: np.ndarray, skin_mask: np.ndarray, count: int = 80
) -> tuple[np.ndarray, np.ndarray]:
    """Mean skin color and a basis of its variation for any mesh.

    vertices (n, 3) metres, triangles (t, 3) int, skin_mask (n,) bool or vertex indices. Returns the
    mean albedo (n, 3) float32 linear RGB (one tone everywhere), and the basis (count, n, 3)
    float32: change of log albedo for unit-variance coefficients, alternately melanin and
    haemoglobin times surface harmonics of rising frequency, behind three constant ones, the
    :func:`tone_modes`. Zero outside the mask.
    """
    selected = np.zeros(len(vertices), bool)
    selected[skin_mask] = True
    tones = tone_modes()[:count]
    pairs = (count - len(tones) + 1) // 2
    harmonics, eigenvalues = surface_harmonics(vertices, triangles, selected, 1 + pairs)
    # Within a face pigment varies several times less than between people, and less the finer the
    # pattern.
    lowest = max(float(eigenvalues[min(1, pairs)]), 1e-30)
    sigma = 0.14 * (1.0 + eigenvalues[1:] / lowest) ** -0.35
    within = np.einsum("hn,pc,h->hpnc", harmonics[1:], pigment_directions(), sigma)
    basis = np.concatenate(
        [harmonics[0][:, None] * tones[:, None], within.reshape(-1, len(vertices), 3)]
    )[:count]
    tone = skin_albedo(np.array([MELANIN_MEAN]), np.array([HAEMOGLOBIN_MEAN]))
    return np.repeat(tone, len(vertices), axis=0).astype(np.float32), basis.astype(np.float32)


def _blood_absorption() -> np.ndarray:
    """Absorption of whole blood per cm at each wavelength."""
    extinction = _OXYGENATION * _EXTINCTION_OXY + (1 - _OXYGENATION) * _EXTINCTION_DEOXY
    return 2.303 * extinction * _HAEMOGLOBIN_G_PER_L / _HAEMOGLOBIN_G_PER_MOL


def _diffuse_reflectance(absorption: np.ndarray, scattering: np.ndarray) -> np.ndarray:
    """Diffuse reflectance of a semi-infinite medium with refractive index 1.4 (Jensen et al. 2001,
    eq. 15).
    """
    index = 1.4
    internal = -1.440 / index**2 + 0.710 / index + 0.668 + 0.0636 * index
    boundary = (1 + internal) / (1 - internal)
    albedo = scattering / (absorption + scattering)
    root = np.sqrt(3 * (1 - albedo))
    return albedo / 2 * (1 + np.exp(-4 / 3 * boundary * root)) * np.exp(-root)


def _kubelka_munk_layer(
    absorption: np.ndarray, scattering: np.ndarray, thickness: float
) -> tuple[np.ndarray, np.ndarray]:
    """Reflectance and transmittance for diffuse light of a layer (Kubelka 1948; K = 2 mu_a, S = 3/4
    mu_s').
    """
    k, s = 2 * absorption, 0.75 * scattering
    a = (k + s) / s
    b = np.sqrt(a**2 - 1)
    depth = b * s * thickness
    denominator = a * np.sinh(depth) + b * np.cosh(depth)
    return np.sinh(depth) / denominator, b / denominator


@cache
def _spectrum_to_rgb() -> np.ndarray:
    """(31, 3) weights from a reflectance spectrum to linear Rec. 709 RGB, with each column summing
    to 1.
    """

    def lobe(mean: float, below: float, above: float) -> np.ndarray:
        return np.exp(
            -0.5 * ((_WAVELENGTH - mean) * np.where(mean > _WAVELENGTH, below, above)) ** 2
        )

    x = (
        0.362 * lobe(442.0, 0.0624, 0.0374)
        + 1.056 * lobe(599.8, 0.0264, 0.0323)
        - 0.065 * lobe(501.1, 0.0490, 0.0382)
    )
    y = 0.821 * lobe(568.8, 0.0213, 0.0247) + 0.286 * lobe(530.9, 0.0613, 0.0322)
    z = 1.217 * lobe(437.0, 0.0845, 0.0278) + 0.681 * lobe(459.0, 0.0385, 0.0725)
    rgb = _XYZ_TO_RGB @ (np.stack([x, y, z]) * _D65)
    return (rgb / rgb.sum(axis=1, keepdims=True)).T

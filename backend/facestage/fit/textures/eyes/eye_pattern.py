"""The drawing of an eye: pupil, iris with its fibres and dark rim, and the white with its vessels.

All of it is procedural and the same for everybody but for the colors: what a photo shows of an eye
is a few pixels. Radii of the iris and the pupil are the face models' own. The iris is lighter round
the pupil's zone (the collarette, at a third of its breadth), has radial fibres and darkens at its
rim, whose limbus is a band of about a millimetre: Bron, Tripathi and Tripathi 1997, "Wolff's
Anatomy of the Eye and Orbit", chapters 6 and 7.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.ndimage import gaussian_filter, gaussian_filter1d, map_coordinates

from facestage.contract.arrays import Float, Float32
from facestage.images.opencv import opencv
from facestage.models.anatomy.regions import IRIS_RADIUS, PUPIL_RADIUS

PUPIL = 0.006  # albedo
PUPIL_EDGE, LIMBUS = 0.00018, (-0.0005, 0.0007)  # metres: half a width; from the iris' radius
# The dark ring where the white begins to lie over the iris' border: log albedo, where from the
# iris' radius and how broad (metres), and how far it takes the iris' own hue away.
RING, RING_AT, RING_WIDTH, RING_GREY = -0.4, 0.0001, 0.00038, 0.7
# Log albedo: the fibres' spread, the collarette, the ring round the pupil, the rim.
FIBRES, COLLARETTE, INNER_RING, RIM = 0.22, 0.16, -0.5, -0.95
# Of the white's albedo, what the vessels take, and the blood that shows towards the corners.
VESSELS, BLUSH = np.array([0.08, 0.34, 0.32]), np.array([0.03, 0.13, 0.13])
# The eyeball's radius, as far as it is drawn, metres; and the sizes of the drawings in texels.
REACH = 0.0125
AROUND, ACROSS, WHITE_PX = 720, 64, 512
VESSEL_COUNT = 26


def iris_log_change(
    radius: Float[np.ndarray, " texels"], angle: Float[np.ndarray, " texels"], seed: int
) -> Float[np.ndarray, " texels"]:
    """What the iris' pattern adds to its log albedo; its median over the iris is about 0.

    ``radius`` metres from the eye's axis, ``angle`` about it.
    """
    share = np.clip((radius - PUPIL_RADIUS) / (IRIS_RADIUS - PUPIL_RADIUS), 0.0, 1.0)
    turns = angle / (2 * np.pi) % 1.0
    at = np.stack([share * (ACROSS - 1), turns * AROUND])
    fibres = map_coordinates(_fibres(seed), at, order=1, mode="grid-wrap")
    fade = np.clip(share / 0.12, 0, 1) * np.clip((1 - share) / 0.15, 0, 1)
    return np.asarray(
        FIBRES * fade * fibres
        + COLLARETTE * np.exp(-(((share - 0.3) / 0.12) ** 2))
        + INNER_RING * np.exp(-((share / 0.07) ** 2))
        + RIM * _smooth((share - 0.72) / 0.28)
    )


def eye_albedo(
    across: Float[np.ndarray, "texels 2"],
    iris: Float[np.ndarray, " 3"],
    white: Float[np.ndarray, " 3"],
    seed: int = 0,
    size: float = 1.0,
) -> Float32[np.ndarray, "texels 3"]:
    """Linear albedo of points of the front of an eyeball.

    ``across``: metres from its axis, to its left and up. ``iris``: of the iris, its pattern
    apart; ``white``: of the white where most of it shows. ``size`` of the iris and its pupil, as a
    share of what it is on the model.
    """
    radius, angle = np.hypot(*across.T), np.arctan2(across[:, 1], across[:, 0])
    vessels = map_coordinates(
        _vessels(seed), (across[:, ::-1].T / REACH + 1) * 0.5 * (WHITE_PX - 1), order=1
    )
    blush = _smooth((radius - 0.0072) / 0.005)
    radius = radius / size
    log_white = (
        np.log(white) + np.log1p(-vessels[:, None] * VESSELS) + np.log1p(-blush[:, None] * BLUSH)
    )
    ring = np.exp(-(((radius - IRIS_RADIUS - RING_AT) / RING_WIDTH) ** 2))[:, None]
    grey = RING_GREY * _smooth((radius - IRIS_RADIUS) / 0.0015 + 1)[:, None]
    hue = np.log(iris) - np.log(iris).mean()
    log_iris = np.log(iris) - grey * hue + iris_log_change(radius, angle, seed)[:, None]
    low, high = LIMBUS
    outside = _smooth((radius - IRIS_RADIUS - low) / (high - low))[:, None]
    pupil = _smooth((PUPIL_RADIUS + PUPIL_EDGE - radius) / (2 * PUPIL_EDGE))[:, None]
    logs = (1 - outside) * log_iris + outside * log_white + RING * ring
    return np.asarray(np.exp((1 - pupil) * logs + pupil * np.log(PUPIL)), np.float32)


@cache
def _fibres(seed: int) -> Float[np.ndarray, "across around"]:
    """Radial fibres, rows from the pupil to the rim, of unit variance; they sway, and split towards
    the rim.
    """
    rng = np.random.default_rng(1000 + seed)
    total = np.zeros((ACROSS, AROUND))
    for width, length, share in ((1.2, 30, 1.0), (2.5, 16, 0.8), (7.0, 12, 0.6), (30.0, 14, 0.5)):
        noise = gaussian_filter(
            rng.normal(size=(ACROSS, AROUND)), (length, width), mode=("nearest", "wrap")
        )
        total += share * noise / noise.std()
    sway = gaussian_filter(rng.normal(size=(ACROSS, AROUND)), (10, 24), mode=("nearest", "wrap"))
    row, column = np.mgrid[:ACROSS, :AROUND].astype(float)
    total = map_coordinates(
        total, [row, (column + 6 * sway / sway.std()) % AROUND], order=1, mode="grid-wrap"
    )
    return np.asarray((total - np.median(total)) / total.std())


@cache
def _vessels(seed: int) -> Float[np.ndarray, "rows columns"]:
    """0..1, vessels of the white, on a square of twice REACH a side: they run in from the corners,
    wander, branch, and end before the iris.
    """
    rng = np.random.default_rng(2000 + seed)
    drawing = np.zeros((WHITE_PX, WHITE_PX), np.float32)
    for number in range(VESSEL_COUNT):
        side = 0.0 if number % 2 else np.pi
        _branch(drawing, rng, side + rng.normal(0, 0.4), 1.0, rng.uniform(0.5, 1.0))
    fine = gaussian_filter(drawing, 0.7)
    return np.asarray(np.clip(fine + 0.6 * gaussian_filter(drawing, 3.0), 0, 1), np.float64)


def _branch(
    drawing: Float32[np.ndarray, "rows columns"],
    rng: np.random.Generator,
    angle: float,
    radius: float,
    ink: float,
) -> None:
    """Draw a vessel from ``radius`` (of REACH) inwards, and what branches off it."""
    cv2 = opencv()
    steps = 40
    end = rng.uniform(0.54, 0.72)
    along = np.linspace(radius, end, steps)
    sway = gaussian_filter1d(rng.normal(size=steps), 3.0)
    turn = angle + np.cumsum(0.014 * sway / max(sway.std(), 1e-9))
    points = 0.5 * (WHITE_PX - 1) * (1 + along[:, None] * np.stack([np.cos(turn), np.sin(turn)], 1))
    fixed = np.round(points * 16).astype(np.int32)
    for k in range(steps - 1):
        fade = ink * (1 - k / steps) ** 0.7
        cv2.line(drawing, fixed[k], fixed[k + 1], fade, 1, cv2.LINE_AA, 4)
    if ink > 0.35:
        k = int(rng.integers(8, 28))
        _branch(drawing, rng, turn[k] + rng.normal(0, 0.12), along[k], 0.6 * ink)


def _smooth(x: Float[np.ndarray, " _"]) -> Float[np.ndarray, " _"]:
    x = np.clip(x, 0, 1)
    return x * x * (3 - 2 * x)

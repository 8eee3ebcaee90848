"""Which pixels a frame of glasses covers: dark lines around the eyes that cross the nose.

A frame has the color of brows and lashes, and lies where they do. What no face has is a dark line
across the bridge of the nose that goes on around an eye, below it too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import binary_dilation, binary_propagation, gaussian_filter, label

from facestage.contract.arrays import Bool, Float, Float32, Num, UInt8
from facestage.contract.landmarks import Landmarks
from facestage.fit.given.face_areas import brow_pixels, chin_to_brows, face_size_px, opening_share
from facestage.fit.given.skin_mask import SURE_SKIN, beyond_border, border_width
from facestage.fit.given.window import Window
from facestage.images.image_io import resize
from facestage.images.opencv import opencv
from facestage.models.anatomy.landmark_schemes import scheme_of

# The face's size in pixels beyond which it is looked at smaller, and below which a frame is thinner
# than a pixel.
FACE_PX, FACE_MIN = 420.0, 80.0
# What a line is: dark parts that a closing by this share of the face fills. A frame of plastic is
# half as thick.
LINE_SHARE = 0.08
# Added to radiance before its logarithm, as a share of the skin's.
FLOOR_SHARE = 0.05
# Depth of the line across the nose, as of :func:`dark_lines`: on 52 photographs of faces without
# glasses at most 0.26 (frowns), on four with glasses 0.57 to 0.75. Share of it that the rest has at
# least.
BRIDGE_MIN, REST_SHARE = 0.4, 0.45
DEPTH_STEP = 0.005
# Around the middle between the inner corners of the eyes, where the line is looked for: how far up
# and down, in widths of an eye, and to either side, as a share of the way between them.
BRIDGE_UP, BRIDGE_ASIDE = 0.9, 0.2
# In widths of an eye: how far from its middle a frame may be, and how far from its opening lids and
# lashes are.
REACH, LASHES = 1.6, 0.12
# Share of the directions below an eye (degrees from the line through both), in which the frame is
# seen farther than so many widths, for one eye at least: 0.71 to 1 with glasses. Without, where the
# nose is crossed at all, at most 0.36 but for one screwed-up face (1, of a line 0.26 deep).
BELOW_MIN, BELOW_BINS, BELOW_ANGLES, BELOW_NEAR = 0.4, 14, (20.0, 160.0), 0.4
# Around what is found a pixel may still show some of it, as far as this share of the face.
AROUND_SHARE = 0.012
# How far from that skin is mixed with it, or in its shadow, in shares of the face and pixels: its
# edge is sharp, unlike hair's.
BESIDE_SHARE, BESIDE_MIN = 0.006, 1.0
# How far from a brow's line a brow may be, and how softly that ends, in shares of the face.
BROW_SHARE, BROW_SOFT = 0.03, 0.015


def spectacle_frame(
    color: Num[np.ndarray, "height width 3"],
    skin: Float[np.ndarray, "height width"],
    landmarks: Landmarks,
) -> Bool[np.ndarray, "height width"]:
    """Where a frame is; nowhere on a face without one. ``color`` is linear, ``skin`` as of
    :func:`facestage.fit.given.skin_mask.skin_weight`.
    """
    result = np.zeros(skin.shape, bool)
    size, eyes, bare = face_size_px(landmarks), Eyes.of(landmarks), color[skin > SURE_SKIN]
    if eyes is None or not len(bare) or size < FACE_MIN:
        return result
    window = eyes.window((skin.shape[1], skin.shape[0]), min(1.0, FACE_PX / size))
    if window is None:
        return result
    left, top, right, bottom = window.box
    radiance = color[top:bottom, left:right].mean(axis=2).astype(np.float32)
    usual = max(float(np.median(bare.mean(axis=1))), 1e-9)
    lines = dark_lines(resize(radiance, *window.size) / usual, window.factor * size)
    found = _followed(lines, window.landmarks(landmarks), eyes.in_window(window))
    return with_rim(found, window, size)


def clear_of_frame(
    frame: Bool[np.ndarray, "height width"], landmarks: Landmarks
) -> Float32[np.ndarray, "height width"]:
    """0 to 1, how clear a pixel is of a ``frame``, as of :func:`spectacle_frame`: close to it in
    the glass and below, but farther off where brows are. What is left of a brow that a frame
    covers is no brow.
    """
    shape, size = (frame.shape[0], frame.shape[1]), face_size_px(landmarks)
    close = beyond_border(frame, max(BESIDE_SHARE * size, BESIDE_MIN))
    if not frame.any():
        return close
    brows = binary_dilation(brow_pixels(shape, landmarks), disc(BROW_SHARE * size))
    there = gaussian_filter(brows.astype(np.float32), BROW_SOFT * size)
    far = beyond_border(frame, border_width(size))
    return close + there * (far - close)


def _followed(
    lines: Float[np.ndarray, "height width"], landmarks: Landmarks, eyes: Eyes
) -> Bool[np.ndarray, "height width"]:
    """What of ``lines`` is a frame, from the bridge of the nose on."""
    row, column = np.indices(lines.shape)
    place = np.stack([column, row], axis=-1) + 0.5
    bridge, ends = eyes.bridge(place)
    depth = crossing_depth(np.where(bridge, lines, 0.0), ends)
    shape = (lines.shape[0], lines.shape[1])
    lids = binary_dilation(opening_share(shape, landmarks) > 0.5, disc(LASHES * eyes.width))
    around = (eyes.distance(place).min(axis=0) < REACH) & ~lids
    frame = binary_propagation(
        bridge & (lines > depth), np.ones((3, 3)), (bridge | around) & (lines > REST_SHARE * depth)
    )
    worn = depth > BRIDGE_MIN and eyes.seen_below(place[frame]).max() > BELOW_MIN
    return frame if worn else np.zeros_like(frame)


@dataclass(frozen=True)
class Eyes:
    """Where eyes are, in pixels. ``middles`` and ``inner`` corners are (2, 2), ``up`` the face and
    ``aside`` of it (2,) of length 1, ``width`` that of the wider eye.
    """

    middles: np.ndarray
    inner: np.ndarray
    up: np.ndarray
    aside: np.ndarray
    width: float

    @classmethod
    def of(cls, landmarks: Landmarks) -> Eyes | None:
        """None where not both are known."""
        rings = [landmarks.points[ring] for ring in scheme_of(landmarks.scheme).openings[1:]]
        up = chin_to_brows(landmarks)
        length = float(np.linalg.norm(up))
        if not np.isfinite([*rings[0], *rings[1], up]).all() or length == 0.0:
            return None
        up = up / length
        aside = np.array([-up[1], up[0]])
        middles = np.stack([ring.mean(axis=0) for ring in rings])
        inner = [
            ring[np.argmin(np.linalg.norm(ring - other, axis=1))]
            for ring, other in zip(rings, middles[::-1], strict=True)
        ]
        width = max(float(np.ptp(ring @ aside)) for ring in rings)
        return cls(middles, np.stack(inner), up, aside, width) if width > 0.0 else None

    def window(self, full: tuple[int, int], factor: float) -> Window | None:
        """What glasses may reach of a photo of ``full`` (width, height), at ``factor`` times its
        size; None where that lies outside.
        """
        reach = REACH * self.width
        left, top = np.clip(np.floor(self.middles.min(axis=0) - reach), 0, full).astype(int)
        right, bottom = np.clip(np.ceil(self.middles.max(axis=0) + reach), 0, full).astype(int)
        return (
            Window(full, (left, top, right, bottom), factor)
            if left < right and top < bottom
            else None
        )

    def in_window(self, window: Window) -> Eyes:
        """In the window's pixels."""
        scale, corner = window.factor, window.box[:2]
        return replace(
            self,
            middles=(self.middles - corner) * scale,
            inner=(self.inner - corner) * scale,
            width=self.width * scale,
        )

    def distance(self, place: Float[np.ndarray, "*places 2"]) -> Float[np.ndarray, " eyes *places"]:
        """From the middle of either eye, in widths of an eye."""
        return np.stack([np.linalg.norm(place - one, axis=-1) for one in self.middles]) / self.width

    def bridge(
        self, place: Float[np.ndarray, "*places 2"]
    ) -> tuple[
        Bool[np.ndarray, "*places"], tuple[Bool[np.ndarray, "*places"], Bool[np.ndarray, "*places"]]
    ]:
        """What of ``place`` is on the bridge of the nose, and its edges on either side."""
        from_middle = place - self.inner.mean(axis=0)
        apart = BRIDGE_ASIDE * float(np.linalg.norm(self.inner[1] - self.inner[0]))
        beside, above = from_middle @ self.aside, from_middle @ self.up
        inside = (np.abs(beside) < apart) & (np.abs(above) < BRIDGE_UP * self.width)
        return inside, (beside < 1.0 - apart, beside > apart - 1.0)

    def seen_below(self, place: Float[np.ndarray, "places 2"]) -> Float[np.ndarray, " 2"]:
        """For either eye, the share of the directions below it in which one ``place`` is."""
        shares = []
        for middle, distance in zip(self.middles, self.distance(place), strict=True):
            below = (place - middle) @ -self.up
            angle = np.degrees(np.arctan2(below, (place - middle) @ self.aside))
            around = (distance > BELOW_NEAR) & (distance < REACH)
            found, _ = np.histogram(angle[around], BELOW_BINS, BELOW_ANGLES)
            shares.append((found > 0).mean())
        return np.array(shares)


def dark_lines(
    beside_skin: Float[np.ndarray, "height width"], size: float
) -> Float[np.ndarray, "height width"]:
    """0 to 1, of radiance ``beside_skin``'s: how far down from that of what lies on both sides to
    black it is, by the logarithm; ``size`` is the face's in pixels.
    """
    cv2 = opencv()
    light = np.log1p(np.maximum(beside_skin, 0.0) / FLOOR_SHARE).astype(np.float32)
    around = np.asarray(cv2.morphologyEx(light, cv2.MORPH_CLOSE, disc(0.5 * LINE_SHARE * size)))
    return 1.0 - light / np.maximum(around, 1e-3)


def crossing_depth(
    lines: Float[np.ndarray, "height width"],
    ends: tuple[Bool[np.ndarray, "height width"], Bool[np.ndarray, "height width"]],
) -> float:
    """The largest depth that ``lines`` have all along some way between both ``ends``."""
    low, high = 0.0, float(lines.max(initial=0.0))
    while high - low > DEPTH_STEP:
        depth = 0.5 * (low + high)
        regions, _ = label(lines > depth, np.ones((3, 3)))
        joined = np.intersect1d(regions[ends[0]], regions[ends[1]])
        low, high = (depth, high) if joined.any() else (low, depth)
    return low


def with_rim(
    found: Bool[np.ndarray, "height width"], window: Window, size: float
) -> Bool[np.ndarray, "full_height full_width"]:
    """What is ``found`` in a window, in the whole photo and with the pixels around that may still
    show some of it; ``size`` is the face's in pixels of the photo.
    """
    left, top, right, bottom = window.box
    wider = binary_dilation(found, disc(AROUND_SHARE * window.factor * size)).astype(np.float32)
    result = np.zeros(window.full[::-1], bool)
    result[top:bottom, left:right] = resize(wider, right - left, bottom - top) > 0.5
    return result


def disc(radius: float) -> UInt8[np.ndarray, "side side"]:
    """Of pixels within a radius, at least of one."""
    from skimage.morphology import disk

    return np.asarray(disk(max(round(radius), 1)))

"""Which pixels show skin: a color model of the face's own skin, from inside its landmarks."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import binary_dilation, binary_erosion, label, mean

from facestage.contract.landmarks import Landmarks
from facestage.fit.given.face_areas import (
    around_line,
    brow_lines,
    brow_pixels,
    brow_reach,
    chin_to_brows,
    face_pixels,
    face_size_px,
    hull_pixels,
    no_larger,
    opening_share,
    with_forehead,
)
from facestage.fit.given.hair import hair_pixels
from facestage.fit.given.strands import strand_pixels
from facestage.images.image_io import resize
from facestage.images.opencv import opencv
from facestage.models.anatomy.landmark_schemes import scheme_of

# Added before taking ratios, as a share of the face's mean radiance: black has no hue.
DARK_SHARE = 0.1
# Least spread of (log red/green, log blue/green, log luminance) on a face: light of two colors,
# cheeks against forehead, shading. A face half in shadow widens its own luminance spread.
SPREAD_MIN = (0.12, 0.12, 0.28)
# The face's size in pixels beyond which it is looked at smaller: a mask has no finer edges than
# that.
MASK_FACE_PX = 256.0
# A pixel of more than this is the face's own skin for sure.
SURE_SKIN = 0.9
# Distances, in spreads, at which a pixel counts in full and no longer.
FULL, NONE = 2.0, 3.5
# A highlight has the lamp's color: from the skin's, away from that of its pigments, which is much
# the same for all skin. As far as the pixel's brightness over the face's median lets the
# highlight's share be, plus a slack for where the skin itself is in half-light.
PIGMENT_HUE, PIGMENT_REACH, HIGHLIGHT_SLACK = np.array([-0.67, 0.74]), 0.7, 0.25
# Relative noise per pixel beyond which colors are read from the median of 3 x 3 or 5 x 5 pixels.
NOISE_3, NOISE_5 = 0.04, 0.12
# GrabCut: how far around the landmarks it looks and at which size of the face, in sides of the
# landmarks' box and pixels; weights that it may not change; how much its label counts against the
# weight; pixels that make a color model.
CUT_MARGIN, CUT_FACE_PX, CUT_STEPS = 0.6, 160.0, 3
CUT_SKIN, CUT_OTHER, CUT_TRUST, CUT_SAMPLES_MIN = 0.95, 0.02, 0.7, 30
# Share within the landmarks of a region that is the face's own; share of skin above a brow over
# which nothing hangs.
OWN_SHARE_MIN, BARE_SHARE_MIN = 0.7, 0.8

# How far from what hides the face a pixel may still show some of it, in shares of the face and
# pixels; a pixel counts in full from twice as far on.
BORDER_SHARE, BORDER_MIN = 0.025, 1.5


def skin_weight(
    photo: np.ndarray, landmarks: Landmarks, openings: bool = True, face_px: float = MASK_FACE_PX
) -> np.ndarray:
    """(h, w) float32 in 0..1 of ``photo`` (h, w, 3) linear: 1 where its color is the face's own.

    Hair, cloth and background of another hue, or darker than the face's own shading, go; what is
    brighter stays, because highlights are skin. Robust: median and quartiles, so glasses do not
    define the skin. Teeth are as bright, and lids have a skin's shadows: what shows between lips
    and lids is none, whatever its color; ``openings`` says whether the face has any. Colors are
    looked at where the face has ``face_px`` pixels at most.
    """
    height, width = photo.shape[:2]
    size, smaller = no_larger(landmarks, (height, width), face_px)
    if size == (width, height):
        weight = _skin_weight(photo, landmarks)
    else:
        weight = resize(_skin_weight(resize(photo, *size), smaller), width, height)
    weight = np.where(strand_pixels(photo, weight, landmarks), np.float32(0), weight)
    return weight * (1.0 - opening_share((height, width), landmarks)) if openings else weight


def _skin_weight(photo: np.ndarray, landmarks: Landmarks) -> np.ndarray:
    height, width = photo.shape[:2]
    # A hull of cheeks and chin, without brows and forehead. Eyes and mouth are the mesh's matter.
    inside = hull_pixels((height, width), landmarks.points[scheme_of(landmarks.scheme).skin])
    if inside.sum() < 20:
        return np.ones((height, width), np.float32)
    features = _features(_denoised(photo, inside), inside)
    samples = features[inside]
    centre = np.median(samples, axis=0)
    quartiles = np.percentile(samples, [25, 75], axis=0)
    spread = np.maximum(0.741 * (quartiles[1] - quartiles[0]), SPREAD_MIN).astype(np.float32)
    offset = features - centre.astype(np.float32)
    brighter = np.maximum(offset[..., 2], 0.0)
    reach = PIGMENT_REACH * -np.expm1(-np.where(brighter > 0, brighter + HIGHLIGHT_SLACK, 0.0))
    # Only on the face: a pale wall has the color of a highlight.
    face = hull_pixels((height, width), with_forehead(landmarks))
    along = np.where(face, np.clip(offset[..., :2] @ PIGMENT_HUE, 0.0, reach), 0.0)
    offset[..., :2] -= along[..., None] * PIGMENT_HUE
    hair = hair_pixels(offset, landmarks)
    offset[..., 2] = np.minimum(offset[..., 2], 0.0)
    distance = np.sqrt(((offset / spread) ** 2).sum(-1))
    weight = np.clip((NONE - distance) / (NONE - FULL), 0, 1)
    weight = _coherent(photo, weight.astype(np.float32), landmarks)
    return np.where(hair, np.float32(0), weight)


def _coherent(photo: np.ndarray, weight: np.ndarray, landmarks: Landmarks) -> np.ndarray:
    """``weight`` (h, w) drawn towards regions with edges where the photo has them: GrabCut, Rother
    et al. 2004.

    What the color model is sure of seeds it; near the face only, and at no more pixels than the fit
    looks at.
    """
    cv2 = opencv()
    points = landmarks.points[np.isfinite(landmarks.points).all(axis=1)]
    low, high, side = points.min(axis=0), points.max(axis=0), face_size_px(landmarks)
    left, top = np.clip(low - CUT_MARGIN * side, 0, None).astype(int)
    right, bottom = np.clip(high + CUT_MARGIN * side, 0, weight.shape[::-1]).astype(int)
    part = np.s_[top:bottom, left:right]
    if min(bottom - top, right - left) < 8:
        return weight
    scale = min(1.0, CUT_FACE_PX / side)
    size = max(round((right - left) * scale), 8), max(round((bottom - top) * scale), 8)

    def small(array: np.ndarray) -> np.ndarray:
        return np.asarray(
            cv2.resize(
                np.ascontiguousarray(array[part], np.float32), size, interpolation=cv2.INTER_AREA
            )
        )

    own = small(weight)
    inside = (
        small(face_pixels((weight.shape[0], weight.shape[1]), landmarks).astype(np.float32)) > 0.5
    )
    white = max(float(np.percentile(photo[part], 99.5)), 1e-9)
    picture = np.round(255 * np.clip(small(photo) / white, 0, 1) ** (1 / 2.2)).astype(np.uint8)
    labels = np.where(own > 0.5, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    labels[binary_erosion(inside & (own > CUT_SKIN), iterations=2)] = cv2.GC_FGD
    labels[binary_erosion(own < CUT_OTHER, border_value=1)] = cv2.GC_BGD
    skin = np.isin(labels, (cv2.GC_FGD, cv2.GC_PR_FGD))
    if min(skin.sum(), (~skin).sum()) < CUT_SAMPLES_MIN:
        return weight
    cv2.setRNGSeed(0)  # its clusters start from random colors
    cv2.grabCut(
        picture,
        labels,
        None,
        np.zeros((1, 65)),
        np.zeros((1, 65)),
        CUT_STEPS,
        cv2.GC_INIT_WITH_MASK,
    )
    cut = np.isin(labels, (cv2.GC_FGD, cv2.GC_PR_FGD)).astype(np.float32)
    cut = cv2.resize(cut, (int(right - left), int(bottom - top)), interpolation=cv2.INTER_LINEAR)
    result = weight.copy()
    result[part] = np.where(
        cut > 0.5,
        np.maximum(weight[part], 2 * cut * CUT_TRUST - CUT_TRUST),
        weight[part] * (1 - CUT_TRUST * (1 - cut)),
    )
    return result


def paint_weight(skin: np.ndarray, landmarks: Landmarks) -> np.ndarray:
    """(h, w) 0..1, which pixels may color the texture: skin for sure, and brows and lips inside the
    landmarks.

    ``skin`` (h, w) is :func:`skin_weight`. A region that is no skin and goes on outside the
    landmarks came in from
    there: hair, a scarf; it is nothing to paint on a face.
    """
    shape = (skin.shape[0], skin.shape[1])
    inside = face_pixels(shape, landmarks)
    # A brow whose end meets the hair at the temple is one region with it.
    regions, count = label((skin < 0.5) & ~_bare_brows(skin, landmarks))
    brows = brow_pixels(shape, landmarks)
    near = binary_dilation(inside, iterations=brow_reach(landmarks)) | brows
    share = np.asarray(mean(near, regions, np.arange(count + 1)))
    foreign = (regions > 0) & (share < OWN_SHARE_MIN)[regions]
    return np.where((inside | brows) & ~foreign, 1.0, np.clip(2 * skin - 1, 0, 1))


def clear_of_others(paint: np.ndarray, head: np.ndarray, face_px: float) -> np.ndarray:
    """(h, w) float32 in 0..1, how clear a pixel is of what hides the face: beside hair or a hand it
    mixes the colors of both, is in their shadow, and shows the hair's thin ends.

    ``paint`` (h, w) is :func:`paint_weight`, ``head`` (h, w) bool where the whole fitted head lies,
    over which what hides the face goes on; the face is ``face_px`` pixels large. What is smaller
    than the border itself is noise, which has none.
    """
    width = border_width(face_px)
    return beyond_border(large_regions(head & (paint < 0.5), width), width)


def large_regions(mask: np.ndarray, width: float) -> np.ndarray:
    """(h, w) bool, the regions of ``mask`` (h, w) that are larger than a border so many pixels
    wide: what is smaller is noise.
    """
    regions, count = label(mask)
    large = np.bincount(regions.ravel(), minlength=count + 1) > (2 * width) ** 2
    large[0] = False
    return np.asarray(large[regions])


def border_reach(face_px: float) -> int:
    """Pixels around what hides a face of ``face_px`` pixels up to which it tells on the skin."""
    return int(np.ceil(2 * border_width(face_px)))


def border_width(face_px: float) -> float:
    """Pixels around what hides a face of ``face_px`` pixels within which nothing counts."""
    return max(BORDER_SHARE * face_px, BORDER_MIN)


def beyond_border(hiding: np.ndarray, width: float) -> np.ndarray:
    """(h, w) float32 in 0..1 of pixels around the ``hiding`` (h, w) bool: 0 up to ``width`` pixels
    away, 1 from twice as far on.
    """
    cv2 = opencv()
    if not hiding.any():
        return np.ones(hiding.shape, np.float32)
    away = cv2.distanceTransform((~hiding).astype(np.uint8), cv2.DIST_L2, 5)
    return np.clip(away / np.float32(width) - 1.0, 0.0, 1.0)


def _bare_brows(skin: np.ndarray, landmarks: Landmarks) -> np.ndarray:
    """(h, w) bool, :func:`brow_pixels` of the brows above which ``skin`` (h, w) shows: no fringe
    hangs over them.
    """
    shape = (skin.shape[0], skin.shape[1])
    result = np.zeros(shape, bool)
    up = chin_to_brows(landmarks)
    up *= 2 * brow_reach(landmarks) / max(float(np.linalg.norm(up)), 1e-9)
    for brow in brow_lines(landmarks):
        above = around_line(shape, brow + up, landmarks)
        if above.any() and (skin[above] > 0.5).mean() > BARE_SHARE_MIN:
            result |= around_line(shape, brow, landmarks)
    return result


def _features(photo: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """(h, w, 3) float32 log red/green, log blue/green and log luminance."""
    dark = max(DARK_SHARE * float(photo[inside].mean()), 1e-6)
    logs = np.log(np.maximum(photo, 0) + dark, dtype=np.float32)
    return np.stack(
        [logs[..., 0] - logs[..., 1], logs[..., 2] - logs[..., 1], logs.mean(-1)], axis=-1
    )


def _denoised(photo: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """The photo, or its median filtered by as little as its noise on the face asks for."""
    cv2 = opencv()
    # The Laplacian that ignores planes and edges, Immerkaer 1996; its median ignores what is left
    # of edges.
    kernel = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)
    photo = np.ascontiguousarray(photo, np.float32)
    change = cv2.filter2D(photo, -1, kernel)[inside]
    level = float(photo[inside].mean())
    noise = 1.4826 * float(np.median(np.abs(change))) / 6.0 / max(level, 1e-9)
    if noise < NOISE_3:
        return photo
    return cv2.medianBlur(photo, 3 if noise < NOISE_5 else 5)

"""Folds that the photo's expression makes, in the albedo that shows them: found, so that they can
go where the expression goes.

A fold that the fitted shape lacks is shade, and a light ridge beside it, but a photo alone cannot
tell it from paint. Where it lies and how does: in skin that the expression presses together, along
lines across that direction. Moles are no lines, freckles are small, and what was there before lies
anywhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from facestage.contract.arrays import Bool, Float, Float32
from facestage.contract.folds import PLACES, SLIDERS_MAX, Folds
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.state import State
from facestage.fit.face.strain import SkinPlanes
from facestage.fit.textures.atlas import Atlas
from facestage.images.image_io import resize
from facestage.images.local_mean import local_mean
from facestage.images.opencv import opencv
from facestage.models.anatomy.landmark_schemes import Scheme, scheme_of

SIZE = 512  # texels along the atlas that folds are looked for on, at most
# Millimetres: up to what width a fold counts, how long it is at least, how far the way that skin is
# pressed is put together, and how soft a fold ends.
WIDTH, LENGTH, SMOOTH, SOFT = 12.0, 9.0, 3.0, 0.5
HUE = 7.0  # millimetres over which the hue of a fold is compared
# Share of its length that skin loses where there are folds: hardly, and surely.
PRESSED = (0.05, 0.13)
# How nearly a line runs across that direction: sine of the angle between them.
ACROSS = (0.5, 0.8)
DIRECTIONS = 12
# Metres. Between the corners of the mouth, down from the brows, noses and lips have lines of their
# own and moustaches; lids and brows do around them.
BESIDE_MOUTH, BESIDE_LIDS, BESIDE_BROWS = (-0.003, 0.002), (0.008, 0.012), (0.009, 0.015)
# A nose is narrower by this share, from the first to the second of these metres above the mouth.
NARROWER, UP_TO_NOSE = 0.2, (0.008, 0.022)
# Metres over which one place goes over into the other.
MIDDLE, ABOVE_BROWS = 0.004, 0.01
# Of log albedo, below which nothing is taken for a fold; and of the skin's length lost at a place,
# below which no expression made its folds.
SHALLOW, SLIGHT = 0.1, 0.03
TEXTURE = 0.03  # of log albedo, which lines of smooth skin have, too
# Of log albedo, below which a line has no hue, and what of it a channel may have.
DARK, HUES = 0.05, (0.6, 1.5)


@dataclass(frozen=True, eq=False)
class ExpressionFolds:
    """Albedo over what it were without them, and what they follow."""

    ratio: Float32[np.ndarray, "size size 3"]
    folds: Folds


def expression_folds(
    geometry: FaceGeometry,
    state: State,
    scheme: str,
    atlas: Atlas,
    log_albedo: Float[np.ndarray, "texels texels 3"],
    known: Bool[np.ndarray, "texels texels"],
) -> ExpressionFolds | None:
    """Those of the fitted expression in a ``log_albedo`` of skin that is ``known`` by the photo, of
    as many texels as the ``atlas`` or some times as many; ``scheme``: of landmarks that the model
    has. None where there are none.
    """
    if scheme not in geometry.model.landmarks or not state.expression.any():
        return None
    rest = geometry.vertices(state.identity, np.zeros_like(state.expression), state.relief)
    planes = SkinPlanes.of(rest, geometry.triangles)
    lost, direction = planes.pressed(geometry.at(state))
    bare = _bare(geometry, scheme_of(scheme), scheme)
    if not (bare[geometry.triangles].all(axis=1) & (lost > PRESSED[0])).any():
        return None
    values, weight = _on_atlas(log_albedo, known, atlas.size)
    if not weight.any():
        return None
    texel_mm = _texel_mm(geometry, planes, atlas, weight > 0)
    pressed = _pressed(geometry, planes, lost, direction)
    baked = atlas.bake(np.column_stack([pressed, bare]))
    there = (weight > 0) & atlas.skin
    smooth = local_mean(baked[..., :3], atlas.skin.astype(np.float32), SMOOTH / texel_mm)
    wide = [smooth[..., axis] for axis in range(3)]
    gate = _ramp(wide[0] + wide[2], *PRESSED) * baked[..., 3] * there
    if not gate.any():
        return None
    rows, columns = (slice(*_reach(gate.any(axis=axis), atlas.size)) for axis in (1, 0))
    part = rows, columns
    lines = _lines(
        values[part].mean(axis=-1),
        there[part],
        [each[part] for each in wide],
        WIDTH / texel_mm,
        LENGTH / texel_mm,
    )
    hue = _hue(values[part], weight[part], HUE / texel_mm)
    found, shown = np.zeros((*there.shape, 3)), there[part].astype(np.float32)
    soft = local_mean((lines * gate[part])[..., None] * hue, shown, SOFT / texel_mm)
    found[part] = soft * shown[..., None]
    if np.abs(found.mean(axis=-1)).max() < SHALLOW:
        return None
    folds = _followed(geometry, state, scheme_of(scheme), scheme, planes, direction, atlas, found)
    if not folds.place.any():
        return None
    return ExpressionFolds(np.exp(found).astype(np.float32), folds)


def _bare(geometry: FaceGeometry, scheme: Scheme, name: str) -> Float[np.ndarray, " vertices"]:
    """0..1, where skin may fold by an expression that would be smooth without it."""
    points = _landmarks(geometry, name)
    mouth, brows = points[scheme.lips], points[scheme.brows]
    lids = np.concatenate([points[ring] for ring in scheme.openings[1:]])
    middle, higher = (
        mouth.mean(axis=0),
        _ramp(geometry.mean[:, 1] - mouth[:, 1].mean(), *UP_TO_NOSE),
    )
    half = 0.5 * float(np.ptp(mouth[:, 0])) * (1 - NARROWER * higher)
    beside = np.abs(geometry.mean[:, 0] - middle[0]) - half
    above = geometry.mean[:, 1] - brows[:, 1].mean()
    result = np.maximum(_ramp(beside, *BESIDE_MOUTH), _ramp(above, 0.0, ABOVE_BROWS))
    for those, near in ((lids, BESIDE_LIDS), (brows, BESIDE_BROWS)):
        result = result * _ramp(cKDTree(those).query(geometry.mean)[0], *near)
    skin = np.zeros(len(geometry.mean))
    skin[geometry.triangles[geometry.fitted]] = 1.0
    return np.asarray(result * skin)


def _landmarks(geometry: FaceGeometry, scheme: str) -> Float[np.ndarray, "landmarks 3"]:
    """Of the mean face, metres."""
    corners, weights = geometry.model.landmark_vertices(scheme)
    return np.einsum("lc,lcx->lx", weights, geometry.model.vertices[corners]).astype(np.float64)


def _pressed(
    geometry: FaceGeometry,
    planes: SkinPlanes,
    lost: Float[np.ndarray, " triangles"],
    direction: Float[np.ndarray, "triangles 2"],
) -> Float[np.ndarray, "vertices 3"]:
    """The share of its length that the skin at each vertex loses, as a tensor over the UV square:
    along u, along both, along v.
    """
    corners = geometry.model.uvs[geometry.triangle_uvs].astype(np.float64)
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=-1)
    way = np.einsum("tij,tjk,tk->ti", edges, planes.inverse, direction)
    way /= np.maximum(np.linalg.norm(way, axis=1), 1e-30)[:, None]
    each = np.stack([way[:, 0] ** 2, way[:, 0] * way[:, 1], way[:, 1] ** 2], axis=1)
    each *= (np.maximum(lost, 0) * planes.area)[:, None]
    count, index = len(geometry.mean), geometry.triangles.ravel()
    area = np.bincount(index, np.repeat(planes.area, 3), count)
    sums = [np.bincount(index, np.repeat(column, 3), count) for column in each.T]
    return np.stack(sums, axis=1) / np.maximum(area, 1e-30)[:, None]


def _on_atlas(
    values: Float[np.ndarray, "texels texels 3"],
    known: Bool[np.ndarray, "texels texels"],
    size: int,
) -> tuple[Float[np.ndarray, "size size 3"], Float[np.ndarray, "size size"]]:
    """Means of what is ``known`` of ``values`` over the texels of an atlas of ``size``, and the
    shares that are.
    """
    times = len(values) // size
    result, share = np.zeros((size, size, 3)), np.zeros((size, size))
    for row in range(size):
        rows = slice(times * row, times * (row + 1))
        weight = known[rows].reshape(times, size, times).astype(np.float32)
        each = values[rows].reshape(times, size, times, 3)
        share[row] = weight.mean(axis=(0, 2))
        result[row] = np.einsum("isj,isjc->sc", weight, each) / times**2
    return result / np.maximum(share, 1e-9)[..., None], share


def _texel_mm(
    geometry: FaceGeometry, planes: SkinPlanes, atlas: Atlas, there: Bool[np.ndarray, "size size"]
) -> float:
    """How wide a texel is, the median of those that are ``there``."""
    a, b, c = (geometry.model.uvs[geometry.triangle_uvs[:, corner]] for corner in range(3))
    u, v = (b - a).astype(np.float64), (c - a).astype(np.float64)
    covers = np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    triangle = atlas.triangle[(there & atlas.skin)[atlas.covered]]
    sizes = planes.area[triangle] / np.maximum(covers[triangle], 1e-30)
    return 1e3 * float(np.sqrt(np.median(sizes))) / atlas.size


def _lines(
    values: Float[np.ndarray, "rows columns"],
    there: Bool[np.ndarray, "rows columns"],
    pressed: list[Float[np.ndarray, "rows columns"]],
    width: float,
    length: float,
) -> Float[np.ndarray, "rows columns"]:
    """What ``values`` have below what is beside them, and above, up to such a ``width`` in texels,
    as far as it goes on in lines of such a ``length`` across the direction that the skin is
    ``pressed`` in: what a closing fills, or an opening takes off (Serra 1982, the hats), and
    openings by segments leave.
    """
    cv2 = opencv()
    along_u, both, along_v = pressed
    direction = 0.5 * np.arctan2(2 * both, along_u - along_v)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * round(0.5 * width) + 1,) * 2)
    half = max(round(0.5 * length), 2)
    steps = np.arange(-half, half + 1)
    result = np.zeros(values.shape)
    # Between dark lines skin is no ridge: what is light, is so beside what these leave.
    for sign in (-1.0, 1.0):
        found = _hat((sign * (values - result)).astype(np.float32), there, disc)
        longest = np.zeros_like(found)
        for angle in np.pi * np.arange(DIRECTIONS) / DIRECTIONS:
            segment = np.zeros((2 * half + 1, 2 * half + 1), np.uint8)
            # Rows run down, v up.
            segment[
                np.round(half - steps * np.sin(angle)).astype(int),
                np.round(half + steps * np.cos(angle)).astype(int),
            ] = 1
            across = _ramp(np.abs(np.sin(angle - direction)), *ACROSS)
            opened = cv2.morphologyEx(found, cv2.MORPH_OPEN, segment)
            longest = np.maximum(longest, across * opened)
        result += sign * np.maximum(longest - TEXTURE, 0)
    return result


def _hat(
    values: Float32[np.ndarray, "rows columns"], there: Bool[np.ndarray, "rows columns"], disc: Any
) -> Float32[np.ndarray, "rows columns"]:
    """How far what is ``there`` stands out above its opening by a ``disc``."""
    cv2 = opencv()
    # What is not there, is neither above nor below.
    above = np.where(there, values, np.inf).astype(np.float32)
    low = cv2.erode(above, disc)
    low = np.where(there & np.isfinite(low), low, -np.inf).astype(np.float32)
    opened = cv2.dilate(low, disc)
    return np.where(there & np.isfinite(opened), np.maximum(values - opened, 0), 0)


def _hue(
    values: Float[np.ndarray, "rows columns 3"],
    weight: Float[np.ndarray, "rows columns"],
    width: float,
) -> Float[np.ndarray, "rows columns 3"]:
    """By how much more or less than the mean each channel changes with what is beside it."""
    band = values - local_mean(values, weight, width)
    mean = band.mean(axis=-1, keepdims=True)
    whole = np.where(mean < 0, np.minimum(mean, -DARK), np.maximum(mean, DARK))
    return np.clip(1 + (band - mean) / whole, *HUES)


def _followed(
    geometry: FaceGeometry,
    state: State,
    scheme: Scheme,
    name: str,
    planes: SkinPlanes,
    direction: Float[np.ndarray, "triangles 2"],
    atlas: Atlas,
    found: Float[np.ndarray, "size size 3"],
) -> Folds:
    """Which sliders press the skin together where the folds ``found`` lie, each as much as it does,
    of what the fitted expression does.
    """
    places = _places(geometry, scheme, name)
    depth = np.abs(found).mean(axis=-1)[atlas.covered]
    deep = np.bincount(atlas.triangle, depth, len(planes.triangles))
    weight = deep[:, None] * places[planes.triangles].mean(axis=1)
    chosen = np.flatnonzero(deep > 0)
    some = SkinPlanes(
        planes.triangles[chosen], planes.axes[chosen], planes.inverse[chosen], planes.area[chosen]
    )
    way = direction[chosen]
    at_rest = np.einsum("tax,ta->tx", some.axes, way)
    basis = geometry.model.expression_basis[:, geometry.used]
    by_slider = np.stack(
        [-np.einsum("tx,txa,ta->t", at_rest, some.gradient(each), way) for each in basis]
    )
    total = np.maximum(weight[chosen].sum(axis=0), 1e-30)
    pull = (by_slider @ weight[chosen] / total).T
    for row, slider in enumerate(pull):
        least = np.sort(np.abs(slider))[::-1][: SLIDERS_MAX + 1]
        if len(least) > SLIDERS_MAX:
            slider = np.where(np.abs(slider) > least[-1], slider, 0.0)
        pressed = float(slider @ state.expression)
        made = pressed > SLIGHT
        pull[row] = slider / pressed if made else 0.0
        places[:, row] *= made
    whole = np.zeros((len(geometry.model.vertices), len(PLACES)))
    whole[geometry.used] = places
    return Folds(whole, pull)


def _places(
    geometry: FaceGeometry, scheme: Scheme, name: str
) -> Float[np.ndarray, "vertices places"]:
    """How much each vertex belongs to each of PLACES, in all 1."""
    points, at = _landmarks(geometry, name), geometry.mean
    brow = _ramp(at[:, 1] - points[scheme.brows, 1].mean(), 0.0, ABOVE_BROWS)
    left = _ramp(at[:, 0] - points[scheme.lips, 0].mean(), -MIDDLE, MIDDLE)
    return np.stack([(1 - brow) * left, (1 - brow) * (1 - left), brow], axis=1)


def _reach(used: Bool[np.ndarray, " size"], size: int) -> tuple[int, int]:
    """The first and beyond the last that is ``used``, with room for what lies around."""
    numbers = np.flatnonzero(used)
    room = size // 16
    return max(int(numbers[0]) - room, 0), min(int(numbers[-1]) + room + 1, size)


def _ramp(value: np.ndarray, none: float, whole: float) -> np.ndarray:
    return np.clip((value - none) / (whole - none), 0.0, 1.0)


def without(
    albedo: Float32[np.ndarray, "texels texels 3"],
    folds: Float32[np.ndarray, "size size 3"],
    gone: Float[np.ndarray, " vertices"],
    geometry: FaceGeometry,
) -> Float32[np.ndarray, "texels texels 3"]:
    """The ``albedo`` where so much of the ``folds``, as a result has them, is ``gone``, of each
    vertex of the model.
    """
    if not gone.any():
        return albedo
    there = 1 - Atlas.build(geometry, len(folds)).bake(gone[geometry.used][:, None])
    ratio = np.maximum(folds, np.finfo(np.float32).tiny)
    return np.asarray(albedo * resize(ratio ** (there - 1), albedo.shape[1], albedo.shape[0]))

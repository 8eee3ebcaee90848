"""The color of the hair that a photo shows above its face, for the scalp of the model, whose own
hair is brown.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from facestage.contract.arrays import Bool, Float
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.state import State

# Cosine between view and head from which on a place is looked at.
FACING = 0.25
# Of how sure a pixel is skin: hair below, skin above.
NO_SKIN, SURE_SKIN = 0.2, 0.6
# Metres from skin that the photo shows within which hair is looked for: farther off, the model's
# head may be larger than the person's, and what is seen there a wall.
NEAR = 0.04
# Metres from hair within which skin is compared with it, if there is any.
BESIDE = 0.04
# Of the model's shade, from which on a place is on the scalp, and up to which on the face.
ON_SCALP, ON_FACE = 0.3, 0.02
# Places that are looked at, and the share of them that shows hair: less is a bald head, or a photo
# that ends at the forehead.
LEAST_PLACES, LEAST_SHARE = 12, 0.3
# Log of hair's mean albedo over skin's: black hair on light skin, as dense as hair on a scalp is;
# and what is lighter than that is white hair, or as well a hat.
DARKEST, LIGHTEST = -1.9, -0.25
# Hair is red rather than green, and green rather than blue, by its melanins, up to so many times;
# a hat is not. Black is of any hue: so much albedo is added to each channel before.
REDDER, YELLOWER, BLACK = (0.8, 2.6), (0.75, 3.5), 0.05
# So many times at least in the end: no hair is olive, and what is bluer is the sky, in its gloss.
LEAST_RED, LEAST_YELLOW = 1.13, 1.08


def hair_over_skin(
    geometry: FaceGeometry,
    state: State,
    shade: Float[np.ndarray, "vertices 3"],
    color: Float[np.ndarray, "height width 3"],
    skin: Float[np.ndarray, "height width"],
    usable: Bool[np.ndarray, "height width"],
    albedo: Float[np.ndarray, " 3"],
) -> Float[np.ndarray, " 3"] | None:
    """The logarithm of the photo's hair over its skin; None where it shows no hair that one could
    tell.

    ``shade`` of hair on the model's scalp; ``color`` linear, ``skin`` 0..1 and ``usable`` of the
    photo's pixels; ``albedo`` of the person's skin.
    """
    places, pixels = _seen(geometry, state, color.shape[0], color.shape[1])
    row, column = pixels[:, 1], pixels[:, 0]
    known = usable[row, column] & np.isfinite(color[row, column]).all(axis=1)
    places, row, column = places[known], row[known], column[known]
    shown, weight, there = color[row, column], skin[row, column], _density(shade)[places]
    bare = (weight > SURE_SKIN) & (there < ON_FACE)
    if bare.sum() < LEAST_PLACES:
        return None
    points = geometry.mean[places]
    looked_at = there > ON_SCALP
    looked_at &= cKDTree(points[bare]).query(points)[0] < NEAR
    hairy = looked_at & (weight < NO_SKIN)
    if hairy.sum() < max(LEAST_PLACES, LEAST_SHARE * looked_at.sum()):
        return None
    # Cheeks and lips are redder than what hair grows on, and in another light.
    beside = bare & (cKDTree(points[hairy]).query(points)[0] < BESIDE)
    radiance = np.median(shown[beside if beside.sum() >= LEAST_PLACES else bare], axis=0)
    hair = albedo * _usual(shown[hairy] / np.maximum(radiance, np.finfo(np.float32).tiny))
    if hair.mean() > np.exp(LIGHTEST) * albedo.mean() or not _grows(hair):
        return None
    return np.asarray(np.log(_melanin(hair, albedo) / albedo))


def in_color_of_hair(
    shade: Float[np.ndarray, "vertices 3"], over_skin: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, "vertices 3"]:
    """The model's ``shade``, whose densest is ``over_skin`` (see :func:`hair_over_skin`)."""
    return np.asarray(_density(shade)[:, None] * over_skin)


def _density(shade: Float[np.ndarray, "vertices 3"]) -> Float[np.ndarray, " vertices"]:
    """0..1, 1 where the model's ``shade`` of hair is darkest."""
    darkness = -shade.mean(axis=1)
    return np.asarray(darkness / max(float(darkness.max()), 1e-9))


def _seen(
    geometry: FaceGeometry, state: State, height: int, width: int
) -> tuple[np.ndarray, np.ndarray]:
    """The vertices that face the camera within its picture, and the pixels (m, 2) that they are
    in.
    """
    vertices = geometry.at(state)
    points = vertices @ state.rotation.T + state.translation
    normals = geometry.vertex_normals(vertices)[0] @ state.rotation.T
    facing = -(normals * points).sum(axis=1) / np.linalg.norm(points, axis=1)
    pixels = np.floor(state.camera.scaled(width / state.camera.width).project(points))
    inside = (pixels >= 0).all(axis=1) & (pixels < [width, height]).all(axis=1)
    places = np.flatnonzero(inside & (facing > FACING))
    return places, pixels[places].astype(int)


def _usual(colors: Float[np.ndarray, "places 3"]) -> Float[np.ndarray, " 3"]:
    """The median of that half whose brightness is most alike: some of it is a highlight, or a
    wall.
    """
    brightness = np.log(np.maximum(colors.mean(axis=1), np.finfo(np.float32).tiny))
    order = np.argsort(brightness)
    half = (len(order) + 1) // 2
    wide = brightness[order[half - 1 :]] - brightness[order[: len(order) - half + 1]]
    first = int(np.argmin(wide))
    return np.asarray(np.median(colors[order[first : first + half]], axis=0))


def _melanin(
    hair: Float[np.ndarray, " 3"], albedo: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, " 3"]:
    """The albedo of ``hair`` no darker than it is, of a hue that it has, and in no channel lighter
    than skin.
    """
    red, green, blue = np.maximum(hair, np.finfo(np.float32).tiny)
    yellow = np.clip(green / blue, LEAST_YELLOW, YELLOWER[1])
    hue = np.array([np.clip(red / green, LEAST_RED, REDDER[1]) * yellow, yellow, 1.0])
    result = hue / hue.mean() * max(hair.mean(), np.exp(DARKEST) * albedo.mean())
    return np.asarray(result * min(float((albedo / result).min()), 1.0))


def _grows(albedo: Float[np.ndarray, " 3"]) -> bool:
    """Whether hair may have this albedo."""
    red, green, blue = albedo + BLACK
    return bool(REDDER[0] < red / green < REDDER[1] and YELLOWER[0] < green / blue < YELLOWER[1])

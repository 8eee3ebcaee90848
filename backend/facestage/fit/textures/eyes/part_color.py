"""The color of irises, eyeballs and teeth: one each, from the pixels that show them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from facestage.contract.arrays import Bool, Float, Int
from facestage.contract.face_model import EYES, SKIN, TEETH
from facestage.contract.files.color import REC709
from facestage.contract.light_stage import LightStage
from facestage.fit.face.eye_white import IRIS_MAX
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.state import State
from facestage.fit.forward.reflectance import (
    EYE_ROUGHNESS,
    EYE_SPECULAR,
    WET_ROUGHNESS,
    WET_SPECULAR,
    albedo_seen,
    by_albedo,
)
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.eyes_seen import EyesSeen
from facestage.fit.given.skin_mask import SURE_SKIN
from facestage.fit.given.teeth import beside_skin, is_gum, like_teeth
from facestage.fit.textures.eyes.eye_corner import flesh_of
from facestage.fit.textures.eyes.lid_shade import faded, shade_depth
from facestage.fit.textures.eyes.lip_shadow import out_of_shadow
from facestage.render.light_terms import PLAIN

LUMINANCE = np.array(REC709)
SAMPLES = 16
BLOCK_PIXELS = 2**19
PUPIL_MAX = 0.02  # albedo of what the model paints as pupil, at most
PIXELS_MIN = 6  # with fewer, nothing is changed
# Of the logarithm: one pixel beside another may show half a lid, or a reflection.
PIXEL_SIGMA = 0.4
# Irradiance, relative to the part's brightest tenth, below which a pixel says little.
LIT_MIN = 0.1
# The white of an eye has less than this share of the skin's red over blue (of the logarithm); else
# a lid hides it.
WHITE_CHROMA_MAX, WHITE_CHROMA_MIN = 0.75, 0.1
# Share of what surrounds the eyes that may be hidden, as it is by dark glasses; and where landmarks
# find eyes that show, as between lids that are made up.
HIDDEN_MAX, HIDDEN_MAX_SURELY = 0.3, 0.6


@dataclass(frozen=True)
class Known:
    """What is known of a part's color before the photo, and how well its pixels tell of it.

    Deviations are of the logarithm: of its lightness, and of a channel beside that.
    """

    low: float  # luminance of its albedo
    high: float
    # Among the pixels that should show it, sorted by lightness, those that do: lids, lashes and
    # gums make most others darker, the light's own reflection a few brighter.
    darker: float
    brighter: float
    people: tuple[float, float]  # how far one person's is from the model's
    seen: tuple[float, float]  # how far these pixels are from it
    # among pixels that landmarks chose, instead of darker and brighter
    surely: tuple[float, float] = (0.35, 0.65)
    shaded: float = 0.0  # how much darker lids and lashes keep one person's, deviation
    # of the logarithm, at most: its red over blue, blue over red, and green over red
    yellowest: float = np.inf
    bluest: float = 0.0
    greenest: float = np.inf


# Blue and green over red, of the logarithm, of bleached teeth: L* 84, a* 0, b* 5 (natural incisors
# have a* of -2 to 3 and b* of 10 to 25).
TOOTH_BLUE, TOOTH_GREEN = -0.15, -0.04
# Whites: as fit/energy/whites_term.py reads them. Teeth lie in the lips' shadow, which is too deep,
# by 0.5 and more: only of what the photo surely shows of them is the lightness believed. Irises are
# of any color.
TEETH_KNOWN = Known(
    0.25, 0.9, 0.5, 0.9, (0.2, 0.08), (0.5, 0.15), bluest=TOOTH_BLUE, greenest=TOOTH_GREEN
)
TEETH_SEEN = Known(
    0.3,
    0.85,
    0.5,
    0.9,
    (0.4, 0.25),
    (0.15, 0.12),
    surely=(0.6, 0.95),
    yellowest=0.95,
    bluest=TOOTH_BLUE,
    greenest=TOOTH_GREEN,
)
IRIS_KNOWN = Known(0.01, 0.35, 0.35, 0.65, (1.5, 0.8), (0.2, 0.1))
WHITE_KNOWN = Known(0.1, 0.8, 0.6, 0.9, (0.15, 0.08), (0.2, 0.12), (0.35, 0.75), 0.6)
# Share of the shade at the lid's border beyond which a pixel says little of a color.
SHADED_MAX = 0.3
# Red over green and blue, of the logarithm, of the brownest iris: where a photo has next to no
# blue, what is taken off for reflections leaves none.
BROWNEST = np.array([0.0, 0.8, 1.4])
# The model's irises are a light brown. Those of dark people are dark, as the two pigments have
# genes in common (Sturm and Larsson 2009, "Genetics of human iris colour and patterns"): from where
# skin is so much darker than the model's, of the logarithm, by so much for each part of it, to the
# luminance of a dark brown one at most.
SKIN_DARKER, IRIS_WITH_SKIN, DARKEST_IRIS = 0.25, 1.4, 0.03
CROWN = 0.9  # of the crowns' vertices, sorted by lightness: one that shows their color
# Most of the lips' shadow that goes, of the logarithm: more looks patchy in other light.
EVENED_MAX = 0.2
# Albedo that passes for what surroundings leave of their own in a wet part.
VEIL = 0.008


@dataclass(frozen=True)
class Part:
    """What is given one color, and where it is on the mesh."""

    name: str
    vertices: Bool[np.ndarray, " vertices"]  # of the rendered mesh
    known: Known
    known_surely: Known | None = None  # instead, of pixels that surely show it


@dataclass(frozen=True)
class Look:
    """The photo, (h, w) like the camera of the state."""

    color: Float[np.ndarray, "height width 3"]  # linear
    usable: Bool[np.ndarray, "height width"]  # not masked, hidden or saturated
    skin: Float[np.ndarray, "height width"]  # 0..1
    eyes: EyesSeen | None = None  # what landmarks know of them
    tinted: bool = False  # it has no hue of its own


def parts_of(geometry: FaceGeometry) -> list[Part]:
    """Iris, white of the eye and teeth, as far as the face model paints them."""
    luminance = np.exp(geometry.log_albedo) @ LUMINANCE
    of_part = np.zeros((2, len(luminance)), bool)
    for row, part in enumerate((EYES, TEETH)):
        of_part[row, geometry.triangles[geometry.triangle_part == part]] = True
    eyes, teeth = of_part
    iris = eyes & (luminance > PUPIL_MAX) & (luminance < IRIS_MAX)
    parts = [Part("teeth", teeth & ~is_gum(geometry.log_albedo), TEETH_KNOWN, TEETH_SEEN)]
    # A model whose eyeballs have one color has no iris to change.
    if iris.any():
        parts += [
            Part("iris", iris, IRIS_KNOWN),
            Part("white", eyes & (luminance >= IRIS_MAX), WHITE_KNOWN),
        ]
    return [part for part in parts if part.vertices.any()]


@dataclass(frozen=True)
class PartColors:
    """What the photo says of the parts."""

    log_change: Float[np.ndarray, "vertices 3"]  # to be added to the vertices' log albedo
    lid_shade: float | None  # depth at the lid, see lid_shade.py; None: no whites to tell by
    told: frozenset[int]  # EYES and TEETH, as far as the photo shows them


def part_colors(
    forward: ForwardModel, state: State, stage: LightStage, look: Look, seed: int = 0
) -> PartColors:
    """The colors that the photo shows of the parts.

    A color is what the pixels inside the part say of its albedo under the light of ``stage``
    (camera frame), beside what is known of such parts (:class:`Known`).
    """
    geometry = forward.geometry
    parts = parts_of(geometry)
    shown = _pixels_by_part(forward, state, stage, look, parts, seed)
    white = next(
        (own for part, own in zip(parts, shown, strict=True) if part.name == "white"), None
    )
    open_eyes = (
        white is not None
        and (white.sure or _eyes_open(white.albedo, look))
        and not _behind_glasses(forward, state, look, white.sure)
    )
    shade = _lid_shade(white) if white is not None and open_eyes else None
    change, told = np.zeros_like(geometry.log_albedo), set()
    for part, pixels in zip(parts, shown, strict=True):
        if len(pixels.albedo) >= PIXELS_MIN and (open_eyes or part.name == "teeth"):
            told.add(TEETH if part.name == "teeth" else EYES)
            color = _log_change(part, pixels.out_of(shade), look.tinted)
            change[part.vertices] = color
            if part.name == "white":
                change[flesh_of(geometry)] = color
            if part.name == "teeth" and pixels.sure:
                change[part.vertices] += _in_the_open(geometry, part, pixels, color)
        elif part.name == "iris":
            change[part.vertices] = _beside_dark_skin(forward, state, part)
    return PartColors(change, shade, frozenset(told))


@dataclass(frozen=True)
class _Pixels:
    """Those that show a part."""

    albedo: Float[np.ndarray, "_ 3"]  # that they say
    own: Float[np.ndarray, "_ 3"]  # the model's there
    below_lid: Float[np.ndarray, " _"]  # radii of the iris; NaN where that is not known
    sure: bool  # landmarks chose them, or their color did
    at: Float[np.ndarray, "_ 3"]  # m, on the mean shape

    def showing(self, known: Known) -> tuple[float, float]:
        """Between which shares of them, sorted by lightness, they show the part."""
        return known.surely if self.sure else (known.darker, known.brighter)

    def out_of(self, shade: float | None) -> _Pixels:
        """As they would be without the upper lid's ``shade``; those deep in it only where there are
        no others.
        """
        if shade is None:
            return self
        depth = np.nan_to_num(faded(self.below_lid))
        clear = depth < SHADED_MAX
        if clear.sum() < PIXELS_MIN:
            clear[:] = True
        albedo = np.minimum(np.exp(shade * depth)[:, None] * self.albedo, 1.0)
        return _Pixels(
            albedo[clear], self.own[clear], self.below_lid[clear], self.sure, self.at[clear]
        )


def _pixels_by_part(
    forward: ForwardModel, state: State, stage: LightStage, look: Look, parts: list[Part], seed: int
) -> list[_Pixels]:
    """Of each part the pixels inside it."""
    surface = forward.surface(state, _pixels_of_parts(forward, state, look))
    if not parts or not len(surface.pixels):
        none = np.zeros((0, 3))
        return [_Pixels(none, none, np.zeros(0), False, none) for _ in parts]
    eye = forward.geometry.triangle_part[surface.triangle] == EYES
    rough = np.where(eye, EYE_ROUGHNESS, WET_ROUGHNESS)
    c_spec = np.where(eye, EYE_SPECULAR, WET_SPECULAR)
    terms = forward.light_terms(state, surface, stage, SAMPLES, seed, PLAIN, roughness=rough)
    image = forward.shade(state, surface, terms, radiance=stage.radiance, c_spec=c_spec)
    diffuse, specular = by_albedo(image.diffuse), image.skin.gloss(image.specular)
    column, row = surface.pixels.astype(int).T
    albedo = np.maximum(albedo_seen(look.color[row, column], diffuse, specular), 1e-3)
    # In a shadow that the photo lacks its hue is still its own.
    albedo /= np.maximum(albedo.max(axis=1, keepdims=True), 1.0)
    below = np.full(len(albedo), np.nan) if look.eyes is None else look.eyes.below_lid[row, column]
    at = np.einsum("pi,pix->px", surface.weights, forward.geometry.mean[surface.corners])
    tooth = _like_teeth(look, row, column)
    light, result = diffuse.mean(axis=1), []
    for part in parts:
        inside, own = part.vertices[surface.corners].all(axis=1), image.albedo
        seen = None if look.eyes is None else look.eyes.part(part.name)
        sure = seen is not None and int((eye & seen[row, column]).sum()) >= PIXELS_MIN
        if part.name == "teeth" and int((inside & tooth).sum()) >= PIXELS_MIN:
            sure, inside = True, inside & tooth
        if seen is not None and sure:
            inside = eye & seen[row, column]
            logs = forward.geometry.log_albedo[part.vertices]
            own = np.tile(np.exp(np.median(logs, axis=0)), (len(albedo), 1))
        lit = light > LIT_MIN * (np.percentile(light[inside], 90) if inside.any() else 0.0)
        chosen = inside & lit
        result.append(_Pixels(albedo[chosen], own[chosen], below[chosen], sure, at[chosen]))
    return result


def _like_teeth(
    look: Look, row: Int[np.ndarray, " pixels"], column: Int[np.ndarray, " pixels"]
) -> Bool[np.ndarray, " pixels"]:
    """Whether pixels are as light and as little red, beside the skin, as teeth are."""
    bare = look.color[look.usable & (look.skin > SURE_SKIN)]
    if not len(bare):
        return np.zeros(len(row), bool)
    return like_teeth(*beside_skin(look.color[row, column], bare))


def _pixels_of_parts(
    forward: ForwardModel, state: State, look: Look
) -> Float[np.ndarray, "pixels 2"]:
    """The usable pixels that show eyes or teeth, looked for in blocks: a photo has millions."""
    wet = np.isin(forward.geometry.triangle_part, (EYES, TEETH))
    box = forward.box(state, wet)
    y, x = (each + side.start for each, side in zip(np.nonzero(look.usable[box]), box, strict=True))
    found = []
    for start in range(0, max(len(x), 1), BLOCK_PIXELS):
        block = slice(start, start + BLOCK_PIXELS)
        pixels = np.stack([x[block], y[block]], axis=1) + 0.5
        triangle = forward.hits(state, pixels).triangle
        part = np.where(triangle >= 0, forward.geometry.triangle_part[triangle], SKIN)
        found.append(pixels[np.isin(part, (EYES, TEETH))])
    return np.concatenate(found)


def _lid_shade(pixels: _Pixels) -> float | None:
    """How deep the upper lid's shade is on the whites."""
    known = np.isfinite(pixels.below_lid)
    if known.sum() < PIXELS_MIN:
        return None
    lightness = np.log(pixels.albedo / pixels.own).mean(axis=1)
    lit = np.quantile(lightness, 0.5 * sum(pixels.showing(WHITE_KNOWN)))
    return shade_depth(lit - lightness[known], pixels.below_lid[known])


def _log_change(part: Part, pixels: _Pixels, tinted: bool) -> Float[np.ndarray, " 3"]:
    """What to add to the part's log albedo, whose pattern stays, and its hue where the photo is
    ``tinted``.
    """
    known, own = part.known, pixels.own
    if pixels.sure and part.known_surely is not None:
        known = part.known_surely
    logs = np.log(pixels.albedo / own)
    lightness = logs.mean(axis=1)
    low, high = np.quantile(lightness, pixels.showing(known))
    showing = (lightness >= low) & (lightness <= high)
    change = np.median(logs[showing], axis=0)
    people = (
        known.people if change.mean() > 0 else (max(known.people[0], known.shaded), known.people[1])
    )
    # What the surroundings reflect veils dark parts, and has no color of theirs.
    veiled = VEIL / np.exp(np.median(np.log(own), axis=0) + change).mean()
    variance = np.square(people)
    trust = variance / (
        variance
        + np.square([known.seen[0], np.hypot(known.seen[1], veiled)])
        + PIXEL_SIGMA**2 / showing.sum() * np.array([1.0, 0.1])
    )
    if tinted:
        trust[1] = 0.0
    level = trust[0] * change.mean()
    color = np.median(np.log(own), axis=0) + level + trust[1] * (change - change.mean())
    if part.name == "iris":
        # Melanin is red before green before blue, what scatters the other way round: no iris is
        # purple, and none is greener than both.
        color[1] = np.clip(color[1], *sorted(color[[0, 2]]))
        color = np.maximum(color, color[0] - BROWNEST)
    else:
        # Whites and teeth are yellowish, never bluish: that is light which the stage lacks.
        color[2] = np.clip(color[2], color[0] - known.yellowest, color[0] + known.bluest)
        color[1] = min(color[1], color[0] + known.greenest)
    luminance = np.log(max(float(np.exp(color) @ LUMINANCE), 1e-6))
    color += np.clip(luminance, np.log(known.low), np.log(known.high)) - luminance
    result: np.ndarray = color - np.median(np.log(own), axis=0)
    return result


def _beside_dark_skin(forward: ForwardModel, state: State, iris: Part) -> float:
    """What to add to the log albedo of an ``iris`` that the photo does not show."""
    geometry = forward.geometry
    skin = (forward.log_albedo(state) - geometry.log_albedo)[geometry.fitted_vertices]
    darker = min(float(np.median(skin.mean(axis=1))) + SKIN_DARKER, 0.0)
    own = np.median(np.exp(geometry.log_albedo[iris.vertices]) @ LUMINANCE)
    return max(IRIS_WITH_SKIN * darker, min(float(np.log(DARKEST_IRIS / own)), 0.0))


def _in_the_open(
    geometry: FaceGeometry, teeth: Part, pixels: _Pixels, color: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, "teeth 1"]:
    """What to add to the log albedo of ``teeth`` beside their ``color``: what the lips' shadow has
    wrong, as far as teeth may be that light or dark.
    """
    own = pixels.own * np.exp(color)
    lighter = np.log((pixels.albedo @ LUMINANCE) / (own @ LUMINANCE))
    added = out_of_shadow(geometry.mean[teeth.vertices], pixels.at, lighter)
    luminance = np.log(np.exp(geometry.log_albedo[teeth.vertices] + color) @ LUMINANCE)
    # What is painted darker than most of the crowns, gaps and the back, stays so.
    low, high = np.log([TEETH_SEEN.low, TEETH_SEEN.high]) - np.quantile(luminance, CROWN)
    low, high = max(min(low, 0.0), -EVENED_MAX), min(max(high, 0.0), EVENED_MAX)
    return np.clip(added, low, high)[:, None]


def _behind_glasses(forward: ForwardModel, state: State, look: Look, sure: bool) -> bool:
    """Whether much of what surrounds the eyes is hidden: what shows there is no eye's color."""
    around = look.usable[forward.box(state, forward.geometry.triangle_part == EYES)]
    most = HIDDEN_MAX_SURELY if sure else HIDDEN_MAX
    return around.size > 0 and float(around.mean()) < 1 - most


def _eyes_open(white: Float[np.ndarray, "pixels 3"], look: Look) -> bool:
    """Whether what lies where the model has the white of its eyes, is paler than the
    skin.
    """
    skin = look.color[look.usable & (look.skin > SURE_SKIN)]
    if len(white) < PIXELS_MIN or not len(skin):
        return False
    red, _, blue = np.maximum(np.median(skin, axis=0), 1e-6)
    limit = max(WHITE_CHROMA_MAX * float(np.log(red / blue)), WHITE_CHROMA_MIN)
    return bool(np.median(np.log(white[:, 0] / white[:, 2])) < limit)

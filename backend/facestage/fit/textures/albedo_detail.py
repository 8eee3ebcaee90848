"""The per-texel albedo that the albedo basis cannot express, without the shadows and highlights of
the photo.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from facestage.contract.arrays import Bool, Float, Float32, Int
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.forward.reflectance import albedo_of, albedo_seen
from facestage.fit.textures.atlas import Atlas
from facestage.fit.textures.doubts import DOUBTS, PIGMENT_SIGMA, Doubts, in_doubt, pigment_share
from facestage.fit.textures.fine_detail import fine_detail, with_fine_detail
from facestage.fit.textures.hair_shade import bared, hair_shade
from facestage.fit.textures.light_rest import light_rest
from facestage.fit.textures.painted_features import Paint
from facestage.fit.textures.shown import Shown
from facestage.fit.textures.texel_field import Field, solve_field, solved_levels
from facestage.fit.textures.unseen_tone import unseen_tone

ALBEDO_MIN, ALBEDO_BRIGHTEST = 0.005, 0.95
# Darker than the basis by more than this is a shadow's edge or an occluder, not skin; lighter, a
# highlight. Where the model paints brows or lips, they may be elsewhere or not there at all.
LOG_DARKER_MAX, LOG_LIGHTER_MAX = 0.7, 0.5
FEATURE_DARKER = 0.5
# Irradiance, relative to the brightest tenth of the face, below which the photo says little of the
# skin: at the edge of a shadow a small error of the light is a large one of the albedo.
LIT_FULL = 0.4
# No pigment of skin turns it blue or green: a larger change of hue is a highlight taken for skin.
LOG_CHROMA_MAX = 0.5
# By how much more red over green, of the logarithm, lips may be than the model's, and from which on
# they surely are made up; and how much stronger in color, and darker, as the feature of Shown, they
# then are.
BARE_LIPS, LIPSTICK = 0.4, 1.0
LIPSTICK_STRONGER, LIPSTICK_DARKER = 1.5, 1.0
# Cosine between view and skin from which its hue is its own: below, more and more is of what
# stands around it (hair, walls), and of light that comes out of the skin at its side.
HUE_NONE, HUE_WHOLE = 0.15, 0.7
# Dark lines by how much are surely creases, whose hue is that of light between their walls; the
# share of them that is painted, because the fitted shape lacks the crease.
CREASE_NONE, CREASE_SURE, CREASE_PAINTED = 0.15, 0.3, 0.6
HUE_LOST = 2.0  # of skin that is lifted out of a shadow, per unit of log radiance
FEATURE_HUE = 0.3  # departure from which on all of the hue is believed: lips, brows
# By how much the hue of a face's bare skin varies at most (root mean square): where the photo shows
# more, its colors were made stronger, or its light is not known.
HUE_VARIES = 0.09
# Per photo pixel of full confidence: tie of neighbouring texels, and of each texel to the albedo
# basis.
SMOOTHNESS, SHRINKAGE = 0.08, 0.003
# Tie of a texel that the photo does not show to its mirror image, in units of its tie to the basis.
SYMMETRY = 20.0
KNOWN = 0.5  # share of the answer that is not the basis', from which on a texel counts as known


@dataclass(frozen=True)
class AlbedoDetail:
    """What is added to the basis' log albedo, and where from."""

    log_albedo: Float32[np.ndarray, "size size 3"]
    seen: Bool[np.ndarray, "size size"]  # the photo shows the texel
    mirrored: Bool[np.ndarray, "size size"]  # the photo shows its mirror image only
    # of it, what is tone and goes on where nothing is seen
    tone: Float[np.ndarray, "vertices 3"] | None = None
    # what is left of the model's shade of hair, see hair_shade.py
    hair: Float[np.ndarray, "vertices 3"] | None = None


def albedo_detail(
    atlas: Atlas,
    shown: Shown,
    half_mirror: Int[np.ndarray, "half half"] | None,
    doubts: Doubts = DOUBTS,
    paint: Paint | None = None,
    geometry: FaceGeometry | None = None,
    hair_seen: Callable[[np.ndarray], np.ndarray] | None = None,
) -> AlbedoDetail:
    """The smooth, shrunken field of log albedo that explains the photo, completed by the face's
    other side.

    ``half_mirror`` as of :func:`symmetry.mirrored_texels`, half as wide or less; None: no symmetry.
    Where neither side is seen, the detail decays to the tone of the skin that is, on the surface
    of ``geometry``, whose hair begins where bare skin ends; None: to zero. ``hair_seen`` takes the
    model's shade of hair to that of the photo's.

    ``paint``: of the model on the skin. Where the skin is known it is taken away as far as the
    photo contradicts it, and the photo's own brows and lips are found whole: pixels that are
    coarser than the paint could not take it off its texels.
    """
    weight, target = albedo_observations(shown, doubts)
    surface = shown.image.surface
    painted, tone, hair = None, None, None
    if geometry is not None:
        model = hair_shade(geometry)
        # The share of it that no bare skin takes off.
        left = 1 + bared(geometry, surface, weight, model) / np.minimum(model, -1e-9)
        hair = left * (model if hair_seen is None else hair_seen(model))
        tone = hair - model
        target = target - surface.of_vertices(tone)
    if paint is not None:
        painted = paint.contradicted(surface, target, weight)
        target = target + surface.of_vertices(painted)
    if geometry is not None:
        target -= light_rest(geometry, surface, target, weight, shown.feature)[:, None]
        seen_tone = unseen_tone(geometry, surface, target, weight, shown.feature)
        target = target - surface.of_vertices(seen_tone)
        tone = tone + seen_tone
    # texels per pixel: the tie is per pixel
    density = max(float(atlas.skin.sum()) / max(len(target), 1), 1.0)
    field = Field(atlas.skin, shown.uvs, weight, target, SMOOTHNESS, SHRINKAGE / density)
    there = None if painted is None else surface.of_vertices(painted)
    field, told = with_fine_detail(field, *fine_detail(shown, there, doubts))
    coarse = None
    for found, known in solved_levels(field):
        if half_mirror is not None and len(found) == len(half_mirror):
            coarse = found, known
    # A texel of which only what is fine is known may be darker or lighter.
    seen = (np.minimum(known, told) > KNOWN) & atlas.skin
    if half_mirror is None or coarse is None or not seen.any():
        return AlbedoDetail(
            _on_basis(found, known, painted, tone, atlas), seen, np.zeros_like(seen), tone, hair
        )
    while len(field.texels) > len(half_mirror):
        field = field.halved()
    # What is seen stays as it is; the rest of the change is smooth, so that fewer texels are
    # enough for it.
    change, known_too = _completion(field, half_mirror, *coarse)
    times = atlas.size // len(change)
    mirrored = np.repeat(np.repeat(known_too, times, axis=0), times, axis=1)
    for row in range(len(change)):
        rows = slice(times * row, times * (row + 1))
        unknown = np.where(atlas.skin[rows], 1 - known[rows], 0.0)[..., None]
        found[rows] += unknown * np.repeat(change[row], times, axis=0)
    return AlbedoDetail(
        _on_basis(found, known + (1 - known) * mirrored, painted, tone, atlas),
        seen,
        (mirrored > KNOWN) & ~seen & atlas.skin,
        tone,
        hair,
    )


def _on_basis(
    found: Float[np.ndarray, "size size 3"],
    known: Float[np.ndarray, "size size"],
    painted: Float[np.ndarray, "vertices 3"] | None,
    tone: Float[np.ndarray, "vertices 3"] | None,
    atlas: Atlas,
) -> Float32[np.ndarray, "size size 3"]:
    """What was ``found`` on the ``tone`` and instead of the model's paint, as what is to be added
    to the basis.
    """
    result = np.asarray(found, np.float32)
    both = [each for each in (tone, painted) if each is not None]
    if not both:
        return result
    none = np.zeros_like(both[0])
    values = np.hstack([none if each is None else each for each in (tone, painted)])
    for rows, there in atlas.baked(values):
        covered = atlas.covered[rows]
        share = np.where(atlas.skin[rows], known[rows], 0.0)[covered].astype(np.float32)
        result[rows][covered] += there[:, :3] - share[:, None] * there[:, 3:]
    return result


def _completion(
    field: Field,
    mirror: Int[np.ndarray, "size size"],
    found: Float[np.ndarray, "size size 3"],
    known: Float[np.ndarray, "size size"],
) -> tuple[Float[np.ndarray, "size size 3"], Float[np.ndarray, "size size"]]:
    """What the mirror images add to ``field``'s solution, and how much is then known."""
    paired = mirror >= 0
    other = np.where(paired, mirror, 0).ravel()
    other_known = np.where(paired, known.ravel()[other].reshape(known.shape), 0.0)
    seen_there = np.clip((other_known - KNOWN) / (1 - KNOWN), 0, 1)
    trust = SYMMETRY * field.shrinkage * (1 - known) ** 4 * seen_there
    guess = found.reshape(-1, 3)[other].reshape(found.shape)
    completed, known_too = solve_field(
        replace(field, guess_weight=trust.astype(np.float32), guess=guess)
    )
    return completed - found, known_too


def albedo_observations(
    shown: Shown, doubts: Doubts = DOUBTS
) -> tuple[Float[np.ndarray, " pixels"], Float[np.ndarray, "pixels 3"]]:
    """Confidence, and what each pixel says of log albedo minus the basis'.

    Of what a pixel lacks, only the share that is more likely pigment than wrong shading is passed
    on: shading errors are alike over whole regions, so that a lower weight alone would not keep
    them out.
    """
    diffuse, specular = shown.diffuse, shown.specular
    lit = (diffuse / max(float(np.percentile(diffuse, 90)), 1e-9)).min(axis=1)
    wanted = np.clip(albedo_seen(shown.photo, diffuse, specular), ALBEDO_MIN, ALBEDO_BRIGHTEST)
    target = np.log(wanted) - np.log(np.maximum(shown.albedo, 1e-6))
    # What the skin itself sends back: under a brow that the model paints and the photo lacks, more
    # than the basis says.
    skin = diffuse * shown.albedo * np.exp(np.clip(target, 0, shown.feature[:, None]))
    # Relative error of the albedo grows where little of the light is diffuse.
    share = (skin / np.maximum(skin + specular, 1e-9)).min(axis=1)
    lipstick = _lipstick(shown, target)
    departure = np.maximum(shown.feature, LIPSTICK_DARKER * lipstick)
    darker, lighter = LOG_DARKER_MAX + FEATURE_DARKER * departure, LOG_LIGHTER_MAX + shown.feature
    # Of what hardly has green or blue their logarithms say little.
    whole = np.log(wanted.mean(axis=1) / np.maximum(shown.albedo.mean(axis=1), 1e-6))
    brightness = (1 - lipstick) * target.mean(axis=1) + lipstick * whole
    robust = 1.0 / (1.0 + (brightness / np.where(brightness < 0, darker, lighter)) ** 4)
    confidence = shown.weight * np.minimum(lit / LIT_FULL, 1.0) ** 3 * share**2 * robust
    strongest = (LOG_CHROMA_MAX + LIPSTICK_STRONGER * lipstick)[:, None]
    chroma = np.clip(target - brightness[:, None], -strongest, strongest)
    target = np.clip(brightness, -darker, lighter)[:, None] + chroma

    target = _with_skins_hue(shown, target, confidence, lipstick)
    body = np.maximum(skin.mean(axis=1), 1e-9)
    shading, highlight = in_doubt(shown, body, doubts)
    sigma = np.hypot(PIGMENT_SIGMA, np.where(brightness < 0, departure, shown.feature))
    confidence *= pigment_share(brightness, np.hypot(shading, shown.doubt), highlight, sigma)
    return confidence, target * pigment_share(brightness, shading, highlight, sigma)[:, None]


def _lipstick(shown: Shown, target: Float[np.ndarray, "pixels 3"]) -> Float[np.ndarray, " pixels"]:
    """0..1, how surely each pixel shows lipstick: no light makes lips, and nothing else of a face,
    much redder than lips are.
    """
    redness = target[:, 0] - target[:, 1]
    lips, skin = (shown.weight * share > 0.5 for share in (shown.lips, 1 - shown.lips))
    if not (lips.any() and skin.any()):
        return np.zeros(len(lips))
    redder = float(np.median(redness[lips]) - np.median(redness[skin]))
    return np.interp(redder, (BARE_LIPS, LIPSTICK), (0.0, 1.0)) * shown.lips


def _with_skins_hue(
    shown: Shown,
    target: Float[np.ndarray, "pixels 3"],
    confidence: Float[np.ndarray, " pixels"],
    lipstick: Float[np.ndarray, " pixels"],
) -> Float[np.ndarray, "pixels 3"]:
    """``target`` with the hue of the rest of the skin where the photo's is not skin's own, nor
    ``lipstick``'s (0..1), and with shallower creases.
    """
    if not (confidence > 0).any():
        return target
    surface = shown.image.surface
    cosine = -np.einsum("px,px->p", surface.normals, surface.rays)
    plain = 1 - np.minimum(shown.feature / FEATURE_HUE, 1.0)
    sure = np.clip((shown.crease - CREASE_NONE) / (CREASE_SURE - CREASE_NONE), 0, 1)
    own = np.clip((cosine - HUE_NONE) / (HUE_WHOLE - HUE_NONE), 0, 1) * (1 - sure)
    # What is left in a shadow is light of another color.
    own *= np.exp(-HUE_LOST * shown.lifted_there)
    brightness = target.mean(axis=1, keepdims=True)
    hue = target - brightness
    usual = np.median(hue[confidence >= np.median(confidence[confidence > 0])], axis=0)
    shade = sure * plain * np.clip(-brightness[:, 0], 0, shown.crease)
    skin = confidence * plain * own
    spread = np.sqrt((skin[:, None] * (hue - usual) ** 2).sum() / max(skin.sum(), 1e-9))
    believed = min(1.0, HUE_VARIES / max(float(spread), 1e-9)) * np.maximum(own, 1 - plain)
    return (
        brightness
        + ((1 - CREASE_PAINTED) * shade)[:, None]
        + usual
        + np.maximum(believed, lipstick)[:, None] * (hue - usual)
    )


def painted(log_albedo: Float[np.ndarray, "size size 3"]) -> Float32[np.ndarray, "size size 3"]:
    """The albedo texture of a log albedo."""
    return albedo_of(log_albedo.astype(np.float32, copy=False))

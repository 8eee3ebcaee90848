"""The per-texel stage: specular and roughness maps, relief, then albedo detail, completed by
symmetry, with their coverage.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from facestage.contract import brdf
from facestage.contract.arrays import Bool, Float, Float32, Int, UInt8
from facestage.contract.face_model import EYES, TEETH
from facestage.contract.result import BY_SYMMETRY, SEEN
from facestage.fit.forward.reflectance import (
    EYE_ROUGHNESS,
    EYE_SPECULAR,
    WET_ROUGHNESS,
    WET_SPECULAR,
    by_c_spec,
)
from facestage.fit.forward.rendering import Textures
from facestage.fit.forward.shading import ForwardModel, sample_bilinear
from facestage.fit.given.eyes_seen import EyesSeen
from facestage.fit.given.fineness import TEXELS_PER_FACE_PX, USUAL, Fineness
from facestage.fit.given.problem import Problem
from facestage.fit.textures.albedo_detail import AlbedoDetail, albedo_detail, painted
from facestage.fit.textures.atlas import Atlas, Atlases
from facestage.fit.textures.expression_folds import SIZE as FOLDS_SIZE
from facestage.fit.textures.expression_folds import ExpressionFolds, expression_folds
from facestage.fit.textures.eyes.eye_corner import keep_flesh
from facestage.fit.textures.eyes.eye_picture import eye_picture, eyes_painted
from facestage.fit.textures.eyes.iris_size import iris_size
from facestage.fit.textures.eyes.lash_line import draw_lash_line
from facestage.fit.textures.eyes.lid_shade import LidShade
from facestage.fit.textures.eyes.part_color import Look, PartColors, part_colors
from facestage.fit.textures.gloss_detail import GlossStep, gloss_beyond, gloss_seen, gloss_step
from facestage.fit.textures.hair_color import hair_over_skin, in_color_of_hair
from facestage.fit.textures.painted_features import painted_features
from facestage.fit.textures.relief_maps.looks import first_look, look_again
from facestage.fit.textures.relief_maps.relief import Relief, ReliefSeen
from facestage.fit.textures.shown import Shown, what_is_shown
from facestage.fit.textures.stubble import grow_stubble, matted
from facestage.fit.textures.symmetry import mirrored_texels
from facestage.fit.textures.texel_field import halved, resampled
from facestage.fit.trust.fitted import Fitted
from facestage.system.freed_memory import give_back_freed_memory

# Texels along the atlas on which mirror images are looked up, at most.
COARSE_SIZE = 1024
# Pixels of a photo that gloss is found from, about: its maps have no finer texels.
GLOSS_PIXELS = 400_000
# Of a larger atlas and the light on each pixel of a large photo only one fits into memory.
EARLY_SIZE = 2048


@dataclass(frozen=True)
class Refined:
    """The maps of the atlas and what they rest on."""

    textures: Textures
    coverage: UInt8[np.ndarray, "size size 3"]  # see CONVENTIONS.md
    # of the eyes' part of the atlas, see eye_picture.py
    eyes: Float32[np.ndarray, "height width 3"] | None = None
    # of the log albedo, what goes on where nothing is seen, see unseen_tone.py, and what is left of
    # the model's shade of hair, see hair_shade.py
    tone: Float[np.ndarray, "vertices 3"] | None = None
    hair: Float[np.ndarray, "vertices 3"] | None = None
    # EYES and TEETH, as far as the photo says what color they are
    told: frozenset[int] = frozenset()
    # where hair hangs before the face that only the fitted light tells from skin; None: who knows
    hanging: Bool[np.ndarray, "rows columns"] | None = None
    folds: ExpressionFolds | None = None  # of the photo's expression, in the albedo


def refine(
    problem: Problem,
    forward: ForwardModel,
    fitted: Fitted,
    size: int | None = None,
    together: ReliefSeen | None = None,
) -> Refined:
    """All maps of a finished fit; those that the job froze, and texels of which nothing is known,
    are as fitted.

    ``size`` S of the albedo, by default what the photo holds; ``together``: what all photos of the
    person say of the relief, by default this one alone.
    """
    # Specular and roughness are found on half as many texels.
    atlases = Atlases(problem.geometry)
    small = atlases.of(problem.fineness.gloss_texture)
    freeze = set(problem.job.freeze)
    shown = (
        None
        if freeze >= {"albedo", "specular", "roughness"}
        else what_is_shown(problem, forward, fitted)
    )
    gloss = None
    if shown is not None and not freeze >= {"specular", "roughness"}:
        gloss = _gloss(small, shown.thinned(GLOSS_PIXELS), fitted, freeze)
        shown = shown.with_gloss(
            sample_bilinear(gloss.specular, shown.uvs), sample_bilinear(gloss.roughness, shown.uvs)
        )
    if size is None:
        size = texture_size(problem.face_size_px, problem.fineness)
    ready, detail = None, None
    if shown is not None and "albedo" not in freeze:
        ready = _ready_to_paint(problem, forward, fitted, shown, atlases, size, together)
        if ready.relief is not None:
            shown = ready.relief.lit(shown, forward.geometry, fitted.state)
    if shown is not None:
        shown = shown.without_lights()
    atlas = atlases.of(size)
    vertices = forward.log_albedo(fitted.state)
    if shown is not None and ready is not None:
        detail = albedo_detail(
            atlas,
            shown,
            ready.mirror,
            paint=painted_features(problem.geometry),
            geometry=problem.geometry,
            hair_seen=lambda shade: _hair(problem, forward, fitted, shade),
        )
        vertices = vertices + ready.parts.log_change
    hanging = None if shown is None else shown.hanging
    del shown  # what the largest maps need memory for
    give_back_freed_memory()
    logs = atlas.bake(vertices)
    hair, folds = None if detail is None else detail.hair, None
    if detail is not None:
        keep_flesh(detail.log_albedo, atlas, problem.geometry)
        logs += detail.log_albedo
        folds = _folds(problem, forward, fitted, atlases.of(min(size, FOLDS_SIZE)), logs, detail)
        if hair is not None:
            grow_stubble(logs, atlas, problem.geometry, hair)
        model, mean = problem.geometry.model, problem.geometry.mean
        draw_lash_line(logs, atlas, model, mean, problem.lash_depth)
        # Beyond the seams too, where lookups between texels reach.
        atlas.spread(logs)
    albedo = painted(logs)
    del logs
    eyes = None if ready is None else ready.eyes
    if eyes is not None:
        albedo = eyes_painted(albedo, atlas, problem.geometry, eyes)
    textures = Textures(albedo, *_gloss_textures(small, problem, fitted, gloss, hair))
    if ready is not None and ready.relief is not None:
        textures = replace(textures, normal=ready.relief.normal, height=ready.relief.height)
    tone = None if detail is None else detail.tone
    coverage = _coverage(atlas, small.size, detail, gloss)
    told = frozenset[int]() if ready is None else ready.parts.told
    return Refined(textures, coverage, eyes, tone, hair, told, hanging, folds)


@dataclass(frozen=True)
class _Ready:
    """What the albedo is painted with."""

    relief: Relief | None
    parts: PartColors
    eyes: Float32[np.ndarray, "height width 3"] | None
    mirror: Int[np.ndarray, "half half"]


def _ready_to_paint(
    problem: Problem,
    forward: ForwardModel,
    fitted: Fitted,
    shown: Shown,
    atlases: Atlases,
    size: int,
    together: ReliefSeen | None,
) -> _Ready:
    """The relief, by ``together`` or by this photo alone, and while that is solved for, which
    needs no renderer, what does.
    """
    with ThreadPoolExecutor(1) as beside:
        first = None
        if together is None:
            coarse = atlases.of(min(size, problem.fineness.relief_texture))
            first = first_look(problem, forward, fitted, shown, coarse)
        again = None if first is None else beside.submit(first.again)
        parts = part_colors(
            forward, fitted.state, fitted.stage, _look(problem, fitted, shown), problem.job.seed
        )
        eyes = _eyes(problem, forward, fitted, parts)
        if size <= EARLY_SIZE:
            atlases.of(size)
        seen = together if again is None else again.result()
        if first is not None and first.found is not None and seen is not None:
            look_again(seen, problem, forward, fitted, shown, first.found)
        relief = None if seen is None else beside.submit(lambda: seen.found)
        mirror = mirrored_texels(atlases.of(min(size // 2, COARSE_SIZE)), problem.geometry)
        return _Ready(None if relief is None else relief.result(), parts, eyes, mirror)


def _look(problem: Problem, fitted: Fitted, shown: Shown) -> Look:
    photo = problem.photograph
    return Look(
        photo.color * np.exp(shown.lifted)[..., None],
        photo.mask & ~problem.frame & ~fitted.hidden & ~photo.clipped.any(axis=2),
        problem.skin,
        EyesSeen.of((photo.mask.shape[0], photo.mask.shape[1]), problem.landmarks),
        photo.tinted,
    )


def _eyes(
    problem: Problem, forward: ForwardModel, fitted: Fitted, parts: PartColors
) -> Float32[np.ndarray, "height width 3"] | None:
    """The eyes' own picture, in the colors of the photo."""
    geometry, shade = problem.geometry, None
    if parts.lid_shade is not None:
        shade = LidShade.of(geometry, fitted.state, parts.lid_shade)
    vertices = forward.log_albedo(fitted.state) + parts.log_change
    size = iris_size(geometry, fitted.state, problem.landmarks)
    return eye_picture(geometry, vertices, shade, size)


def texture_size(face_px: float, fineness: Fineness = USUAL) -> int:
    """Texels along the atlas for a face of this many pixels: a power of two times the smallest."""
    size = fineness.texture_min
    while size < min(TEXELS_PER_FACE_PX * face_px, fineness.texture_max):
        size *= 2
    return size


def _gloss(small: Atlas, shown: Shown, fitted: Fitted, freeze: set[str]) -> GlossStep:
    image = shown.image
    by_specular = by_c_spec(image.specular)
    by_roughness = image.skin.gloss(image.terms.specular_by_roughness)
    if "specular" in freeze:
        by_specular = np.zeros_like(by_specular)
    if "roughness" in freeze:
        by_roughness = np.zeros_like(by_roughness)
    texels = halved(small.skin)
    found = gloss_step(texels, shown, by_specular, by_roughness)
    seen = gloss_seen(texels, shown)
    if "specular" in freeze:
        return found.within(seen)
    # What there is of it with what was found, and what has to go of that.
    change = sample_bilinear(found.specular, shown.uvs)
    beyond = gloss_beyond(texels, shown.with_gloss(change, np.zeros_like(change)))
    whole = resampled(fitted.state.specular, len(texels)) + found.specular
    return replace(found, specular=found.specular - beyond * np.maximum(whole, 0)).within(seen)


def _gloss_textures(
    small: Atlas,
    problem: Problem,
    fitted: Fitted,
    gloss: GlossStep | None,
    hair: Float[np.ndarray, "vertices 3"] | None,
) -> tuple[Float32[np.ndarray, "size size"], Float32[np.ndarray, "size size"]]:
    """Specular and roughness of the ``small`` atlas: skin as found, eyes and teeth a clear
    layer.
    """
    size, state = small.size, fitted.state
    specular = resampled(state.specular, size)
    roughness = np.full((size, size), state.roughness)
    if gloss is not None:
        specular = np.where(small.skin, specular + resampled(gloss.specular, size), specular)
        roughness = np.where(small.skin, roughness + resampled(gloss.roughness, size), roughness)
        small.spread(specular)
        small.spread(roughness)
    if hair is not None and "specular" not in problem.job.freeze:
        specular = specular * (1 - small.bake(matted(hair)[:, None])[..., 0])
    for part, c_spec, rough in (
        (EYES, EYE_SPECULAR, EYE_ROUGHNESS),
        (TEETH, WET_SPECULAR, WET_ROUGHNESS),
    ):
        wet = np.zeros((size, size), bool)
        wet[small.covered] = problem.geometry.triangle_part[small.triangle] == part
        small.spread(wet)
        specular = np.where(wet, c_spec, np.clip(specular, 0, brdf.SPECULAR_MAX))
        roughness = np.where(wet, rough, roughness)
    roughness = np.clip(roughness, brdf.ROUGHNESS_MIN, brdf.ROUGHNESS_MAX)
    return specular.astype(np.float32), roughness.astype(np.float32)


def _folds(
    problem: Problem,
    forward: ForwardModel,
    fitted: Fitted,
    atlas: Atlas,
    logs: Float[np.ndarray, "size size 3"],
    detail: AlbedoDetail,
) -> ExpressionFolds | None:
    """Those of the photo's expression. Among the lines of a beard nobody could tell."""
    if problem.beard.covers.any():
        return None
    known, scheme = detail.seen | detail.mirrored, problem.landmarks.scheme
    return expression_folds(forward.geometry, fitted.state, scheme, atlas, logs, known)


def _hair(
    problem: Problem, forward: ForwardModel, fitted: Fitted, shade: Float[np.ndarray, "vertices 3"]
) -> Float[np.ndarray, "vertices 3"]:
    """The model's ``shade`` of hair in the color of the photo's, if that shows any."""
    if not shade.any():
        return shade
    geometry, state, photo = forward.geometry, fitted.state, problem.photograph
    skin = np.exp(np.median(forward.log_albedo(state)[geometry.fitted_vertices], axis=0))
    over_skin = hair_over_skin(
        geometry,
        state,
        shade,
        photo.color,
        problem.skin,
        photo.mask & ~problem.frame,
        skin.astype(float),
    )
    return shade if over_skin is None else in_color_of_hair(shade, over_skin)


def _coverage(
    atlas: Atlas, gloss_size: int, detail: AlbedoDetail | None, gloss: GlossStep | None
) -> UInt8[np.ndarray, "size size 3"]:
    """Where the albedo is from, and how much the photo says of c_spec and
    roughness.
    """
    result = np.zeros((atlas.size, atlas.size, 3), np.uint8)
    if detail is not None:
        result[..., 0] = np.where(detail.seen, SEEN, np.where(detail.mirrored, BY_SYMMETRY, 0))
    if gloss is not None:
        for channel, known in ((1, gloss.specular_known), (2, gloss.roughness_known)):
            wide = np.round(255 * resampled(known, gloss_size)).astype(np.uint8)
            row = np.arange(atlas.size) * gloss_size // atlas.size
            result[..., channel] = np.where(atlas.skin, wide[row[:, None], row], 0)
    return result

"""The per-texel stage: specular and roughness maps, relief, then albedo detail, completed by
symmetry, with their coverage.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from facestage.contract import brdf
from facestage.contract.arrays import Float, Float32, UInt8
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
from facestage.fit.textures.atlas import Atlas
from facestage.fit.textures.eyes.eye_corner import keep_flesh
from facestage.fit.textures.eyes.eye_picture import eye_picture, eyes_painted
from facestage.fit.textures.eyes.iris_size import iris_size
from facestage.fit.textures.eyes.lash_line import draw_lash_line
from facestage.fit.textures.eyes.lid_shade import LidShade
from facestage.fit.textures.eyes.part_color import Look, part_colors
from facestage.fit.textures.gloss_detail import GlossStep, gloss_beyond, gloss_seen, gloss_step
from facestage.fit.textures.hair_color import hair_over_skin, in_color_of_hair
from facestage.fit.textures.painted_features import painted_features
from facestage.fit.textures.relief_maps.relief import Relief, ReliefSeen
from facestage.fit.textures.shown import Shown, light_on, what_is_shown
from facestage.fit.textures.stubble import grow_stubble, matted
from facestage.fit.textures.symmetry import mirrored_texels
from facestage.fit.textures.texel_field import halved, resampled
from facestage.fit.trust.fitted import Fitted
from facestage.system.freed_memory import give_back_freed_memory

# Texels along the atlas on which mirror images are looked up, and relief is found, at most.
COARSE_SIZE = 1024
# Pixels of a photo that relief is found from a second time, about: it has no finer texels.
LOOKED_AGAIN = 500_000
# Towards the lights then: what grain a single one leaves in penumbras is taken for relief.
RAYS_AGAIN = 4e7


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
    small = Atlas.build(problem.geometry, problem.fineness.gloss_texture)
    freeze = set(problem.job.freeze)
    shown = (
        None
        if freeze >= {"albedo", "specular", "roughness"}
        else what_is_shown(problem, forward, fitted)
    )
    gloss = None
    if shown is not None and not freeze >= {"specular", "roughness"}:
        gloss = _gloss(small, shown, fitted, freeze)
        shown = shown.with_gloss(
            sample_bilinear(gloss.specular, shown.uvs), sample_bilinear(gloss.roughness, shown.uvs)
        )
    if size is None:
        size = texture_size(problem.face_size_px, problem.fineness)
    # The largest atlas and the light on each pixel of a large photo would not fit together.
    coarse = Atlas.build(problem.geometry, min(size, COARSE_SIZE))
    detail, relief, eyes, told = None, None, None, frozenset[int]()
    if shown is not None and "albedo" not in freeze:
        relief = (
            found_relief(problem, forward, fitted, shown, coarse)
            if together is None
            else together.found
        )
        if relief is not None:
            shown = relief.lit(shown, forward.geometry, fitted.state)
    if shown is not None:
        shown = shown.without_lights()
    atlas = coarse if coarse.size == size else Atlas.build(problem.geometry, size)
    vertices = forward.log_albedo(fitted.state)
    if shown is not None and "albedo" not in freeze:
        wide = min(atlas.size // 2, COARSE_SIZE)
        ready = {small.size: small, coarse.size: coarse}
        half = ready.get(wide) or Atlas.build(problem.geometry, wide)
        detail = albedo_detail(
            atlas,
            shown,
            mirrored_texels(half, problem.geometry),
            paint=painted_features(problem.geometry),
            geometry=problem.geometry,
            hair_seen=lambda shade: _hair(problem, forward, fitted, shade),
        )
        photo = problem.photograph
        look = Look(
            photo.color * np.exp(shown.lifted)[..., None],
            photo.mask & ~problem.frame & ~fitted.hidden & ~photo.clipped.any(axis=2),
            problem.skin,
            EyesSeen.of((photo.mask.shape[0], photo.mask.shape[1]), problem.landmarks),
            photo.tinted,
        )
        parts = part_colors(forward, fitted.state, fitted.stage, look, problem.job.seed)
        vertices, told = vertices + parts.log_change, parts.told
        shade = None
        if parts.lid_shade is not None:
            shade = LidShade.of(problem.geometry, fitted.state, parts.lid_shade)
        eyes = eye_picture(
            problem.geometry,
            vertices,
            shade,
            iris_size(problem.geometry, fitted.state, problem.landmarks),
        )
    del shown  # what the largest maps need memory for
    give_back_freed_memory()
    logs = atlas.bake(vertices)
    hair = None if detail is None else detail.hair
    if detail is not None:
        keep_flesh(detail.log_albedo, atlas, problem.geometry)
        logs += detail.log_albedo
        if hair is not None:
            grow_stubble(logs, atlas, problem.geometry, hair)
        model, mean = problem.geometry.model, problem.geometry.mean
        draw_lash_line(logs, atlas, model, mean, problem.lash_depth)
        # Beyond the seams too, where lookups between texels reach.
        atlas.spread(logs)
    albedo = painted(logs)
    del logs
    if eyes is not None:
        albedo = eyes_painted(albedo, atlas, problem.geometry, eyes)
    textures = Textures(albedo, *_gloss_textures(small, problem, fitted, gloss, hair))
    if relief is not None:
        textures = replace(textures, normal=relief.normal, height=relief.height)
    tone = None if detail is None else detail.tone
    coverage = _coverage(atlas, small.size, detail, gloss)
    return Refined(textures, coverage, eyes, tone, hair, told)


def found_relief(
    problem: Problem, forward: ForwardModel, fitted: Fitted, shown: Shown, atlas: Atlas
) -> Relief | None:
    """What one photo says of the relief, unless the job holds the shape as it is."""
    if "relief" in problem.job.freeze:
        return None
    first = ReliefSeen(forward.geometry, atlas)
    first.add(shown, fitted.state)
    seen = first.again()
    if seen is None or first.found is None:
        return None
    _look_again(seen, problem, forward, fitted, shown, first.found)
    return seen.found


def relief_together(
    photos: Callable[[], Iterable[tuple[Problem, ForwardModel, Fitted]]], size: int
) -> ReliefSeen | None:
    """What several ``photos`` of one skin say of its relief, for textures of ``size`` texels; None
    where the jobs hold it. They are looked at twice.
    """
    first = None
    for problem, forward, fitted in photos():
        if {"albedo", "relief"} & set(problem.job.freeze):
            return None
        if first is None:
            first = ReliefSeen(forward.geometry, Atlas.build(forward.geometry, size))
        shown = what_is_shown(problem, forward, fitted)
        if shown is not None:
            first.add(shown, fitted.state)
    seen = None if first is None else first.again()
    if seen is None or first is None or first.found is None:
        return first
    for problem, forward, fitted in photos():
        shown = what_is_shown(problem, forward, fitted)
        if shown is not None:
            _look_again(seen, problem, forward, fitted, shown, first.found)
    return seen


def _look_again(
    seen: ReliefSeen,
    problem: Problem,
    forward: ForwardModel,
    fitted: Fitted,
    shown: Shown,
    relief: Relief,
) -> None:
    """Take up a photo's pixels with the light on ``relief``, traced."""
    shown = shown.thinned(LOOKED_AGAIN)
    image, surface = shown.image, relief.on(shown, forward.geometry, fitted.state)
    rougher = shown.rougher
    roughness = None if rougher is None else _rough(fitted.state.roughness + rougher)
    terms = light_on(problem, forward, fitted, surface, roughness, RAYS_AGAIN)
    lit = forward.shade(
        fitted.state,
        surface,
        terms,
        albedo=image.albedo,
        radiance=np.eye(3),
        c_spec=image.c_spec,
        spread=image.spread,
    )
    seen.add(shown, fitted.state, lit)


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
    return specular.astype(np.float32), _rough(roughness).astype(np.float32)


def _rough(values: Float[np.ndarray, " ..."]) -> Float[np.ndarray, " ..."]:
    return np.clip(values, brdf.ROUGHNESS_MIN, brdf.ROUGHNESS_MAX)


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

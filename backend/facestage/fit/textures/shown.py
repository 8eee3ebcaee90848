"""What the photo shows of the skin: its pixels, and the fitted light and shading there."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import binary_dilation, map_coordinates, maximum_filter, minimum_filter

from facestage.contract import brdf
from facestage.contract.arrays import Bool, Float, Float32, Int
from facestage.contract.face_model import SKIN
from facestage.fit.energy.landmark_term import LANDMARK_SIGMA_SHARE, landmark_pixels
from facestage.fit.face.state import State
from facestage.fit.forward.reflectance import Skin, by_albedo
from facestage.fit.forward.shading import ForwardModel, Image, Surface
from facestage.fit.given.face_areas import brow_pixels, lips_share, no_larger, opening_share
from facestage.fit.given.hanging_hair import darker_than, hanging_hair
from facestage.fit.given.problem import Problem
from facestage.fit.given.skin_mask import border_reach
from facestage.fit.textures.cast_shadow import shadow_depth
from facestage.fit.textures.creases import crease_depth
from facestage.fit.textures.lids_beside import lids_beside
from facestage.fit.textures.unseen_tone import FEATURE_MAX
from facestage.fit.trust.fitted import Fitted
from facestage.images.image_io import resize
from facestage.render.light_terms import PLAIN, Asked, LightTerms

# Shadow rays per light and pixel, and in all: where pixels are many, texels average over them.
SAMPLES, SHADOW_RAYS = 8, 2e7
BLOCK_PIXELS = 2**18  # that are lit at once
# Of a face of more pixels across than this, and than the largest texture shows, only every second,
# third, ... is looked at.
PIXELS_ACROSS = 1000.0
# Cosine between the view and the skin below which a pixel is not looked at, and above which it
# counts in full.
GRAZING, FACING = 0.15, 0.45
# Log albedo of black hair below that of light skin: how far a brow may depart from the skin; and of
# lashes, which are in their own shade.
BROW_DEPARTURE, LASH_DEPARTURE = 2.0, 4.0
# Of a larger face pixels are put together where hair that hangs before it is looked for.
HANGING_FACE_PX = 160.0
# By how much, in log radiance, what is darker than skin may be hair, and surely is.
HAIR_DARKER = 0.3, 0.7
# Of the depth of a shadow that skin is lifted out of, in log radiance.
SHADOW_DOUBT = 0.5
# Depths up to which what is seen in it counts in full, and from which on nothing.
SHADOW_BELIEVED = 1.0, 1.5


@dataclass(frozen=True)
class Shown:
    """Pixels of skin.

    ``image`` is the fitted model there, with the specular derivative by roughness.
    """

    image: Image
    uvs: Float[np.ndarray, "pixels 2"]
    photo: Float[np.ndarray, "pixels 3"]  # linear, out of shadows that the fit lacks
    clipped: Bool[np.ndarray, "pixels 3"]  # at least as bright as the photo says
    # 0..1 how well the pixel shows skin, and not at a grazing angle
    clear: Float[np.ndarray, " pixels"]
    doubt: Float[np.ndarray, " pixels"]  # of the shading's shape, see shading_doubt.py
    # how far log albedo may depart there from the skin: by what the mean face's does, where it
    # has brows or lips, and by a brow's around the brows' landmarks
    feature: Float[np.ndarray, " pixels"]
    lips: Float[np.ndarray, " pixels"]  # 0..1, how much of the pixel shows them
    # by how much log radiance lies below that beside a dark line, see creases.py
    crease: Float[np.ndarray, " pixels"]
    face_px: float  # how large the face is
    shift_px: int  # how far the fitted face may be off
    # 0 or more, by how much the log radiance was lifted at each pixel of the photo, see
    # cast_shadow.py
    lifted: Float32[np.ndarray, "height width"]
    hanging: Bool[np.ndarray, "height width"]  # hair before the face, see hanging_hair.py
    rougher: Float[np.ndarray, " pixels"] | None = None  # than the state's skin, see with_gloss

    @property
    def weight(self) -> Float[np.ndarray, " pixels"]:
        """0..1; 0 where any channel is clipped."""
        return self.clear * ~self.clipped.any(axis=1)

    @property
    def diffuse(self) -> Float[np.ndarray, "pixels 3"]:
        """Radiance of a white diffuser."""
        skin = self.image.skin
        return by_albedo(self.image.diffuse) * skin.sent / skin.albedo

    @property
    def lifted_there(self) -> Float[np.ndarray, " pixels"]:
        """By how much each pixel may have been lifted, at most."""
        column, row = self.image.surface.pixels.astype(int).T
        return self.lifted[row, column]

    @property
    def albedo(self) -> Float[np.ndarray, "pixels 3"]:
        """The basis' albedo."""
        return self.image.albedo

    @property
    def specular(self) -> Float[np.ndarray, "pixels 3"]:
        """Radiance of the highlights."""
        return self.image.skin.gloss(self.image.specular)

    def with_gloss(
        self, c_spec: Float[np.ndarray, " pixels"], roughness: Float[np.ndarray, " pixels"]
    ) -> Shown:
        """The same with c_spec and roughness changed by so much; to first order in the
        roughness.
        """
        image = self.image
        changed = np.clip(image.c_spec + c_spec, 0, brdf.SPECULAR_MAX)
        specular = np.maximum(
            image.specular + roughness[:, None] * image.terms.specular_by_roughness, 0
        )
        color = Skin(image.albedo, changed, image.excess).radiance(image.diffuse, specular)
        image = replace(image, c_spec=changed, specular=specular, color=color)
        return replace(self, image=image, rougher=roughness)

    def without_lights(self) -> Shown:
        """The same without what each light does alone, which is most of the memory."""
        terms = LightTerms.dark(0, 0, PLAIN)
        return replace(self, image=replace(self.image, terms=terms, spread=None))

    def thinned(self, pixels: int) -> Shown:
        """Every second pixel, third, ... along both axes, so that about ``pixels`` are left; light
        that spreads below the skin has arrived there.
        """
        image = self.image
        step = int(np.ceil(np.sqrt(len(self.uvs) / pixels)))
        if step == 1:
            return self
        place, _ = lattice(image.surface.pixels)
        kept = (place % step == 0).all(axis=1)
        image = replace(
            image,
            surface=image.surface.part(kept),
            terms=image.terms.part(kept),
            spread=None,
            excess=None if image.excess is None else image.excess[kept],
            **{
                name: getattr(image, name)[kept]
                for name in ("albedo", "c_spec", "diffuse", "specular", "color")
            },
        )
        names = ("uvs", "photo", "clipped", "clear", "doubt", "feature", "lips", "crease")
        rougher = None if self.rougher is None else self.rougher[kept]
        part = {name: getattr(self, name)[kept] for name in names}
        return replace(self, image=image, rougher=rougher, **part)

    def change_over_shift(
        self, values: Float[np.ndarray, " pixels"]
    ) -> Float[np.ndarray, " pixels"]:
        """By how much ``values`` vary within ``shift_px`` of each pixel: what a wrong
        place would change.
        """
        column, row = self.image.surface.pixels.astype(int).T
        row, column = row - row.min(), column - column.min()
        width = 2 * self.shift_px + 1
        high = np.full((row.max() + 1, column.max() + 1), -np.inf)
        low = np.full(high.shape, np.inf)
        high[row, column] = low[row, column] = values
        return (
            maximum_filter(high, width, mode="nearest") - minimum_filter(low, width, mode="nearest")
        )[row, column]


def lattice(pixels: Float[np.ndarray, "pixels 2"]) -> tuple[Int[np.ndarray, "pixels 2"], float]:
    """Columns and rows of ``pixels`` among those that are looked at, and how far these are apart:
    of a large photo every second is.
    """
    spaces = np.diff(np.unique(pixels[:, 0]))
    spacing = float(spaces.min()) if len(spaces) else 1.0
    return np.rint((pixels - pixels.min(axis=0)) / spacing).astype(int), spacing


def what_is_shown(problem: Problem, forward: ForwardModel, fitted: Fitted) -> Shown | None:
    """The pixels of the photo that show skin; None where there are none."""
    across = max(PIXELS_ACROSS, problem.fineness.painted_face_px)
    step = int(np.ceil(problem.face_size_px / across))
    box = forward.box(fitted.state, forward.geometry.fitted)
    mask = np.zeros(problem.photograph.mask.shape, bool)
    mask[box] = problem.photograph.mask[box]
    y, x = np.nonzero(mask[::step, ::step])
    surface = forward.surface(fitted.state, step * np.stack([x, y], axis=1) + 0.5, only_fitted=True)
    if not len(surface.pixels):
        return None
    with ThreadPoolExecutor(1) as beside:  # which needs no renderer
        paintable = beside.submit(lambda: problem.paintable)
        terms = light_on(problem, forward, fitted, surface)
    image = forward.shade(fitted.state, surface, terms, radiance=np.eye(3))
    width, height = problem.photograph.size
    column, row = surface.pixels.astype(int).T
    cosine = -np.einsum("px,px->p", surface.normals, surface.rays)
    # What hides the face may begin where the fitted part of it ends: hair, at the forehead.
    head = _skin_pixels(forward, fitted.state, box, border_reach(problem.face_size_px), step)
    # Teeth on lips that hang too low, and whites on lids, are no skin either.
    opened = opening_share((height, width), problem.landmarks)
    lids = lids_beside(
        surface.pixels,
        problem.landmarks,
        landmark_pixels(forward.geometry, problem.landmarks, fitted.state),
        problem.face_size_px,
        problem.lash_depth,
    )
    moved = surface.pixels, lids.shift
    skin = paintable.result() * problem.clear(head) * ~fitted.hidden * (1.0 - opened)
    skin = _read(skin, *moved)
    base = problem.geometry.log_albedo.mean(axis=1)
    departure = np.abs(base - np.median(base[problem.geometry.fitted_vertices]))
    painted = np.einsum("pi,pi->p", surface.weights, departure[surface.corners])
    photo = _read(problem.photograph.color, *moved)
    brows = brow_pixels((height, width), problem.landmarks)[row, column]
    beard = problem.beard.share[row, column] * (painted < FEATURE_MAX)
    clear = np.clip((cosine - GRAZING) / (FACING - GRAZING), 0, 1) * skin
    shift_px = max(round(LANDMARK_SIGMA_SHARE * problem.face_size_px), 1)
    lifted, lifted_here = shadow_depth(
        surface.pixels,
        _log_ratio(photo, image.color),
        clear,
        fitted.shadowed,
        problem.face_size_px,
        shift_px,
    )
    photo = photo * np.exp(lifted_here)[:, None]
    hanging = _hanging_hair(problem, surface.pixels, darker_than(photo, image.color))
    clear *= 1.0 - hanging[row, column]
    shown = Shown(
        image=image,
        uvs=forward.uvs(surface),
        photo=photo,
        clipped=_read(problem.photograph.clipped, *moved) > 0,
        clear=clear * np.interp(lifted[row, column], SHADOW_BELIEVED, (1.0, 0.0)),
        doubt=_shading_doubt(problem, fitted)[row, column],
        feature=np.maximum.reduce(
            [
                painted,
                BROW_DEPARTURE * hair_share(brows, photo, image.color),
                BROW_DEPARTURE * beard * hair_share(beard > 0, photo, image.color),
                LASH_DEPARTURE * lids.lashes * hair_share(lids.lashes > 0, photo, image.color),
            ]
        ),
        lips=lips_share((height, width), problem.landmarks)[row, column].astype(np.float64),
        crease=crease_depth(surface.pixels, photo, image.color, problem.face_size_px),
        face_px=problem.face_size_px,
        shift_px=shift_px,
        lifted=lifted,
        hanging=hanging > 0.5,
    )
    # Where the shadow ends, photo and fit may not agree; nor is it as smooth as it is taken for.
    depth = shown.lifted_there
    uneven = np.hypot(shown.change_over_shift(depth), SHADOW_DOUBT * depth)
    return replace(shown, doubt=np.hypot(shown.doubt, uneven))


def _hanging_hair(
    problem: Problem, pixels: Float[np.ndarray, "pixels 2"], darker: Float[np.ndarray, " pixels"]
) -> Float32[np.ndarray, "height width"]:
    """0..1, which pixels show hair that only the fitted light tells from skin, which the photo
    has ``darker`` at ``pixels``.
    """
    height, width = problem.photograph.mask.shape
    size, landmarks = no_larger(problem.landmarks, (height, width), HANGING_FACE_PX)
    column, row = (pixels * [size[0] / width, size[1] / height]).astype(int).T
    where, count = row * size[0] + column, size[0] * size[1]
    seen = np.bincount(where, minlength=count)
    mean = np.bincount(where, darker, count) / np.maximum(seen, 1)
    found = hanging_hair(
        mean.reshape(size[::-1]),
        seen.reshape(size[::-1]) > 0,
        resize((problem.paintable * problem.photograph.mask).astype(np.float32), *size) < 0.5,
        resize(problem.beard.share.astype(np.float32), *size) > 0.5,
        landmarks,
    )
    return resize(found.astype(np.float32), width, height)


def _skin_pixels(
    forward: ForwardModel, state: State, box: tuple[slice, slice], margin: int, step: int
) -> Bool[np.ndarray, "height width"]:
    """Where the whole head's skin lies, in a ``box`` and the ``margin`` around it, as every
    ``step``-th pixel has it.
    """
    height, width = state.camera.height, state.camera.width
    (top, bottom), (left, right) = (
        (max(side.start - margin, 0), min(side.stop + margin, end))
        for side, end in zip(box, (height, width), strict=True)
    )
    y, x = np.mgrid[top:bottom:step, left:right:step]
    hit = forward.hits(state, np.stack([x.ravel(), y.ravel()], axis=1) + 0.5).triangle
    result = np.zeros((height, width), bool)
    result[y, x] = ((hit >= 0) & (forward.geometry.triangle_part[hit] == SKIN)).reshape(y.shape)
    # Every pixel between those that are looked at, too.
    return binary_dilation(result, np.ones((step, step))) if step > 1 else result


def _read(
    picture: np.ndarray, pixels: Float[np.ndarray, "pixels 2"], shift: Float[np.ndarray, "pixels 2"]
) -> np.ndarray:
    """(pixels, ...) float64, a ``picture`` (height, width, ...) as far beside ``pixels``, whose
    centres are at halves, as the ``shift``, between its own.
    """
    column, row = pixels.astype(int).T
    read = picture[row, column].astype(np.float64)
    moved = shift.any(axis=1)
    at = (pixels[moved] + shift[moved] - 0.5).T[::-1]
    channels, values = np.atleast_3d(picture), read.reshape(len(pixels), -1)
    for k in range(values.shape[1]):
        values[moved, k] = map_coordinates(
            channels[..., k], at, np.float64, order=1, mode="nearest"
        )
    return read


def light_on(
    problem: Problem,
    forward: ForwardModel,
    fitted: Fitted,
    surface: Surface,
    roughness: Float[np.ndarray, " pixels"] | None = None,
    rays: float = SHADOW_RAYS,
) -> LightTerms:
    """The fitted lights on a surface, together, with all derivatives; ``roughness``: another than
    the state's; ``rays``: towards the lights, in all.
    """
    samples = int(np.clip(rays / max(len(surface.pixels) * len(fitted.stage), 1), 1, SAMPLES))
    # What each light does alone would be most of the memory.
    parts = []
    for start in range(0, len(surface.pixels), BLOCK_PIXELS):
        block = slice(start, start + BLOCK_PIXELS)
        terms = forward.light_terms(
            fitted.state,
            surface.part(block),
            fitted.stage,
            samples,
            problem.job.seed,
            Asked(by_roughness=True, by_surface=True),
            roughness=None if roughness is None else roughness[block],
        )
        parts.append(terms.under(fitted.stage.radiance))
        forward.tracer.release()
    return LightTerms.joined(parts)


def hair_share(
    where: Bool[np.ndarray, " pixels"],
    photo: Float[np.ndarray, "pixels 3"],
    rendered: Float[np.ndarray, "pixels 3"],
) -> Float[np.ndarray, " pixels"]:
    """0..1, how surely a pixel shows a brow or lashes: it lies ``where`` they may be, and is darker
    than bare skin is ``rendered`` under the same light.
    """
    darker = -_log_ratio(photo, rendered)
    return np.where(where, np.interp(darker, HAIR_DARKER, (0.0, 1.0)), 0.0)


def _log_ratio(
    photo: Float[np.ndarray, "pixels 3"], rendered: Float[np.ndarray, "pixels 3"]
) -> Float[np.ndarray, " pixels"]:
    """Of the radiance in the ``photo`` over what is ``rendered``."""
    seen, expected = photo.mean(axis=1), rendered.mean(axis=1)
    return np.asarray(np.log(np.maximum(seen, 1e-9)) - np.log(np.maximum(expected, 1e-9)))


def _shading_doubt(problem: Problem, fitted: Fitted) -> Float[np.ndarray, "height width"]:
    """At the photo's size, see shading_doubt.py; 0 where nothing is known of it."""
    width, height = problem.photograph.size
    if fitted.shading_doubt is None:
        return np.zeros((height, width))
    return resize(fitted.shading_doubt.astype(np.float32), width, height)

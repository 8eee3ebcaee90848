"""Full-size pictures of a fitted face: anti-aliased renders, and the stage as an environment
map.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from facestage.contract.arrays import Bool, Float, Float32, Int
from facestage.contract.face_model import SKIN
from facestage.contract.light_stage import LightStage
from facestage.contract.relight_cache import RelightCache
from facestage.fit.face.state import State
from facestage.fit.forward.one_light import OneLightImages
from facestage.fit.forward.penumbras import Penumbras
from facestage.fit.forward.reflectance import Skin
from facestage.fit.forward.scattered_picture import LatticeLight
from facestage.fit.forward.shading import ForwardModel, Surface, sample_bilinear
from facestage.fit.forward.surface_frame import FrameField

# Shadow rays that a picture may cost at most; larger photos get fewer samples, never fewer pixels.
RAYS = 2.5e7
# Of points and lights that are worked on at a time.
BLOCK_PAIRS, LEAST_POINTS = 4_000_000, 1000
# Of eyes and of what lips leave open, which are few pixels, in shadows full of edges.
WET_SAMPLES = 12
# Of a pixel and a light that is grainy there: as many as cost no more than all others where a
# twentieth is grainy, within these; and of a part of a pixel twice as many as others have, up to 8.
GRAINY_SAMPLES, GRAINY_SHARE, PART_SAMPLES = (8, 20), 0.05, 8
PROBE_HEIGHT = 128


@dataclass(frozen=True)
class Textures:
    """The maps of the atlas, row 0 at v = 1, by the names of TEXTURE_MAPS."""

    albedo: Float[np.ndarray, "_ _ 3"]
    specular: Float[np.ndarray, "_ _"]  # c_spec
    roughness: Float[np.ndarray, "_ _"] | None = None  # None: the state's one value
    normal: Float[np.ndarray, "_ _ 3"] | None = None  # tangent space, 0 to 1; None: the mesh's own
    height: Float[np.ndarray, "_ _"] | None = None  # mm, what the normals are those of; not drawn

    @property
    def known(self) -> dict[str, Float[np.ndarray, "_ _ ..."]]:
        """All that there are, by name."""
        return {name: values for name, values in vars(self).items() if values is not None}


@dataclass(frozen=True)
class Picture:
    """A rendered photo-sized image."""

    color: Float32[np.ndarray, "height width 3"]  # linear, 0 where nothing is hit
    coverage: Float32[np.ndarray, "height width"]  # share of the pixel that the head covers
    fitted: Bool[np.ndarray, "height width"]  # skin of the face all over the pixel
    relit: dict[
        str, Float32[np.ndarray, "height width 3"]
    ]  # by name: the same face under other radiance
    samples: int = 0  # shadow rays per light and sub-pixel
    by_light: OneLightImages | None = None  # when asked for

    def relight_cache(self, fingerprint: str) -> RelightCache | None:
        """The picture under every light of its stage, when each light's image was asked for."""
        return (
            None
            if self.by_light is None
            else self.by_light.cache(self.coverage, self.samples, fingerprint)
        )


def face_pixels(forward: ForwardModel, state: State) -> Int[np.ndarray, "pixels 2"]:
    """Columns and rows of the pixels in the head's bounding box."""
    y, x = np.mgrid[forward.box(state)]
    return np.stack([x.ravel(), y.ravel()], axis=1)


def render_picture(
    forward: ForwardModel,
    state: State,
    stage: LightStage,
    textures: Textures,
    seed: int = 0,
    samples: int | None = None,
    relight: Mapping[str, Float[np.ndarray, "lights 3"]] | None = None,
    by_light: bool = False,
    *,
    rays: float = RAYS,
) -> Picture:
    """Render every part of the head with its textures and the direct light of ``stage``.

    ``stage`` holds the lit lights in the camera frame; its radiance is used. ``samples`` per light
    and sub-pixel; by default what so many ``rays`` allow. ``relight``: other radiances by name,
    which cost no further rays because the image is linear in the lights. ``by_light`` keeps each
    light's image as well.
    """
    height, width = state.camera.height, state.camera.width
    radiances = {"": stage.radiance} | dict(relight or {})
    colors = {name: np.zeros((height, width, 3), np.float32) for name in radiances}
    coverage, fitted = np.zeros((height, width), np.float32), np.zeros((height, width), np.float32)
    pixels = face_pixels(forward, state)
    each, images = 0, OneLightImages(state.camera, pixels, len(stage)) if by_light else None
    if len(pixels):
        per_light = rays / (len(pixels) * max(len(stage), 1))
        grid = 3 if per_light >= 27 else 2 if per_light >= 4 else 1
        each = samples or int(np.clip(per_light / grid**2, 1, 16))
        below = None
        if state.scattering > 0:
            below = LatticeLight.under(forward, state, stage, pixels, seed)
        penumbras = None
        if samples is None:
            again = int(np.clip(per_light / GRAINY_SHARE, *GRAINY_SAMPLES)) // grid**2
            again = max(again, min(2 * each, PART_SAMPLES))
            brightness = [radiance.mean(axis=1) for radiance in radiances.values()]
            if by_light:
                brightness.append(np.ones(len(stage)))
            penumbras = Penumbras(forward, state, stage, np.stack(brightness), again)
        for sub in range(grid * grid):
            offset = (np.array([sub % grid, sub // grid]) + 0.5) / grid
            surface = forward.surface(state, pixels + offset)
            if textures.normal is not None:
                frames = FrameField.of(forward.geometry, surface.model_vertices)
                surface = frames.mapped(
                    surface, forward.uvs(surface), textures.normal, state.rotation
                )
            for block, count in _blocks(forward, surface, len(stage), each):
                x, y = block.pixels.astype(int).T
                uvs = forward.uvs(block)
                rough = (
                    None if textures.roughness is None else sample_bilinear(textures.roughness, uvs)
                )
                terms = forward.light_terms(state, block, stage, count, seed + sub, roughness=rough)
                if penumbras is not None and penumbras.samples > count:
                    terms = penumbras.smoothed(terms, block, seed + sub, rough)
                albedo, c_spec = (
                    sample_bilinear(textures.albedo, uvs),
                    sample_bilinear(textures.specular, uvs),
                )
                spread = None if below is None else below.at(block)
                if images is not None:
                    skin = Skin(albedo, c_spec, forward.excess(state, block))
                    images.add(x, y, 1.0 / grid**2, terms, skin, spread)
                for name, radiance in radiances.items():
                    image = forward.shade(state, block, terms, albedo, radiance, c_spec, spread)
                    colors[name][y, x] += image.color / grid**2
                coverage[y, x] += 1.0 / grid**2
                fitted[y, x] += forward.geometry.fitted[block.triangle] / grid**2
    return Picture(colors.pop(""), coverage, fitted > 1 - 1e-3, colors, each, images)


def _blocks(
    forward: ForwardModel, surface: Surface, lights: int, samples: int
) -> Iterator[tuple[Surface, int]]:
    """The surface in pieces, with the samples of each."""
    wet = forward.geometry.triangle_part[surface.triangle] != SKIN
    step = max(BLOCK_PAIRS // lights, LEAST_POINTS)
    for pixels, least in ((~wet, 0), (wet, WET_SAMPLES)):
        index = np.flatnonzero(pixels)
        for start in range(0, len(index), step):
            yield surface.part(index[start : start + step]), max(samples, least)


def light_probe(
    stage: LightStage, height: int = PROBE_HEIGHT
) -> Float32[np.ndarray, "height width 3"]:
    """Lat-long map of what the stage's centre sees; stage frame, +Z at the
    middle, +Y up.

    To the right of +Z lies -X, as one sees it from inside and as environment maps have it. Each
    texel averages four directions, so that a light's edge is not a stair.
    """
    result = np.zeros((height, 2 * height, 3))
    for sub in range(4):
        row = (np.arange(height) + 0.25 + 0.5 * (sub // 2)) / height
        column = (np.arange(2 * height) + 0.25 + 0.5 * (sub % 2)) / (2 * height)
        elevation, azimuth = np.pi * (0.5 - row)[:, None], 2 * np.pi * (0.5 - column)[None, :]
        towards = np.stack(
            np.broadcast_arrays(
                np.cos(elevation) * np.sin(azimuth),
                np.sin(elevation),
                np.cos(elevation) * np.cos(azimuth),
            ),
            axis=-1,
        )
        nearest = np.full(towards.shape[:2], np.inf)
        color = np.zeros_like(towards)
        for index in range(len(stage)):
            facing = towards @ stage.direction[index]
            distance = (stage.position[index] @ stage.direction[index]) / np.where(
                facing < -1e-9, facing, np.nan
            )
            offset = towards * distance[..., None] - stage.position[index]
            half = 0.5 * stage.side[index]
            inside = (np.abs(offset @ stage.axis_x[index]) <= half) & (
                np.abs(offset @ stage.axis_y[index]) <= half
            )
            seen = inside & (distance > 0) & (distance < nearest)
            color[seen] = stage.radiance[index]
            nearest[seen] = distance[seen]
        result += 0.25 * color
    return result.astype(np.float32)

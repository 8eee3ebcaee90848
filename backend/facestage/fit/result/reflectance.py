"""The reflectance field of a fitted face, and the face under any distant light by it.

Distant light is a sum of functions on the sphere: one for each direction of a lattice, 1 there and
0 at its neighbours, linear on the triangles between them. What a map of the surroundings sends to
the face keeps its strength and, nearly, its direction that way, wherever between the lattice's
directions it comes from; a light that moves fades from one picture into the next.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path, PurePath

import numpy as np
from scipy.spatial import ConvexHull

from facestage.contract.arrays import Float, Float32
from facestage.contract.environment import directions as map_directions
from facestage.contract.environment import lights_all_around, texel_angles
from facestage.contract.errors import InputError
from facestage.contract.events import DONE, PROGRESS, STARTED, Event
from facestage.contract.files.atomic import atomic_folder
from facestage.contract.light_stage import LightStage, selected
from facestage.contract.reflectance import (
    DIRECTIONS_LEAST,
    DIRECTIONS_MOST,
    FILE,
    ReflectanceField,
    is_field,
)
from facestage.contract.result import Result
from facestage.fit.forward.one_light import NUMBERS_MAX
from facestage.fit.forward.rendering import face_pixels, render_picture
from facestage.fit.result.relight import check_samples, prepared
from facestage.images.image_io import read_exr, resize, write_exr

RADIUS = 100.0  # m: as good as infinitely far from a head, near enough for single floats
# Rows that a map is reduced to: of 0.7 degrees, where 400 directions are ten apart.
MAP_ROWS = 256
STAGE = "reflectance"
IMAGE = "light-{:04d}.exr"


def make_field(
    folder: Path,
    out: Path,
    count: int,
    samples: int,
    emit: Callable[[Event], None] = lambda event: None,
) -> ReflectanceField:
    """Render the result in ``folder`` under light from each of ``count`` directions (an even
    number) alone, into the folder ``out``. Raises InputError.
    """
    if not DIRECTIONS_LEAST <= count <= DIRECTIONS_MOST or count % 2:
        raise InputError(
            f"--directions is {count}; expected an even number of {DIRECTIONS_LEAST} to "
            f"{DIRECTIONS_MOST}."
        )
    check_samples(samples)
    if out.exists() and not (out.is_dir() and (is_field(out) or not any(out.iterdir()))):
        raise InputError(
            f"The output '{out}' is not a reflectance field; choose a new or empty folder."
        )
    started = time.monotonic()
    emit(Event(STARTED, STAGE, message="reading the result"))
    result = Result.load(folder)
    stage = distant_lights(count)
    images = tuple(IMAGE.format(number) for number in range(1, count + 1))
    field = ReflectanceField(
        model=result.model,
        camera=result.camera,
        camera_to_stage=result.camera_to_stage,
        directions=-stage.direction,
        solid_angles=solid_angles(-stage.direction),
        images=images,
        samples=samples,
        folder=out,
    )
    with atomic_folder(out, is_field_file) as temporary:
        for done, image in enumerate(_one_light(result, stage, samples), 1):
            write_exr(temporary / images[done - 1], image)
            seconds = time.monotonic() - started
            left = seconds / done * (count - done)
            words = f"{done} of {count} directions"
            emit(Event(PROGRESS, STAGE, done, None, seconds, left, done / count, message=words))
        field.write_into(temporary)
    emit(Event(DONE, STAGE, count, seconds=time.monotonic() - started, fraction=1.0))
    return field


def is_field_file(path: PurePath) -> bool:
    """Whether a file of a reflectance field has this path, relative to the field's folder."""
    own = path.name == FILE or (path.name.startswith("light-") and path.suffix == ".exr")
    return len(path.parts) == 1 and own


def distant_lights(count: int) -> LightStage:
    """Squares of radiance 1 far away in all directions (stage frame), each as large as the solid
    angle that is its own.
    """
    lattice = lights_all_around(count, RADIUS, 1.0)
    # A square of the side s at the distance R covers 4 asin(q / (q + R^2)), q = (s / 2)^2.
    sine = np.sin(solid_angles(-lattice.direction) / 4)
    side = 2 * RADIUS * np.sqrt(sine / (1 - sine))
    return replace(lattice, side=side, radiance=np.ones((count, 3)))


def solid_angles(towards: Float[np.ndarray, "lights 3"]) -> Float[np.ndarray, " lights"]:
    """The integral of each direction's function over the sphere, sr; their sum is 4 pi."""
    return shares(towards, np.ones((MAP_ROWS, 2 * MAP_ROWS, 1)), 0.0)[:, 0]


def shares(
    towards: Float[np.ndarray, "lights 3"],
    picture: Float[np.ndarray, "height width channels"],
    degrees: float,
) -> Float[np.ndarray, "lights channels"]:
    """What a map sends by each direction's function: the integral of radiance times function.

    ``towards``: unit, stage frame, all around; ``picture``: latitude and longitude, turned by
    ``degrees`` about the vertical as :func:`.environment.directions` has it.
    """
    height, width, channels = picture.shape
    hull = ConvexHull(towards)
    corners = hull.simplices  # (triangles, 3)
    to_weights = np.linalg.inv(towards[corners].swapaxes(1, 2))
    # A ray leaves through the facet whose plane n . x = d it meets first, where n . ray / d is
    # largest.
    planes = hull.equations[:, :3] / -hull.equations[:, 3:]
    texels = map_directions(height, width, degrees).reshape(-1, 3)
    flux = texel_angles(height, width)[:, None] * picture.reshape(-1, channels)
    total = np.zeros((len(towards), channels))
    for start in range(0, len(texels), width):  # a row at a time, for the memory's sake
        rays = texels[start : start + width]
        facet = np.argmax(rays @ planes.T, axis=1)
        weights = np.maximum(np.einsum("tij,tj->ti", to_weights[facet], rays), 0.0)
        weights /= weights.sum(axis=1, keepdims=True)
        for corner in range(3):
            part = weights[:, corner, None] * flux[start : start + width]
            np.add.at(total, corners[facet, corner], part)
    return total


def relit_by_map(
    field: ReflectanceField, picture: Float[np.ndarray, "height width 3"], degrees: float = 0.0
) -> Float32[np.ndarray, "rows columns 3"]:
    """The face under a map of linear radiance, 0 where the head is not. Raises InputError for
    pictures of the field that are missing or of another size.
    """
    assert field.folder is not None
    radiance = shares(field.directions, resampled(picture), degrees) / field.solid_angles[:, None]
    size = (field.camera.height, field.camera.width, 3)
    total = np.zeros(size, np.float32)
    for name, each in zip(field.images, radiance.astype(np.float32), strict=True):
        image = read_exr(field.folder / name)
        if image.shape != size:
            raise InputError(
                f"The picture '{field.folder / name}' has {image.shape[1]} x {image.shape[0]} "
                f"pixels, expected {size[1]} x {size[0]}; make the field again."
            )
        total += each * image
    return total


def resampled(picture: Float[np.ndarray, "height width 3"]) -> Float[np.ndarray, "rows columns 3"]:
    """A map of about MAP_ROWS rows, none of it negative: texels of a coarse one are divided."""
    height, width = picture.shape[:2]
    picture = np.maximum(picture, 0.0)
    if height <= MAP_ROWS:
        times = MAP_ROWS // height
        return picture.repeat(times, axis=0).repeat(times, axis=1)
    return resize(picture, max(round(width * MAP_ROWS / height), 1), MAP_ROWS)


def _one_light(
    result: Result, stage: LightStage, samples: int
) -> Iterator[Float32[np.ndarray, "rows columns 3"]]:
    """The result under each light of ``stage`` (stage frame) alone, at radiance 1."""
    lit = replace(result, stage=stage)
    forward, state, placed, textures = prepared(lit, np.ones(len(stage), bool))
    camera = state.camera
    pixels = max(len(face_pixels(forward, state)), 1)
    step = int(np.clip(NUMBERS_MAX / (3 * pixels), 1, len(stage)))
    for start in range(0, len(stage), step):
        part = selected(placed, np.arange(start, min(start + step, len(stage))))
        picture = render_picture(
            forward, state, part, textures, result.seed + start, samples, by_light=True
        )
        found = picture.by_light
        assert found is not None
        for light in range(len(part)):
            image = np.zeros((camera.height * camera.width, 3), np.float32)
            image[found.pixels] = found.colors[:, :, light].T
            yield image.reshape(camera.height, camera.width, 3)

"""Render a finished result again: other lights, other weights."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.errors import InputError
from facestage.contract.face_model import FaceModel
from facestage.contract.files.atomic import atomic_file
from facestage.contract.files.color import linear_to_srgb
from facestage.contract.files.paths import is_file
from facestage.contract.light_stage import ON, RADIANCE_MAX, LightStage
from facestage.contract.parameters import WEIGHT_MAX
from facestage.contract.relight_cache import RelightCache, relight_fingerprint
from facestage.contract.result import NAMES_MAX, Result
from facestage.contract.schemas.array_field import Array
from facestage.contract.schemas.fields import Number, Table
from facestage.contract.schemas.schema import HandWritten, checked
from facestage.contract.texture_maps import FOLD_MAP, TEXTURE_MAPS
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import from_kept
from facestage.fit.forward.lamp_derivatives import AXES
from facestage.fit.forward.one_light import NUMBERS_MAX, relight_scale
from facestage.fit.forward.rendering import Textures, face_pixels, render_picture
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.problem import select_lights
from facestage.fit.result.memory import check_picture, machine_memory
from facestage.fit.textures.expression_folds import without
from facestage.images.image_io import read_exr, resize, write_exr
from facestage.models.registry import load_model
from facestage.render.variant import start_renderer

OUTPUTS = (".exr", ".png")
# Pixels of the head's box that are traced at most.
PICTURE_PIXELS = 1_600_000
SAMPLES = 16  # shadow rays per light and sub-pixel of a picture that is traced


def render_result(
    folder: Path,
    out: Path,
    lights: dict[str, Any] | None,
    weights: dict[str, Any] | None,
    samples: int | None,
) -> None:
    """Write a picture of the result in ``folder``. Raises InputError for a wrong file or name.

    Other lights come from the result's relight cache, which is made when there is none; see
    :func:`relit`. ``samples`` per light and sub-pixel; None: as many as the cache has, or SAMPLES.
    """
    check_output(out)
    check_samples(samples)
    result = Result.load(folder)
    if lights is not None:
        # A light that was off in the fit is dark in the result, but may be turned on now.
        radiance = checked(
            LightsFile(lights=len(result.stage)), lights, "The light file (--lights)"
        )["radiance"]
        stage = replace(result.stage, radiance=radiance, state=np.full(len(radiance), ON))
        result = replace(result, stage=stage)
    if weights is not None:
        color = render(with_weights(result, weights), samples or SAMPLES)
    else:
        color = relit(result, samples, make=lights is not None)
    write_picture(out, color)


def with_weights(result: Result, weights: dict[str, Any]) -> Result:
    """The result with some weights as a weight file says. Raises InputError."""
    given = checked(WeightsFile(), weights, "The weight file (--weights)")
    return replace(
        result,
        identity=_weights(given["identity"], "identity", result.identity_names, result.identity),
        expression=_weights(
            given["expression"], "expression", result.expression_names, result.expression
        ),
    )


def write_picture(out: Path, color: Float[np.ndarray, "height width 3"]) -> None:
    """Write linear RGB as .exr, or sRGB as .png. Raises InputError for another suffix."""
    check_output(out)
    if out.suffix.lower() == ".exr":
        write_exr(out, color)
    else:
        from PIL import Image

        pixels = np.round(255 * linear_to_srgb(np.clip(color, 0, 1))).astype(np.uint8)
        with atomic_file(out) as temporary:
            Image.fromarray(pixels).save(temporary)


def relit(
    result: Result, samples: int | None, make: bool, numbers_max: float = NUMBERS_MAX
) -> np.ndarray:
    """(h, w, 3) the result under its stage's radiance, from the relight cache where that has the
    photo's size.

    A cache that is missing, damaged, stale, or of fewer than ``samples`` is not used; ``make``
    writes one then.
    """
    try:
        cache = RelightCache.load(result)
        if (cache.width, cache.height) == (
            result.camera.width,
            result.camera.height,
        ) and cache.samples >= (samples or 0):
            return cache.relight(result.stage.radiance)
    except InputError:
        pass  # it is only a cache: what is wrong with the result itself, tracing says
    if make:
        traced = trace_lights(result, samples or SAMPLES, numbers_max=numbers_max)
        if traced is not None:
            # Without the right to write into the folder, the picture is none the worse.
            with suppress(InputError, OSError):
                traced.save(_folder(result))
            return traced.relight(result.stage.radiance)
    return render(result, samples or SAMPLES)


def make_cache(folder: Path, samples: int | None, numbers_max: float = NUMBERS_MAX) -> None:
    """Write the relight cache of the result in ``folder``, smaller than the photo where that is
    large.

    ``numbers_max`` that its images may hold.
    """
    check_samples(samples)
    result = Result.load(folder)
    traced = trace_lights(result, samples or SAMPLES, shrink=True, numbers_max=numbers_max)
    assert traced is not None
    traced.save(folder)


def trace_lights(
    result: Result, samples: int, shrink: bool = False, numbers_max: float = NUMBERS_MAX
) -> RelightCache | None:
    """The result under each of its lights alone; None where that is too large and must not
    ``shrink``.
    """
    forward, state, stage, textures = prepared(result, np.ones(len(result.stage), bool))
    factor = relight_scale(len(face_pixels(forward, state)), len(stage), numbers_max)
    if factor < 1:
        if not shrink:
            return None
        state = replace(state, camera=state.camera.scaled(factor))
    picture = render_picture(forward, state, stage, textures, result.seed, samples, by_light=True)
    return picture.relight_cache(relight_fingerprint(result))


def render(result: Result, samples: int) -> np.ndarray:
    """(h, w, 3) the result's face under its stage, of the photo's size; a large one is traced
    smaller and enlarged.
    """
    lit = result.stage.radiance.max(axis=1) > 0
    if not lit.any():
        lit[0] = True  # a dark face is still a picture
    forward, state, stage, textures = prepared(result, lit)
    factor = min(1.0, float(np.sqrt(PICTURE_PIXELS / max(len(face_pixels(forward, state)), 1))))
    camera = state.camera
    state = replace(state, camera=camera if factor == 1 else camera.scaled(factor))
    color = render_picture(forward, state, stage, textures, result.seed, samples).color
    return color if factor == 1 else resize(color, camera.width, camera.height)


def prepared(result: Result, lit: np.ndarray) -> tuple[ForwardModel, State, LightStage, Textures]:
    """What renders the result under the lights ``lit`` (N,): forward model, state, stage (camera
    frame), textures.
    """
    check_picture(result.camera.width, result.camera.height, machine_memory())
    model = load_model(result.model)
    _check_model(result, model)
    start_renderer("auto")
    folder = _folder(result)
    textures = Textures(
        **{
            each.name: read_exr(folder / each.file)[..., slice(None) if each.channels == 3 else 0]
            for each in TEXTURE_MAPS
            if each.required or is_file(folder / each.file)
        }
    )
    relief = np.zeros((0, len(model.vertices), 3)) if result.relief is None else result.relief[None]
    geometry = FaceGeometry(model, relief.astype(np.float32))
    if result.folds is not None and is_file(folder / FOLD_MAP.file):
        textures = replace(textures, albedo=_less_folds(result, geometry, textures.albedo))
    stage = select_lights(result.stage, lit).transformed(np.linalg.inv(result.camera_to_stage))
    forward = ForwardModel(
        geometry, LightParameters(np.zeros(len(stage), bool), stage.radiance, uniform=False)
    )
    matrix = result.model_to_camera
    state = State(
        rotation=matrix[:3, :3],
        translation=matrix[:3, 3],
        camera=result.camera,
        lights=np.zeros(0),
        light_position=np.zeros((len(stage), AXES)),
        relief=np.ones(len(relief)),
        **from_kept(result.parameters),
    )
    return forward, state, stage, textures


def _less_folds(
    result: Result, geometry: FaceGeometry, albedo: Float[np.ndarray, "texels texels 3"]
) -> Float[np.ndarray, "texels texels 3"]:
    """The ``albedo`` without the folds that the expression no longer makes."""
    path = _folder(result) / FOLD_MAP.file
    ratio = read_exr(path)
    if ratio.shape[0] != ratio.shape[1]:
        raise InputError(
            f"The result's picture '{path}' has {ratio.shape[1]} x {ratio.shape[0]} pixels, "
            "expected a square; run the fit again."
        )
    assert result.folds is not None
    return without(albedo, ratio, result.folds.gone(result.expression), geometry)


def _folder(result: Result) -> Path:
    assert result.folder is not None
    return result.folder


def check_output(out: Path) -> None:
    """Raise InputError unless a picture's name ends as it has to."""
    if out.suffix.lower() not in OUTPUTS:
        raise InputError(f"The output '{out}' does not end in {' or '.join(OUTPUTS)}.")


def check_samples(samples: int | None) -> None:
    """Raise InputError for a number of shadow samples that cannot be."""
    if samples is not None and not 1 <= samples <= 4096:
        raise InputError(f"--spp is {samples}; expected 1 to 4096.")


class LightsFile(HandWritten):
    """A light file, for a stage with a known number of lights."""

    radiance = Array(
        ("lights", 3),
        minimum=0,
        maximum=RADIANCE_MAX,
        words="one [r, g, b] of numbers of 0 or more for each light",
    )


class WeightsFile(HandWritten):
    """A weight file; which names there are, the result says."""

    identity = Table(Number(-WEIGHT_MAX, WEIGHT_MAX), NAMES_MAX, load_default=dict)
    expression = Table(Number(-WEIGHT_MAX, WEIGHT_MAX), NAMES_MAX, load_default=dict)


def _weights(
    given: Mapping[str, float], kind: str, names: tuple[str, ...], current: np.ndarray
) -> np.ndarray:
    result = current.copy()
    for name, value in given.items():
        if name not in names:
            raise InputError(
                f"The weight file names the {kind} '{name}'; this face model has: "
                f"{', '.join(names[:8])}, ..."
            )
        result[names.index(name)] = value
    return result


def _check_model(result: Result, model: FaceModel) -> None:
    """Raise InputError unless the result's numbers are those of the model that its name stands for
    now.
    """
    shapes = {
        "vertices": (len(result.vertices), len(model.vertices)),
        "identity modes": (len(result.identity), len(model.identity_names)),
        "expressions": (len(result.expression), len(model.expression_names)),
        "colors": (len(result.albedo), len(model.albedo_basis)),
    }
    for what, (found, wanted) in shapes.items():
        if found != wanted:
            raise InputError(
                f"The result has {found} {what}, the face model '{result.model}' has {wanted}: it "
                "is another one by now; run the fit again."
            )

"""Render a finished result again: other lights, other weights."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.result import Result
from facestage.contract.storage import atomic_file
from facestage.fit.geometry import FaceGeometry
from facestage.fit.light_position import AXES
from facestage.fit.parameters import LightParameters, State
from facestage.fit.problem import select_lights
from facestage.fit.rendering import Picture, Textures, render_picture
from facestage.fit.shading import ForwardModel
from facestage.image_io import linear_to_srgb, read_exr, write_exr
from facestage.models.registry import load_model
from facestage.render.variant import start_renderer

OUTPUTS = (".exr", ".png")


def render_result(
    folder: Path, out: Path, lights: dict[str, Any] | None, weights: dict[str, Any] | None, samples: int
) -> None:
    """Write a picture of the result in ``folder``. Raises InputError for a wrong file or name."""
    if out.suffix.lower() not in OUTPUTS:
        raise InputError(f"The output '{out}' does not end in {' or '.join(OUTPUTS)}.")
    if not 1 <= samples <= 4096:
        raise InputError(f"--spp is {samples}; expected 1 to 4096.")
    result = Result.load(folder)
    if lights is not None:
        result = replace(result, stage=result.stage.with_radiance(_radiance(lights, len(result.stage))))
    if weights is not None:
        unknown = sorted(set(weights) - {"identity", "expression"})
        if unknown:
            raise InputError(f"The weight file has the key '{unknown[0]}'; expected expression and identity.")
        result = replace(
            result,
            identity=_weights(weights, "identity", result.identity_names, result.identity),
            expression=_weights(weights, "expression", result.expression_names, result.expression),
        )
    picture = render(result, samples)
    if out.suffix.lower() == ".exr":
        write_exr(out, picture.color)
    else:
        from PIL import Image

        pixels = np.round(255 * linear_to_srgb(np.clip(picture.color, 0, 1))).astype(np.uint8)
        with atomic_file(out) as temporary:
            Image.fromarray(pixels).save(temporary)


def render(result: Result, samples: int) -> Picture:
    """The result's face under its stage, at the photo's size."""
    assert result.folder is not None
    start_renderer("auto")
    textures = Textures(read_exr(result.folder / "albedo.exr"), read_exr(result.folder / "specular.exr")[..., 0])
    geometry = FaceGeometry(load_model(result.model))
    lit = result.stage.radiance.max(axis=1) > 0
    if not lit.any():
        lit[0] = True  # a dark face is still a picture
    stage = select_lights(result.stage, lit).transformed(np.linalg.inv(result.camera_to_stage))
    forward = ForwardModel(geometry, LightParameters(np.zeros(len(stage), bool), stage.radiance, uniform=False))
    matrix = result.model_to_camera
    state = State(
        matrix[:3, :3], matrix[:3, 3], result.camera, result.identity, result.expression, np.zeros(0),
        np.zeros((len(stage), AXES)), result.albedo, result.roughness, result.specular,
    )  # fmt: skip
    return render_picture(forward, state, stage, textures, result.seed, samples)


def _radiance(data: dict[str, Any], count: int) -> np.ndarray:
    try:
        radiance = np.array(data["radiance"], dtype=float)
    except KeyError as error:
        raise InputError('The light file lacks "radiance": [[r, g, b], ...], one row per light.') from error
    except (TypeError, ValueError) as error:
        raise InputError(f"The light file's radiance is not a list of [r, g, b] numbers ({error}).") from error
    if radiance.shape != (count, 3) or not np.isfinite(radiance).all() or (radiance < 0).any():
        raise InputError(
            f"The light file's radiance has shape {radiance.shape}; expected ({count}, 3) finite numbers of 0 or more."
        )
    return radiance


def _weights(data: dict[str, Any], kind: str, names: tuple[str, ...], current: np.ndarray) -> np.ndarray:
    result = current.copy()
    given = data.get(kind, {})
    if not isinstance(given, dict):
        raise InputError(f"The weight file's {kind} is a {type(given).__name__}, expected {{name: weight}}.")
    for name, value in given.items():
        if name not in names:
            raise InputError(
                f"The weight file names the {kind} '{name}'; this face model has: {', '.join(names[:8])}, ..."
            )
        if not isinstance(value, int | float) or not np.isfinite(value):
            raise InputError(f"The weight of {kind} '{name}' is {value!r}; expected a number.")
        result[names.index(name)] = value
    return result

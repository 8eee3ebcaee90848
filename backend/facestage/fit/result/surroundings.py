"""Pictures of a fitted face under a map of all directions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from facestage.contract.arrays import Float, Float32
from facestage.contract.environment import environment_stage
from facestage.contract.light_stage import ON
from facestage.contract.reflectance import ReflectanceField
from facestage.contract.result import Result
from facestage.fit.result.reflectance import RADIUS, relit_by_map
from facestage.fit.result.relight import (
    SAMPLES,
    check_output,
    check_samples,
    render,
    with_weights,
    write_picture,
)

LIGHTS = 240  # that stand for a map; each is a little smaller than its part of the sphere


def render_field(
    field: Path, out: Path, picture: Float[np.ndarray, "height width 3"], degrees: float
) -> None:
    """Write the face of a reflectance field under a map of linear radiance, turned by ``degrees``
    about the vertical. Raises InputError.
    """
    check_output(out)
    write_picture(out, relit_by_map(ReflectanceField.load(field), picture, degrees))


def render_under_map(
    folder: Path,
    out: Path,
    picture: Float[np.ndarray, "height width 3"],
    degrees: float,
    weights: dict[str, Any] | None = None,
    samples: int | None = None,
) -> None:
    """Write the result in ``folder``, perhaps with other weights, under a map of linear radiance,
    which lights stand for that have its strength and stand where it is bright. Raises InputError.
    """
    check_output(out)
    check_samples(samples)
    result = Result.load(folder)
    if weights is not None:
        result = with_weights(result, weights)
    write_picture(out, under_map(result, picture, degrees, samples or SAMPLES))


def under_map(
    result: Result, picture: Float[np.ndarray, "height width 3"], degrees: float, samples: int
) -> Float32[np.ndarray, "rows columns 3"]:
    """The result under a map, of the photo's size, 0 where the head is not."""
    stage = environment_stage(picture, degrees, LIGHTS, RADIUS)
    stage = replace(stage, state=np.full(len(stage), ON))
    color: np.ndarray = render(replace(result, stage=stage), samples)
    return color

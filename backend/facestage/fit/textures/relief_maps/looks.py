"""Relief from photos, which are looked at twice: with the light on smooth skin, then with that on
the relief that was found.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from facestage.contract import brdf
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.problem import Problem
from facestage.fit.textures.atlas import Atlas
from facestage.fit.textures.relief_maps.relief import Relief, ReliefSeen
from facestage.fit.textures.shown import Shown, light_on, what_is_shown
from facestage.fit.trust.fitted import Fitted

# Pixels of a photo that relief is found from, about: it has no finer texels.
LOOKED_AT = 500_000
# Towards the lights the second time: grain that a single one leaves in penumbras is taken for
# relief.
RAYS_AGAIN = 4e7


def first_look(
    problem: Problem, forward: ForwardModel, fitted: Fitted, shown: Shown, atlas: Atlas
) -> ReliefSeen | None:
    """What one photo says of the relief; None where the job holds the shape as it is."""
    if "relief" in problem.job.freeze:
        return None
    first = ReliefSeen(forward.geometry, atlas)
    first.add(shown.thinned(LOOKED_AT), fitted.state)
    return first


def look_again(
    seen: ReliefSeen,
    problem: Problem,
    forward: ForwardModel,
    fitted: Fitted,
    shown: Shown,
    relief: Relief,
) -> None:
    """Take up a photo's pixels with the light on ``relief``, traced."""
    if shown.image.spread is None:  # which ties all pixels together
        shown = shown.thinned(LOOKED_AT)
    image, surface = shown.image, relief.on(shown, forward.geometry, fitted.state)
    rougher = shown.rougher
    roughness = None
    if rougher is not None:
        roughness = fitted.state.roughness + rougher
        roughness = np.clip(roughness, brdf.ROUGHNESS_MIN, brdf.ROUGHNESS_MAX)
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
            size = min(size, problem.fineness.relief_texture)
            first = ReliefSeen(forward.geometry, Atlas.build(forward.geometry, size))
        shown = what_is_shown(problem, forward, fitted)
        if shown is not None:
            first.add(shown.thinned(LOOKED_AT), fitted.state)
    seen = None if first is None else first.again()
    if seen is None or first is None or first.found is None:
        return first
    for problem, forward, fitted in photos():
        shown = what_is_shown(problem, forward, fitted)
        if shown is not None:
            look_again(seen, problem, forward, fitted, shown, first.found)
    return seen

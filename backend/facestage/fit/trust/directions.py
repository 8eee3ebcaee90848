"""Directions that photo and landmarks do not see, found in the normal equations and said in words.

With C the covariance after the data and Pi that of the priors, the generalised eigenvectors of C v
= mu Pi v are the independent things that could be learned: mu = 1 / (1 + lambda), where lambda is
what the data tell of one relative to its prior. Those with a small lambda are counted. A quantity
with a name, such as the size of the head, is unseen when nearly all of its prior variance is left,
and traded off when the data see little more than its sum with, or ratio to, another one: then their
errors are correlated. Pose, lens and specular map are marginalised: what only they could tell apart
counts as unseen.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.linalg import eigh, solve_triangular

from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.layout import Layout
from facestage.fit.face.light_parameters import CHANNELS, LightParameters
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import UNKNOWNS
from facestage.fit.solve.covariance import Posterior
from facestage.fit.trust.vertex_certainty import similarity_motions

# What the data tell of a direction relative to its prior, below which it counts as unseen.
TELLS_MIN = 0.05
# Share of its prior variance that a named quantity must keep to be listed as unseen.
NAMED_SHARE = 0.8
# Correlation of two quantities' errors from which they are traded off.
TRADED_OFF = 0.9
DEPTH = 5  # translation along the view axis, within the pose
COUNTED = tuple(unknown.name for unknown in UNKNOWNS if unknown.counted)


@dataclass(frozen=True)
class NullDirections:
    """How many of the ``of`` directions are unseen, their effective number by block, and what has a
    name.

    ``left``: share of its prior variance that the data leave to a quantity.
    """

    count: int = 0
    of: int = 0
    by_block: dict[str, float] = field(default_factory=dict)
    left: dict[str, float] = field(default_factory=dict)
    sentences: list[str] = field(default_factory=list)

    def to_json(self) -> dict[str, Any]:
        """As result.json has it."""
        return dict(vars(self))


class Unseen:
    """The span of the unseen directions, in the priors' standard deviations, and what is left of
    any quantity.
    """

    def __init__(self, known: Posterior, layout: Layout) -> None:
        """By what is ``known`` of the parameters."""
        self.layout, self.covariance = layout, known.after
        self.index = np.flatnonzero(_counted(known, layout))
        chosen = np.ix_(self.index, self.index)
        self.before, self.after = known.before[chosen], self.covariance[chosen]
        root = np.linalg.cholesky(self.before)
        half = solve_triangular(root, self.after, lower=True)
        whitened = solve_triangular(root, half.T, lower=True)
        values, vectors = eigh(0.5 * (whitened + whitened.T))
        self.span = vectors[:, values > 1.0 / (1.0 + TELLS_MIN)]

    def left(self, functional: np.ndarray) -> float:
        """Share of its prior variance, 0..1, that the data leave to the linear ``functional``
        (size,); 0 if frozen.
        """
        weights = functional[self.index]
        before = float(weights @ self.before @ weights)
        return float(weights @ self.after @ weights) / before if before > 0 else 0.0

    def correlations(self, functionals: np.ndarray) -> np.ndarray:
        """(n, n) correlations of the errors of (n, size) functionals; 0 where one is frozen."""
        # What nothing holds is infinite and correlated with nothing.
        finite = np.where(np.isfinite(self.covariance), self.covariance, 0.0)
        matrix = functionals @ finite @ functionals.T
        scale = np.sqrt(np.maximum(np.diag(matrix), 0.0))
        scale = np.where(scale > 0, scale, np.inf)
        return matrix / scale / scale[:, None]

    def traded_off(self, first: np.ndarray, second: np.ndarray) -> bool:
        """Whether the data see little more than a combination of two functionals (size,)."""
        return bool(abs(self.correlations(np.stack([first, second]))[0, 1]) > TRADED_OFF)

    def by_block(self) -> dict[str, float]:
        """Effective number of unseen directions by block: they sum up to all."""
        energy = (self.span**2).sum(axis=1)
        result = {}
        for name in COUNTED:
            where = self.layout.slices[name]
            result[name] = float(
                energy[(self.index >= where.start) & (self.index < where.stop)].sum()
            )
        return {name: value for name, value in result.items() if value > 0.5}


def _counted(known: Posterior, layout: Layout) -> np.ndarray:
    """(size,) bool, the entries that have a prior and are counted."""
    return known.active & layout.mask(COUNTED) & (np.diag(known.prior_hessian) > 0)


def find_null_directions(
    known: Posterior,
    state: State,
    geometry: FaceGeometry,
    lights: LightParameters,
    names: Mapping[str, Sequence[str]],
) -> NullDirections:
    """The unseen directions of the last normal equations around ``state``; ``names`` of the entries
    by block.
    """
    layout = Layout(state)
    if not _counted(known, layout).any():
        return NullDirections()
    unseen = Unseen(known, layout)
    brightness, size = _brightness(layout, geometry), _size(state, layout, geometry)
    distance = _unit(layout, layout.slices["pose"].start + DEPTH)
    total = np.zeros(layout.size)
    total[layout.slices["lights"]] = 1.0
    focal = _unit(layout, layout.slices["focal"].start)
    sentences = []
    if unseen.left(brightness) >= NAMED_SHARE or unseen.traded_off(brightness, total):
        sentences.append(
            "brightness of the skin against strength of the light: the priors of albedo and "
            "light fix it"
        )
    if unseen.left(size) >= NAMED_SHARE or unseen.traded_off(size, distance):
        sentences.append("size of the head against its distance: the mean size of faces fixes it")
    if unseen.traded_off(focal, distance):
        sentences.append("focal length against distance: the usual lens fixes it")
    sentences += _lights(unseen, layout, lights, list(names.get("lights", ())))
    for block, words in (
        ("expression", "hidden expressions"),
        ("identity", "hidden identity modes"),
    ):
        where = layout.slices[block]
        hidden = [
            names[block][number]
            for number in range(where.stop - where.start)
            if unseen.left(_unit(layout, where.start + number)) >= NAMED_SHARE
        ]
        if hidden:
            sentences.append(f"{words}: {', '.join(hidden)}")
    left = {
        name: unseen.left(value)
        for name, value in (("skin brightness", brightness), ("head size", size))
    }
    return NullDirections(
        unseen.span.shape[1], len(unseen.index), unseen.by_block(), left, sentences
    )


def _unit(layout: Layout, *entries: int) -> np.ndarray:
    result = np.zeros(layout.size)
    result[list(entries)] = 1.0
    return result


def _brightness(layout: Layout, geometry: FaceGeometry) -> np.ndarray:
    """(size,) mean log albedo of the face by the albedo coefficients."""
    result = np.zeros(layout.size)
    face = np.unique(geometry.triangles[geometry.fitted])
    result[layout.slices["albedo"]] = geometry.albedo_basis[:, face].mean(axis=(1, 2))
    return result


def _size(state: State, layout: Layout, geometry: FaceGeometry) -> np.ndarray:
    """(size,) relative size of the face, as a similarity alignment finds it, by the shape
    coefficients.
    """
    result = np.zeros(layout.size)
    face = np.unique(geometry.triangles[geometry.fitted])
    vertices = geometry.at(state)[face]
    motions = similarity_motions(vertices - vertices.mean(axis=0)).reshape(-1, 7)
    basis = geometry.basis[(3 * face[:, None] + np.arange(3)).ravel()].astype(float)
    where = layout.shape
    by_weight = np.linalg.lstsq(motions, basis, rcond=None)[0][6]
    result[where] = by_weight[: where.stop - where.start]
    return result


def _lights(unseen: Unseen, layout: Layout, lights: LightParameters, names: list[str]) -> list[str]:
    """Lights that reach nothing that is seen, and pairs of which only the sum is."""
    count, step, start = int(lights.fitted.sum()), _per_light(lights), layout.slices["lights"].start
    if not count:
        return []
    # "light 7 red" or "light 7".
    labels = [names[entry].split()[1] for entry in range(0, count * step, step)]
    units = np.zeros((count, layout.size))
    for light in range(count):
        units[light, start + step * light : start + step * (light + 1)] = 1.0
    dark = np.array([unseen.left(unit) >= NAMED_SHARE for unit in units])
    result = []
    if dark.any():
        chosen = [labels[light] for light in np.flatnonzero(dark)]
        result.append(f"lights that reach nothing that is seen: {', '.join(chosen)}")
    correlation = unseen.correlations(units)
    correlation[dark] = correlation[:, dark] = 0.0
    pairs = np.argwhere(np.triu(correlation < -TRADED_OFF, 1))
    if len(pairs):
        words = ", ".join(f"{labels[first]} and {labels[second]}" for first, second in pairs)
        result.append(f"lights of which only the sum is seen: {words}")
    return result


def _per_light(lights: LightParameters) -> int:
    return 1 if lights.uniform else CHANNELS

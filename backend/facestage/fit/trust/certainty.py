"""How well the answer is known: standard deviations from the last normal equations, and what
nothing observed.

The inverse of the Gauss-Newton Hessian, priors included, is the covariance of the answer (Laplace's
approximation); the inverse of the priors' part alone is what was known before. A parameter whose
two standard deviations agree has learned nothing from photo and landmarks: a hidden expression, a
light behind the head, a null direction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from facestage.fit.face.layout import Layout
from facestage.fit.solve.covariance import Posterior

# A parameter that keeps this share of its prior standard deviation counts as unobserved.
UNOBSERVED_SHARE = 0.95


NAMED_MAX = 100


@dataclass(frozen=True)
class Deviations:
    """Standard deviations (size,) of every parameter after and before the data; NaN where not
    fitted.

    ``before`` is infinite where no prior exists.
    """

    after: np.ndarray
    before: np.ndarray

    @property
    def unobserved(self) -> np.ndarray:
        """(size,) bool: fitted, but what it is rests on its prior alone."""
        with np.errstate(invalid="ignore"):
            return (self.after >= UNOBSERVED_SHARE * self.before) & np.isfinite(self.before)


def deviations(known: Posterior) -> Deviations:
    """Of the entries that are active."""
    return Deviations(*(_marginal(matrix, known.active) for matrix in (known.after, known.before)))


def _marginal(matrix: np.ndarray, active: np.ndarray) -> np.ndarray:
    """(size,) square roots of a covariance's diagonal; NaN where not ``active``."""
    return np.where(active, np.sqrt(np.maximum(np.diag(matrix), 0.0)), np.nan)


@dataclass(frozen=True)
class Certainty:
    """What a result says of its parameters, by block."""

    # standard deviation of each entry; 0 where frozen, infinite where unknown
    deviations: dict[str, np.ndarray]
    # names of the entries that neither photo nor landmarks say anything of
    unobserved: dict[str, list[str]]
    # the priors' standard deviations, likewise
    before: dict[str, np.ndarray] = field(default_factory=dict)
    # (n, 3) float32, along the camera's axes, similarity-aligned
    vertices_mm: np.ndarray | None = None
    # what is seen only together, or not at all
    directions: dict[str, Any] = field(default_factory=dict)


def describe(found: Deviations, layout: Layout, names: Mapping[str, Sequence[str]]) -> Certainty:
    """By block: standard deviations, and the unobserved entries' names; without a name, an entry is
    its number, and the only one is its block.

    Of a block as large as the specular map, whose entries nobody names, the count is given.
    """
    after, before, unobserved = {}, {}, {}
    for block, where in layout.slices.items():
        after[block] = np.nan_to_num(found.after[where], nan=0.0, posinf=np.inf)
        before[block] = np.nan_to_num(found.before[where], nan=0.0, posinf=np.inf)
        entries = np.flatnonzero(found.unobserved[where]).tolist()
        count = where.stop - where.start
        if entries and count > NAMED_MAX and block not in names:
            unobserved[block] = [f"{len(entries)} of {count}"]
        elif entries:
            known = names.get(block, (block,) if count == 1 else ())
            unobserved[block] = [known[i] if i < len(known) else str(i) for i in entries]
    return Certainty(after, unobserved, before)

"""The unknowns of a fit, as named blocks of one vector of increments."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from facestage.contract.arrays import Bool, Float
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import UNKNOWNS, Known


class Layout:
    """Where each block lies in the increment vector, and which entries a stage may move."""

    def __init__(self, state: State) -> None:
        self.slices: dict[str, slice] = {}
        self.size = 0
        for unknown in UNKNOWNS:
            start, self.size = self.size, self.size + len(unknown.values(state))
            self.slices[unknown.name] = slice(start, self.size)

    @property
    def shape(self) -> slice:
        """Identity, expression and relief: the weights of the shape's bases."""
        return slice(self.slices["identity"].start, self.slices["relief"].stop)

    def mask(self, blocks: Iterable[str]) -> Bool[np.ndarray, " unknowns"]:
        """True for the entries of ``blocks``."""
        result = np.zeros(self.size, bool)
        for name in blocks:
            result[self.slices[name]] = True
        return result

    def blocks_of(self, mask: Bool[np.ndarray, " unknowns"]) -> tuple[str, ...]:
        """The blocks that ``mask`` touches."""
        return tuple(name for name, where in self.slices.items() if mask[where].any())

    def values(self, state: State) -> Float[np.ndarray, " unknowns"]:
        """The current values; pose is an increment, so it reads 0."""
        return np.concatenate([unknown.values(state) for unknown in UNKNOWNS])

    def bounds(
        self, known: Known
    ) -> tuple[Float[np.ndarray, " unknowns"], Float[np.ndarray, " unknowns"]]:
        """Lower and upper bounds of the values."""
        low, high = np.empty(self.size), np.empty(self.size)
        for unknown in UNKNOWNS:
            where = self.slices[unknown.name]
            low[where], high[where] = unknown.limits(known)
        return low, high

    def apply(self, state: State, step: Float[np.ndarray, " unknowns"]) -> State:
        """The state after ``step``: rotation by an SO(3) increment about the model's
        origin. What does not move stays as it is, to the last digit.
        """
        values = self.values(state) + step
        changes: dict[str, Any] = {}
        for unknown in UNKNOWNS:
            where = self.slices[unknown.name]
            if step[where].any():
                changes |= unknown.changes(state, values[where])
        return replace(state, **changes)

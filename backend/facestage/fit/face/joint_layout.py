"""The unknowns of several photos of one person as one vector."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from facestage.fit.face.layout import Layout
from facestage.fit.face.unknowns import SHARED


class JointLayout:
    """Where the parameters of each photo lie in the joint vector: the shared blocks first, then
    photo by photo.
    """

    def __init__(self, layouts: Sequence[Layout]) -> None:
        """Raises ValueError when the photos' shared blocks differ in size."""
        first = layouts[0]
        is_shared = [layout.mask(SHARED) for layout in layouts]
        self.layouts = tuple(layouts)
        self.shared = int(is_shared[0].sum())
        for layout in layouts:
            for name in SHARED:
                a, b = layout.slices[name], first.slices[name]
                if a.stop - a.start != b.stop - b.start:
                    raise ValueError(f"The block '{name}' differs in size between the photos.")
        # per photo: (size,) int, the joint index of each of its parameters
        self.columns: list[np.ndarray] = []
        start = self.shared
        for mask in is_shared:
            columns = np.empty(len(mask), int)
            columns[mask] = np.arange(self.shared)
            private = int((~mask).sum())
            columns[~mask] = np.arange(start, start + private)
            start += private
            self.columns.append(columns)
        self.size = start

    def gathered(self, parts: Sequence[np.ndarray]) -> np.ndarray:
        """(size,) joint vector of the photos' vectors; of a shared entry, the first photo's."""
        result = np.empty(self.size, parts[0].dtype)
        for columns, part in zip(reversed(self.columns), reversed(parts), strict=True):
            result[columns] = part
        return result

    def all_true(self, parts: Sequence[np.ndarray]) -> np.ndarray:
        """(size,) bool, true where every photo that has the entry says so."""
        result = np.ones(self.size, bool)
        for columns, part in zip(self.columns, parts, strict=True):
            result[columns] &= part
        return result

    def summed(self, parts: Sequence[np.ndarray]) -> np.ndarray:
        """The photos' vectors (size_k,) or matrices (size_k, size_k), added up in the joint one."""
        result = np.zeros((self.size,) * parts[0].ndim)
        for columns, part in zip(self.columns, parts, strict=True):
            result[np.ix_(*(columns,) * part.ndim)] += part
        return result

"""Whether a mesh was modelled with a mirror."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from facestage.contract.arrays import Float

_APART = 1e-4  # of the mesh's extent
_SHARE = 0.95  # of the vertices


def mirrored_axis(vertices: Float[np.ndarray, "vertices 3"]) -> int | None:
    """The one axis of a mesh's own frame across which its vertices repeat themselves; None where
    there is none, or more than one, as a ball has.
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    tree, apart = cKDTree(vertices), _APART * float((high - low).max())
    found = []
    for axis in range(3):
        other = vertices.copy()
        other[:, axis] = low[axis] + high[axis] - other[:, axis]
        distance, _ = tree.query(other, distance_upper_bound=apart)
        if np.isfinite(distance).mean() >= _SHARE:
            found.append(axis)
    return found[0] if len(found) == 1 else None

"""The shadow of the lips on the teeth, as far as a fitted mesh has it wrong.

Lips are soft, let light through and lie close to the teeth; fitted ones stand off and keep twice as
much light from them. What the photo shows of the teeth is put right in their albedo, smoothly.
"""

from __future__ import annotations

import numpy as np

from facestage.contract.arrays import Float

# Metres over which the shadow is evened out, and how many pixels say that it is right as it is.
REACH, COUNT = 0.0015, 4.0
POINTS_MAX = 2000  # asked


def out_of_shadow(
    vertices: Float[np.ndarray, "vertices 3"],
    points: Float[np.ndarray, "points 3"],
    lighter: Float[np.ndarray, " points"],
) -> Float[np.ndarray, " vertices"]:
    """By how much ``vertices`` of teeth (m) are lighter, of the logarithm, when ``points`` between
    them are ``lighter`` in the photo; 0 far from all of them.
    """
    every = slice(None, None, 1 + len(points) // POINTS_MAX)
    points, lighter = points[every], lighter[every]
    apart = np.square(vertices[:, None] - points[None]).sum(axis=2)
    weight = np.exp(-0.5 * apart / REACH**2)
    return np.asarray(weight @ lighter / (weight.sum(axis=1) + COUNT))

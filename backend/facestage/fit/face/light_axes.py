"""The color of light as two numbers: along the locus of lamps and skies, and across it."""

from __future__ import annotations

import numpy as np

from facestage.contract.arrays import Float

# Of a color over the mean of its channels, in linear Rec. 709: from blue to red, and from magenta
# to green.
AXES = np.array([[1.0, 0.0, -1.0], [-1.0, 2.0, -1.0]]) / np.sqrt([[2.0], [6.0]])


def color_of(light: Float[np.ndarray, "*lights 3"]) -> Float[np.ndarray, "*lights 2"]:
    """Along and across, whatever the brightness."""
    return np.asarray(light @ AXES.T / light.mean(axis=-1, keepdims=True))

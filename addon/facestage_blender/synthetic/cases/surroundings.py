"""What stands around a person: walls that reflect light onto the face."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..truth import Worn
from .lamps import Lamp

# m from the face's centre to the wall behind the head and to the one beside it
BEHIND, BESIDE = 0.30, 0.20
REACH = 0.10  # m that the wall beside comes forward of the face's centre
EXTENT = 1.5  # m


def walls(albedo: tuple[float, float, float], lamps: Sequence[Lamp]) -> tuple[Worn, ...]:
    """A wall behind the head, and one beside it where the fewest lamps are, in the stage frame."""
    side = (
        -1.0
        if sum(lamp.irradiance * np.sin(np.radians(lamp.azimuth)) for lamp in lamps) > 0
        else 1.0
    )
    behind = [
        (-EXTENT, -EXTENT, -BEHIND),
        (EXTENT, -EXTENT, -BEHIND),
        (EXTENT, EXTENT, -BEHIND),
        (-EXTENT, EXTENT, -BEHIND),
    ]
    beside = [
        (side * BESIDE, y, z)
        for y, z in ((-EXTENT, -BEHIND), (-EXTENT, REACH), (EXTENT, REACH), (EXTENT, -BEHIND))
    ]
    square = np.array([[0, 1, 2], [0, 2, 3]])
    return tuple(
        Worn(name, np.array(corners), square, albedo, roughness=0.9)
        for name, corners in (("Wall Behind", behind), ("Wall Beside", beside))
    )

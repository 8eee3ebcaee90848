"""How low the ears sit: with the notch above the tragus level with the lower border of the eye
socket, as in the Frankfurt plane.

The plain head has them higher by a fifth of their length, and modes and atlas are read off it: what
moves is the neutral shape alone, the ears as a whole and the skin around them along the head.
"""

from __future__ import annotations

import numpy as np

from facestage.contract.arrays import Float
from facestage.models.head.assemble import SIDES, HeadMesh
from facestage.models.head.base_surface import BaseSurface
from facestage.models.head.features import smoothstep

# Levels of the chart that the skin moves down by, and what the ears move further, mm.
_LEVELS, _FURTHER_MM = 0.9, 2.0
# Where skin moves with the ears: from none to all between these levels and stations, below, above,
# before and behind; the jaw's border lies below.
_BELOW, _ABOVE = (4.6, 6.4), (17.0, 12.5)
_BEFORE, _BEHIND = (6.8, 7.1), (10.0, 8.0)
# Shares of the ears' own move of their loops, from the skin that they grow from.
_LOOSE = (0.0, 0.5)


def ears_lowered(
    mesh: HeadMesh, vertices: Float[np.ndarray, "vertices 3"]
) -> Float[np.ndarray, "vertices 3"]:
    """``vertices`` of ``mesh``, mm, with the ears where people have them."""
    station, level = np.abs(mesh.chart[:, 0]), mesh.chart[:, 1]
    share = np.ones(len(vertices))
    for value, (none, all_of_it) in (
        (level, _BELOW),
        (level, _ABOVE),
        (station, _BEFORE),
        (station, _BEHIND),
    ):
        share *= smoothstep((value - none) / (all_of_it - none))
    moved = np.flatnonzero(share > 0)  # eyes and mouth have no chart
    surface = BaseSurface()
    places = mesh.chart[moved]
    lower = places - np.stack([np.zeros(len(moved)), _LEVELS * share[moved]], axis=1)
    move = np.zeros_like(vertices)
    move[moved] = surface.point(*lower.T) - surface.point(*places.T)
    for side in SIDES:
        loops = mesh.loops[f"ear_{side}"][1:]
        whole = move[loops[0]].mean(axis=0) - [0.0, _FURTHER_MM, 0.0]
        for number, loop in enumerate(loops):
            loose = _LOOSE[number] if number < len(_LOOSE) else 1.0
            move[loop] = (1 - loose) * move[loops[0]] + loose * whole
    return vertices + move

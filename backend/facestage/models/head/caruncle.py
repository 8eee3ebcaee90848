"""The flesh in the corners of the eye: the caruncle in the inner one, with the fold of conjunctiva
that leads from it to the white, and a floor in the outer one.

The margins of the lids go on past the eyeball towards both corners. What lies behind them there,
the last two loops of the eye, hangs back into the socket and left a black pit between the lids. A
caruncle is about 5 mm high and 3 mm broad; between the lids less of it shows (Bron, Tripathi and
Tripathi 1997, "Wolff's Anatomy of the Eye and Orbit").
"""

from __future__ import annotations

import numpy as np

from facestage.models.head.assemble import SIDES, HeadMesh
from facestage.models.head.eyes import MARGIN

# By steps from the corner: how far behind the margins the flesh lies, mm, how much of it there is
# beside what hangs into the socket, and how white it is, as the fold is that leads to the eyeball.
_INNER = (
    (0.3, 1.0, 0.0),
    (0.35, 1.0, 0.0),
    (0.5, 1.0, 0.0),
    (0.9, 1.0, 0.1),
    (1.5, 1.0, 0.5),
    (2.1, 0.8, 0.8),
    (2.4, 0.3, 1.0),
)
_OUTER = ((0.3, 1.0, 0.0), (0.4, 1.0, 0.1), (0.6, 1.0, 0.5), (0.9, 0.8, 0.8), (1.2, 0.3, 1.0))
# Of the two loops behind the margins: the share of the way from the other lid's margin to their
# own, and how much further back than the flesh. The upper lid's cross the opening and end out of
# sight behind the lower lid, whose own lead down to them, and through.
_UPPER = ((0.7, 0.0), (-0.15, 0.35))
_LOWER = ((0.82, 0.05), (0.6, 0.9))


def fleshed(vertices: np.ndarray, loops: np.ndarray, side: str) -> np.ndarray:
    """(n, 3) mm, the vertices with the corners of an eye filled; ``loops`` (rings, m) are those of
    its lids. What lay behind their margins there becomes the flesh.
    """
    result = vertices.copy()
    for columns, (depth, share, _) in _columns(loops.shape[1], side):
        for own, other, places in ((0, 1, _LOWER), (1, 0, _UPPER)):
            margin, across = vertices[loops[MARGIN, [columns[own], columns[other]]]]
            for loop, (way, back) in enumerate(places, MARGIN + 1):
                index = loops[loop, columns[own]]
                place = across + way * (margin - across) - [0.0, 0.0, depth + back]
                result[index] = vertices[index] + share * (place - vertices[index])
    return result


def flesh_share(count: int, side: str) -> np.ndarray:
    """(count,) of the columns of an eye's loops: 1 where what lies behind the margin is flesh,
    which stays where it is when lids move; 0 where it hangs from the lid.
    """
    result = np.zeros(count)
    for columns, (_, share, _) in _columns(count, side):
        result[list(columns)] = share
    return result


def flesh(mesh: HeadMesh) -> np.ndarray:
    """(n,) of the head's vertices: how much each is flesh in the corner of an eye."""
    result = np.zeros(len(mesh.vertices))
    for side in SIDES:
        loops = mesh.loops[f"eye_{side}"]
        result[loops[MARGIN + 1 :]] = flesh_share(loops.shape[1], side)
    return result


def whiteness(mesh: HeadMesh) -> np.ndarray:
    """(n,) likewise: 0 where the flesh is red, as all of it is behind the lower lid, 1 where it is
    as white as the eye.
    """
    result = np.zeros(len(mesh.vertices))
    for side in SIDES:
        loops = mesh.loops[f"eye_{side}"]
        for (_, upper), (_, _, white) in _columns(loops.shape[1], side):
            result[loops[MARGIN + 1 :, upper]] = white
    return result


def _columns(count: int, side: str) -> list[tuple[tuple[int, int], tuple[float, float, float]]]:
    """Columns of the lower and the upper lid across from each other, with the flesh's depth, share
    and whiteness.
    """
    half = count // 2
    inner, outer = (0, half) if side == "left" else (half, 0)
    result = []
    for corner, table in ((inner, _INNER), (outer, _OUTER)):
        # The lower lid's columns lie between the first and the middle one, on both sides.
        step = 1 if corner == 0 else -1
        for away, flesh in enumerate(table):
            columns = (corner + step * away) % count, (corner - step * away) % count
            result.append((columns, flesh))
    return result

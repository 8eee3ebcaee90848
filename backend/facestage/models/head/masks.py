"""Smooth weights on the neutral head that deformations share: sides, lips, jaw, eyelids."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from facestage.contract.face_model import MOUTH, SKIN
from facestage.models.head import mouth
from facestage.models.head.assemble import SIDES, HeadMesh
from facestage.models.head.features import EYE_CENTER

JAW_HINGE = np.array([0.0, -20.0, 8.0])


def smoothstep(x: np.ndarray) -> np.ndarray:
    """0 below 0, 1 above 1, and a cubic between."""
    x = np.clip(x, 0.0, 1.0)
    return x * x * (3.0 - 2.0 * x)


class Masks:
    """Per-vertex weights (n,) in 0..1 of a neutral head mesh."""

    def __init__(self, mesh: HeadMesh) -> None:
        self.mesh = mesh
        self.points = mesh.vertices
        self.count = len(mesh.vertices)
        self.skin = self._of_part(SKIN)
        self.mouth_bag = self._of_part(MOUTH) & ~self.skin
        self.mouth_bag[mesh.tongue] = False
        self.soft = self.skin | self.mouth_bag

    def _of_part(self, part: int) -> np.ndarray:
        used = self.mesh.polygons[self.mesh.polygon_part == part]
        result = np.zeros(self.count, bool)
        result[used[used >= 0]] = True
        return result

    @cached_property
    def front(self) -> np.ndarray:
        """1 on the face, 0 on the back of the head and deep in the mouth bag."""
        return self.soft * smoothstep((self.points[:, 2] - 10.0) / 30.0)

    @cached_property
    def left(self) -> np.ndarray:
        """1 on the subject's left, 0 on the right, blended over the middle 16 mm."""
        return smoothstep(self.points[:, 0] / 16.0 + 0.5)

    @cached_property
    def below_mouth(self) -> np.ndarray:
        """1 on what the lower jaw carries, 0 above; steps at the mouth line, blends beside it."""
        return self._below_mouth(rounding=0.75, held=0.0, upright=0.0)

    def _below_mouth(self, rounding: float, held: float, upright: float) -> np.ndarray:
        """The larger the ``rounding``, the further from the corners the lips begin to part; the
        corners are ``held`` up as if they lay so many mm higher, and open ``upright``, as the ends
        of an ellipse do.
        """
        x, y = self.points[:, 0], self.points[:, 1].copy()
        _, line, _ = mouth.lip_lines(x)
        loops = self.mesh.loops["mouth"]
        n = loops.shape[1]
        k = np.arange(n)
        sign = np.where((k == 0) | (k == n // 2), 0.0, np.where(k > n // 2, 1.0, -1.0))
        for ring, row in enumerate([*loops[1:], *self.mesh.bag]):
            # Nearer the mouth line the two sides part more sharply.
            sharp = smoothstep(np.array((ring + 1.0) / 6.0)) if ring < 6 else 1.0
            aside = np.minimum(np.abs(x[row]) / (mouth.MOUTH_HALF_WIDTH * 1.01), 1.0)
            fade = np.hypot((1 - aside**2) ** rounding, upright * np.sqrt(1 - aside))
            # The bag of the mouth keeps to the skin that it lies behind.
            inside = mouth.LIP_LOOPS <= ring < mouth.SKIN_LOOPS
            rest = line[row] if inside else y[row]
            y[row] = np.where(sign == 0, line[row], rest + sign * sharp * 12.0 * fade)
        half_width = 9.0 + 0.45 * np.maximum(np.abs(x) - mouth.MOUTH_HALF_WIDTH, 0.0)
        line = line - held * np.exp(-(((np.abs(x) - mouth.MOUTH_HALF_WIDTH) / 8.0) ** 2))
        below = smoothstep(0.5 + (line - y) / (2 * half_width))
        below[self.mesh.teeth["upper"]] = 0.0
        below[self.mesh.teeth["lower"]] = 1.0
        below[self.mesh.tongue] = 1.0
        return below

    @cached_property
    def jaw(self) -> np.ndarray:
        """How much of the jaw's motion each vertex follows: 1 on chin and lower teeth, fading into
        cheek and neck. The upper lip is drawn along a little, more beside the corners.
        """
        y, z = self.points[:, 1], self.points[:, 2]
        throat = smoothstep((z * 0.75 + y + 150.0) / 70.0)
        behind = smoothstep((z + 8.0) / 34.0)
        below = self._below_mouth(rounding=1.6, held=3.0, upright=0.55)
        aside = self.points[:, 0] / mouth.MOUTH_HALF_WIDTH
        drawn = (0.08 + 0.17 * np.minimum(aside**2, 1.0)) * np.exp(-np.maximum(aside**2 - 1.0, 0.0))
        drawn = drawn * np.exp(-(((y - mouth.MOUTH_CORNER_Y) / 16.0) ** 2)) * self.front
        weight = (below + (1 - below) * drawn) * throat * behind
        weight[self.mesh.teeth["lower"]] = 1.0
        weight[self.mesh.tongue] = 0.8
        for side in SIDES:
            weight[self.mesh.eyeballs[side]] = 0.0
        return weight

    def eye_distance(self, side: str) -> np.ndarray:
        """(n,) distance in mm to the centre of an eyeball."""
        return np.linalg.norm(self.points - eye_center(side), axis=1)


def eye_center(side: str) -> np.ndarray:
    """(3,) mm."""
    return EYE_CENTER * [1.0 if side == "left" else -1.0, 1.0, 1.0]


def rotate_about(
    points: np.ndarray, pivot: np.ndarray, axis: int, angle: np.ndarray | float
) -> np.ndarray:
    """Points (m, 3) turned by an angle in radians, right-handed, about a coordinate axis through
    the pivot.
    """
    a, b = (axis + 1) % 3, (axis + 2) % 3
    relative = points - pivot
    result = relative.copy()
    cosine, sine = np.cos(angle), np.sin(angle)
    result[:, a] = cosine * relative[:, a] - sine * relative[:, b]
    result[:, b] = sine * relative[:, a] + cosine * relative[:, b]
    return result + pivot

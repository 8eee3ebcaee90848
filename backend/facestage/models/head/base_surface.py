"""The smooth head without features: a bicubic B-spline through the control net, over a chart
(station, level).

Chart: the station runs over -10..10, 0 at the front midline, positive on the subject's left, +-10
the same line at the back; the level runs over 0..26 from the neck base to the crown.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree

from facestage.models.head.control_net import control_net

LEVELS = 26
PERIOD = 20
_PAD = 4


class BaseSurface:
    """Evaluates points of the chart, and finds the chart point of a position seen from the
    front.
    """

    def __init__(self) -> None:
        half = control_net()
        mirrored = half[:, 1:10][:, ::-1] * [-1, 1, 1]
        # (rows, 20, 3), stations 0..19 round the head
        target = np.concatenate([half, mirrored], axis=1)
        coefficients = target.copy()
        for _ in range(3):
            # A B-spline smooths its control points; a few corrections bring it near them without
            # ringing.
            coefficients += 0.8 * (target - _smoothed(coefficients))
        self._padded = _padded(coefficients)
        self._probe_chart, self._probe_xy, self._probe_tree = self._front_probe()

    def point(self, station: np.ndarray, level: np.ndarray) -> np.ndarray:
        """(m, 3) positions in mm of chart points (m,), (m,)."""
        rows = np.asarray(level, np.float64) + _PAD
        columns = np.mod(np.asarray(station, np.float64), PERIOD) + _PAD
        return np.stack(
            [
                map_coordinates(
                    self._padded[..., axis],
                    [rows, columns],
                    order=3,
                    prefilter=False,
                    mode="nearest",
                )
                for axis in range(3)
            ],
            axis=-1,
        )

    def chart_at(self, xy: np.ndarray) -> np.ndarray:
        """(m, 2) chart points (station, level) whose positions have the given front view
        coordinates (m, 2) in mm.
        """
        xy = np.asarray(xy, np.float64)
        chart = self._probe_chart[self._probe_tree.query(xy)[1]].copy()
        step = 1e-3
        for _ in range(12):
            here = self.point(*chart.T)[:, :2]
            du = (self.point(chart[:, 0] + step, chart[:, 1])[:, :2] - here) / step
            dv = (self.point(chart[:, 0], chart[:, 1] + step)[:, :2] - here) / step
            jacobian = np.stack([du, dv], axis=-1)
            move = np.linalg.solve(jacobian, (xy - here)[..., None])[..., 0]
            chart += np.clip(move, -0.3, 0.3)
        return chart

    def _front_probe(self) -> tuple[np.ndarray, np.ndarray, cKDTree]:
        station, level = np.meshgrid(np.linspace(-5.5, 5.5, 111), np.linspace(6, 21, 151))
        chart = np.stack([station.ravel(), level.ravel()], axis=-1)
        xy = self.point(*chart.T)[:, :2]
        return chart, xy, cKDTree(xy)


def _smoothed(points: np.ndarray) -> np.ndarray:
    """The B-spline at its own nodes: weights 1/6, 4/6, 1/6 along stations, then along levels."""
    across = (np.roll(points, 1, 1) + 4 * points + np.roll(points, -1, 1)) / 6
    extended = _extended(across, 1)
    return (extended[:-2] + 4 * extended[1:-1] + extended[2:]) / 6


def _extended(points: np.ndarray, count: int) -> np.ndarray:
    """Rows beyond both ends: straight on below the neck, over the crown to the opposite side
    above.
    """
    below = [points[0] + k * (points[0] - points[1]) for k in range(count, 0, -1)]
    above = [np.roll(points[-1 - k], PERIOD // 2, axis=0) for k in range(1, count + 1)]
    return np.concatenate([below, points, above])


def _padded(points: np.ndarray) -> np.ndarray:
    rows = _extended(points, _PAD)
    return np.concatenate([rows[:, -_PAD:], rows, rows[:, :_PAD]], axis=1)

"""The similarity that lays a surface on points of another one, nothing being known of which point
belongs to which.

Iterative closest points (Besl & McKay 1992), trimmed (Chetverikov et al. 2002): each point is
compared with the nearest of the surface, the farthest twentieth is left out, the sum of the others'
squared distances is lowered. First by steps towards the surface's tangents (Chen & Medioni 1991),
which slide along it and need ten rounds where closed-form steps need a hundred; these come after,
because they never go astray where many points lie beyond the surface's border.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from facestage.models.mesh.similarity import Similarity, procrustes
from facestage.models.mesh.surface import Surface

KEPT = 0.95  # share of the points, the nearest, that is aligned
ROUNDS = 60
GAIN_MIN = 3e-6  # of the root mean square distance, below which a round has gained nothing


@dataclass(frozen=True)
class _Match:
    """Where a surface laid by ``at`` is nearest to the points that count."""

    at: Similarity
    points: np.ndarray  # (k, 3) those that count
    foot: np.ndarray  # (k, 3) on the surface, in its own frame
    offset: np.ndarray  # (k, 3) from the points to the surface
    normal: np.ndarray  # (k, 3) of the surface there, in the points' frame
    border: np.ndarray  # (k,) bool: the nearest point lies on the surface's border
    error: float  # root mean square length of ``offset``

    @classmethod
    def of(cls, surface: Surface, points: np.ndarray, at: Similarity) -> _Match:
        found = surface.nearest(at.inverse().apply(points))
        offset = at.apply(found.point) - points
        distance = np.linalg.norm(offset, axis=1)
        kept = distance <= np.quantile(distance, KEPT)
        return cls(
            at,
            points[kept],
            found.point[kept],
            offset[kept],
            found.normal[kept] @ at.rotation.T,
            found.boundary[kept],
            float(np.sqrt((distance[kept] ** 2).mean())),
        )

    def closed_form(self, rigid: bool) -> Similarity:
        """The best similarity if each point kept its own point of the surface."""
        if not rigid:
            return procrustes(self.foot, self.points)
        scaled = procrustes(self.at.scale * self.foot, self.points, rigid=True)
        return Similarity(self.at.scale, scaled.rotation, scaled.translation)

    def towards_tangents(self, rigid: bool) -> Similarity:
        """One step to where the sum of squared distances from the tangents is least, by the motion
        of the surface; a point beyond the border is drawn by its own point of that.
        """
        middle = self.points.mean(axis=0)
        arm = self.points + self.offset - middle
        # Along these the motion of a point of the surface is asked for: its normal, or every axis.
        within, beyond = ~self.border, np.flatnonzero(self.border)
        axis = np.concatenate([self.normal[within], np.tile(np.eye(3), (len(beyond), 1))])
        arm, offset = (
            np.concatenate([item[within], np.repeat(item[beyond], 3, axis=0)])
            for item in (arm, self.offset)
        )
        columns = [axis, np.cross(arm, axis)]
        if not rigid:
            columns.append((arm * axis).sum(axis=1, keepdims=True))
        wanted = -(offset * axis).sum(axis=1)
        step = np.linalg.lstsq(np.concatenate(columns, axis=1), wanted, rcond=None)[0]
        rotation = Rotation.from_rotvec(step[3:6]).as_matrix()
        scale = 1.0 if rigid else max(1.0 + float(step[6]), 0.5)
        moved = scale * rotation @ (self.at.translation - middle) + middle + step[:3]
        return Similarity(scale * self.at.scale, rotation @ self.at.rotation, moved)


def closest_alignment(
    surface: Surface, points: np.ndarray, start: Similarity, rigid: bool = False
) -> Similarity:
    """The similarity that lays ``surface`` on ``points`` (m, 3) of another surface, from ``start``
    on.

    ``rigid``: the scale stays that of ``start``.
    """
    best, by_tangents = _Match.of(surface, points, start), True
    for _ in range(ROUNDS):
        step = best.towards_tangents(rigid) if by_tangents else best.closed_form(rigid)
        found = _Match.of(surface, points, step)
        gained = found.error < (1.0 - GAIN_MIN) * best.error
        if found.error < best.error:
            best = found
        if not gained and not by_tangents:
            break
        by_tangents &= gained
    return best.at

"""The part of the photometric derivatives that light from skin to skin has: of what changes at the
vertices, what pixels show.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from facestage.contract.arrays import Float, Float32, Int
from facestage.fit.face.light_parameters import CHANNELS
from facestage.fit.forward.bounces import between_corners
from facestage.fit.forward.moving_bounces import MovingBounces
from facestage.fit.forward.reflectance import uniform_lobe
from facestage.fit.forward.shading import Image


class ReceivedLight:
    """Of one evaluation's image."""

    def __init__(
        self,
        bounces: MovingBounces,
        image: Image,
        albedo_modes: Float32[np.ndarray, "3 vertices albedos"],
    ) -> None:
        """``albedo_modes`` of the log albedo, none where they are not asked for."""
        self.bounces, self.image, self._albedo_modes = bounces, image, albedo_modes

    def color(self, part: slice) -> Float[np.ndarray, "pixels 3"]:
        """By the irradiance that comes from other skin."""
        one = np.ones((len(self.image.color[part]), CHANNELS))
        return self.image.skin.part(part).radiance(one, uniform_lobe(one))

    def along_edge(self, part: slice, edge: int) -> Float[np.ndarray, "pixels 3"]:
        """From corner 0 of the triangles that pixels see to corner ``edge``."""
        received = self._vertices[self.image.surface.corners[part]]
        return self.color(part) * (received[:, edge] - received[:, 0])

    def by_pose(self, part: slice) -> Float[np.ndarray, "3 pixels 6"]:
        """By rotation about the model's origin, then translation."""
        return self._shown_as(part, self._by_pose)

    def by_albedo(self, part: slice) -> Float[np.ndarray, "3 pixels albedos"]:
        """By the weights of the modes of the log albedo."""
        return self._shown_as(part, self._by_albedo)

    @cached_property
    def _vertices(self) -> Float[np.ndarray, "vertices 3"]:
        return self.bounces.at_vertices(self.bounces.received)

    @cached_property
    def _by_pose(self) -> Float32[np.ndarray, "3 shown 6"]:
        return self.bounces.by_pose(self._shown)

    @cached_property
    def _by_albedo(self) -> Float32[np.ndarray, "3 shown albedos"]:
        return self.bounces.by_albedo(self._albedo_modes, self._shown)

    @cached_property
    def _shown(self) -> Int[np.ndarray, " shown"]:
        """The vertices that pixels lie between."""
        return np.unique(self.image.surface.corners)

    def _shown_as(
        self, part: slice, changes: Float32[np.ndarray, "3 shown changes"]
    ) -> Float[np.ndarray, "3 pixels changes"]:
        """What these changes of the light from other skin make of the color."""
        surface = self.image.surface
        place = np.searchsorted(self._shown, surface.corners[part])
        pick = between_corners(place, surface.weights[part], len(self._shown))
        received = np.stack([pick @ change for change in changes])
        return self.color(part).T[..., None] * received

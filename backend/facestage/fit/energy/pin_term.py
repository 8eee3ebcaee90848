"""The pin term: points of the surface that a person has put on their pixels stay there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.pins import Pins
from facestage.fit.energy.robust_residuals import QuadraticResiduals
from facestage.fit.energy.term import Setup, Term
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.face.surface_points import SurfacePoints


@dataclass(frozen=True, eq=False)
class PinTerm(QuadraticResiduals, Term):
    """Residuals of the pins in standard deviations. Whoever set a pin meant it: the loss is
    quadratic however far the face still is.
    """

    words: ClassVar = {"pins": "Pins"}
    name: ClassVar = "pins"
    components: ClassVar = 2

    on_face: SurfacePoints
    pins: Pins  # pixels of the working photo
    share: float = 1.0
    weight: float = 1.0

    @classmethod
    def of(cls, setup: Setup) -> Self | None:
        """Of every phase of a job with pins."""
        pins = setup.problem.pins_at(setup.factor)
        if pins is None or not len(pins):
            return None
        return cls(surface_points(setup.problem.geometry, pins), pins)

    def residuals(self, state: State) -> Float[np.ndarray, " residuals"]:
        """The residuals, in standard deviations."""
        away = self.on_face.project(state) - self.pins.points
        return (away / self.pins.deviation[:, None]).ravel()

    def jacobian(self, state: State, layout: Layout) -> Float[np.ndarray, "residuals unknowns"]:
        """Derivative of :meth:`residuals`."""
        columns = self.on_face.jacobian(state, layout) / self.pins.deviation[:, None, None]
        return columns.reshape(-1, layout.size)


def surface_points(geometry: FaceGeometry, pins: Pins) -> SurfacePoints:
    """The points of the rendered mesh that the pins hold."""
    return SurfacePoints(geometry, geometry.new_index[pins.corners], pins.weights)

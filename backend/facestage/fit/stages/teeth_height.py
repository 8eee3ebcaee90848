"""How high a person's teeth stand between the lips.

How much of them lips leave to be seen differs by millimetres from person to person, at rest (Vig
and Brundo 1978, "The kinetics of anterior tooth display") as in a smile (Tjan et al. 1984, "Some
esthetic factors in a smile"), and no point on the skin tells of it. What the photo shows between
the lips does: crowns, gums, or what is dark behind them. The face model has an identity mode for
it, which is chosen after the fit so that each pixel shows what it should.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from facestage.contract.arrays import Float, Int
from facestage.contract.face_model import SKIN, TEETH
from facestage.fit.face.state import State
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.face_areas import mouth_share
from facestage.fit.given.problem import Problem
from facestage.fit.given.skin_mask import SURE_SKIN
from facestage.fit.given.teeth import TOOTH_LIGHT, beside_skin, is_gum, like_teeth
from facestage.fit.stages.view import View

MODE = "teeth_height"
# What may be between the lips, as the photo shows it and as the model has it.
CROWN, RED, DARK = range(3)
GUM, BEHIND = RED, DARK
# How often each of the model's (rows) is seen as each of the photo's: crowns at their gums lie in
# the upper lip's shadow, gums and tongue too, and what is behind parted teeth may be the tongue.
SEEN_AS = np.array([[0.75, 0.08, 0.17], [0.15, 0.6, 0.25], [0.08, 0.4, 0.52]])
# Square metres of neighbours that say the same, and of open mouth below which nothing is asked.
PATCH, OPEN_MIN = 6.0e-6, 2.0e-5
PIXELS_MIN, PIXELS_MAX = 30, 3000
# Standard deviations; lower down, what is above the gums would be seen.
HEIGHTS = np.linspace(-1.5, 2.5, 17)


@dataclass(frozen=True, eq=False)
class OpenMouth:
    """Pixels of one photo that show what lies between the lips, as far as the model's are open
    there too.
    """

    forward: ForwardModel
    state: State
    pixels: Float[np.ndarray, "pixels 2"]
    seen: Int[np.ndarray, " pixels"]  # CROWN, RED, DARK
    area: float  # square metres

    @classmethod
    def of(cls, problem: Problem, forward: ForwardModel, state: State) -> OpenMouth | None:
        """None where too little of it is to be seen."""
        photo = problem.photograph
        shape = photo.mask.shape[0], photo.mask.shape[1]
        bare = photo.color[photo.mask & (problem.skin > SURE_SKIN)]
        row, column = np.nonzero(photo.mask & (mouth_share(shape, problem.landmarks) == 1))
        if not len(bare) or len(row) < PIXELS_MIN:
            return None
        every = slice(None, None, 1 + len(row) // PIXELS_MAX)
        row, column = row[every], column[every]
        pixels = np.stack([column, row], axis=1) + 0.5
        surface = forward.surface(state, pixels)
        inside = forward.geometry.triangle_part[surface.triangle] != SKIN
        pixels = surface.pixels[inside]
        if len(pixels) < PIXELS_MIN:
            return None
        across = float(np.median(surface.depth[inside])) / state.camera.focal_px
        area = len(pixels) * every.step * across**2
        if area < OPEN_MIN:
            return None
        column, row = pixels.astype(int).T
        light, red = beside_skin(photo.color[row, column], bare)
        seen = np.where(light < TOOTH_LIGHT, DARK, RED)
        seen[like_teeth(light, red)] = CROWN
        return cls(forward, state, pixels, seen, area)

    def unlikeliness(self, height: float) -> float:
        """Minus the logarithm of how likely the photo is with teeth of this ``height``."""
        hits = self.forward.hits(with_height(self.state, self.forward, height), self.pixels)
        geometry = self.forward.geometry
        teeth = (hits.triangle >= 0) & (geometry.triangle_part[hits.triangle] == TEETH)
        corners = geometry.triangles[hits.triangle[teeth]]
        color = np.einsum("pi,pic->pc", hits.barycentric[teeth], geometry.log_albedo[corners])
        model = np.full(len(teeth), BEHIND)
        model[teeth] = np.where(is_gum(color), GUM, CROWN)
        return float(-np.log(SEEN_AS[model, self.seen]).mean() * self.area / PATCH)


def with_height(state: State, forward: ForwardModel, height: float) -> State:
    """``state`` with teeth of this ``height`` in standard deviations."""
    identity = state.identity.copy()
    identity[forward.geometry.model.identity_names.index(MODE)] = height
    return replace(state, identity=identity)


def with_teeth_seen(photos: Sequence[tuple[View, State]]) -> list[State]:
    """The fitted states of one person's ``photos`` with teeth as high as these show them."""
    height = teeth_height(photos)
    if height is None:
        return [state for _, state in photos]
    return [with_height(state, view.forward, height) for view, state in photos]


def teeth_height(photos: Sequence[tuple[View, State]]) -> float | None:
    """Their height in standard deviations; None where the model has no such mode, a job holds the
    identity, or no photo shows what is between the lips.
    """
    if any(
        MODE not in view.problem.geometry.model.identity_names
        or "identity" in view.problem.job.freeze
        for view, _ in photos
    ):
        return None
    mouths = [OpenMouth.of(view.problem, view.forward, state) for view, state in photos]
    open_mouths = [mouth for mouth in mouths if mouth is not None]
    if not open_mouths:
        return None
    cost = dict[int, float]()
    for step in (2, 1):  # every other height, then those beside the best
        best = min(cost, key=cost.__getitem__, default=None)
        for place in range(0, len(HEIGHTS), step):
            if place not in cost and (best is None or abs(place - best) <= step):
                height = float(HEIGHTS[place])
                cost[place] = 0.5 * height**2 + sum(
                    mouth.unlikeliness(height) for mouth in open_mouths
                )
    return float(HEIGHTS[min(cost, key=cost.__getitem__)])

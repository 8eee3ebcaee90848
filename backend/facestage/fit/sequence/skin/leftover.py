"""What one frame's picture has left over on the skin, once head, face and light are explained."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from facestage.contract.arrays import Bool, Float
from facestage.fit.face.state import State
from facestage.fit.forward.shading import Image
from facestage.fit.sequence.actor import Actor
from facestage.fit.sequence.frames import Cut, FrameView

# Pixels along the face, and samples of each light: skin shows more at larger ones than shape does.
SKIN_PX, SAMPLES = 160.0, 4
DARKEST = 1e-4  # linear radiance


@dataclass(frozen=True, eq=False)
class Leftover:
    """Pixels of skin in one frame, in the small picture that it was cut to."""

    state: State
    image: Image  # the person there, with derivatives by the normal
    uvs: Float[np.ndarray, "pixels 2"]
    photo: Float[np.ndarray, "pixels 3"]  # linear
    clipped: Bool[np.ndarray, "pixels 3"]
    clear: Float[np.ndarray, " pixels"]  # 0..1, how well they show skin, and not at a slant

    @property
    def residual(self) -> Float[np.ndarray, "pixels 3"]:
        """Log radiance beyond the person's."""
        return np.log(np.maximum(self.photo, DARKEST) / np.maximum(self.image.color, DARKEST))

    @property
    def by_log_albedo(self) -> Float[np.ndarray, "pixels 3"]:
        """The log radiance's derivative by log albedo: less than 1 where skin shines."""
        image = self.image
        return image.skin.by_log_albedo(image.diffuse) / np.maximum(image.color, DARKEST)


def left_over(actor: Actor, cut: Cut, state: State) -> Leftover:
    """Of the frame ``cut``, which shows the person at ``state``."""
    view = FrameView.of(actor, cut, light_held=True)
    term = replace(view.term, samples=SAMPLES)
    state = replace(state, camera=view.window.camera(state.camera))
    evaluation = term.evaluate(state, 0)
    surface = evaluation.image.surface
    row, column = term.index(surface)
    return Leftover(
        state,
        evaluation.image,
        actor.forward.uvs(surface),
        term.photo.color[row, column],
        term.photo.clipped[row, column],
        evaluation.base_weight[row, column],
    )

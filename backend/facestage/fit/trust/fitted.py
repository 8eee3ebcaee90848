"""Where a fit ended."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from facestage.contract.light_stage import LightStage
from facestage.fit.energy.plan import Ledger
from facestage.fit.face.state import State
from facestage.fit.stages.below import Below
from facestage.fit.stages.skin_to_skin import SkinToSkin
from facestage.fit.stages.surround import Surround
from facestage.fit.trust.certainty import Certainty
from facestage.fit.trust.color_doubt import ColorDoubt
from facestage.fit.trust.lens_check import LensCheck
from facestage.fit.trust.support import Support
from facestage.images.image_io import resize


@dataclass(frozen=True)
class Fitted:
    """Where the schedule ended."""

    state: State
    start: State  # where the landmark phases ended
    camera_to_stage: np.ndarray  # (4, 4)
    stage: LightStage  # lit lights, camera frame, at the fitted radiance
    trace: list[dict[str, Any]]
    energy: dict[str, float]
    condition: float
    seconds: float
    check_seconds: float  # afterwards: how sure it is, whether the lens can be right
    in_time: bool
    certainty: Certainty
    shading_doubt: np.ndarray | None  # (h, w) at the last phase's size, see shading_doubt.py
    hidden: np.ndarray  # (h, w) bool at the photo's size, what shows no skin of the face
    dark: np.ndarray  # likewise, what is darker than the light on the rest explains
    shadowed: np.ndarray  # of it, bare skin that is painted as it would be without its shadow
    # why the photo was not believed about the shape, which is then the landmarks' own; or empty
    doubt: str
    settled: bool  # the last phase ended by itself, not at a limit or a wall
    lens: LensCheck | None  # None when the focal length was fitted
    # how far the photo pulled the shape from the landmarks', see guard.py
    landmark_statistic: float
    ledger: Ledger = field(default_factory=Ledger)  # what was worked on, and what the plan left out
    # share of the light on the face from partly hidden lights; None: did not look
    penumbra: float | None = None
    # None: the photo was not asked about the shape, or not believed
    support: Support | None = None
    surround: Surround | None = None  # what light from behind was found; None: was not looked for
    color: ColorDoubt | None = None  # None: the photo was not asked, or light or skin are held
    below: Below | None = None  # what light below the skin was found; None: was not looked for
    between: SkinToSkin | None = None  # light from skin to skin; None: was not looked for
    company: str = ""  # what speaks against this photo beside others of the same person; or empty

    def in_size(self, state: State, width: int, height: int, least: float = 0.0) -> Fitted:
        """The same with ``state`` in the photo of another size, whose pixels are hidden, dark or in
        shadow where more of them is than the share ``least``.
        """
        hidden, dark, shadowed = (
            resize(mask.astype(np.float32), width, height) > least
            for mask in (self.hidden, self.dark, self.shadowed)
        )
        return replace(self, state=state, hidden=hidden, dark=dark, shadowed=shadowed)

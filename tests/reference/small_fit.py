"""How fine a fit of a photo of 96 pixels is."""

from __future__ import annotations

from dataclasses import replace

from facestage.fit.given.fineness import Fineness

# A report takes as long as all steps of such a fit.
SMALL = Fineness(
    specular_size=6, texture_min=64, texture_max=64, gloss_texture=32, keyframes=2, report=False
)
# Two steps in each phase with a photo never settle.
QUICK = replace(SMALL, steps_max=2, settled_share=1.0)
REPORTED = replace(QUICK, report=True)


class StopError(Exception):
    """Raised by a listener in place of a kill."""

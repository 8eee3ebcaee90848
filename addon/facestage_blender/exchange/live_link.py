"""A phone's recording of a face, as keyframes of the rig's expressions."""

from __future__ import annotations

import bpy
import numpy as np

from facestage.contract.arkit import slider_weights
from facestage.contract.errors import InputError
from facestage.contract.live_link import Recording

from ..rig.expressions import expression_keys
from ..rig.keyframes import write_keys


def key_recording(scene: bpy.types.Scene, rig: bpy.types.Object, recording: Recording) -> int:
    """Key the rig's expressions from the scene's present frame on; the last frame is returned.

    Raises InputError where the rig has none of ARKit's expressions.
    """
    sliders = {key.name for keys in expression_keys(rig).values() for key in keys}
    weights = {
        slider: values
        for name, values in recording.weights.items()
        for slider in slider_weights({name: 0.0}, sliders)
    }
    if not weights:
        raise InputError(
            "The face has none of ARKit's expressions (jawOpen, eyeBlinkLeft, ...); build a face "
            "rig of the default head or of ICT-FaceKit."
        )
    rate = scene.render.fps / scene.render.fps_base
    frames = scene.frame_current + recording.seconds * rate
    write_keys(rig, frames, weights)
    return int(np.ceil(frames[-1]))

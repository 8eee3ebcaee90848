"""ARKit's 52 expressions by name, and what face models call them.

Apple's ARKit names them (ARFaceAnchor.BlendShapeLocation); phones record them, and most rigs have
them.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

ARKIT_NAMES = (
    "browDownLeft",
    "browDownRight",
    "browInnerUp",
    "browOuterUpLeft",
    "browOuterUpRight",
    "cheekPuff",
    "cheekSquintLeft",
    "cheekSquintRight",
    "eyeBlinkLeft",
    "eyeBlinkRight",
    "eyeLookDownLeft",
    "eyeLookDownRight",
    "eyeLookInLeft",
    "eyeLookInRight",
    "eyeLookOutLeft",
    "eyeLookOutRight",
    "eyeLookUpLeft",
    "eyeLookUpRight",
    "eyeSquintLeft",
    "eyeSquintRight",
    "eyeWideLeft",
    "eyeWideRight",
    "jawForward",
    "jawLeft",
    "jawOpen",
    "jawRight",
    "mouthClose",
    "mouthDimpleLeft",
    "mouthDimpleRight",
    "mouthFrownLeft",
    "mouthFrownRight",
    "mouthFunnel",
    "mouthLeft",
    "mouthLowerDownLeft",
    "mouthLowerDownRight",
    "mouthPressLeft",
    "mouthPressRight",
    "mouthPucker",
    "mouthRight",
    "mouthRollLower",
    "mouthRollUpper",
    "mouthShrugLower",
    "mouthShrugUpper",
    "mouthSmileLeft",
    "mouthSmileRight",
    "mouthStretchLeft",
    "mouthStretchRight",
    "mouthUpperUpLeft",
    "mouthUpperUpRight",
    "noseSneerLeft",
    "noseSneerRight",
    "tongueOut",
)


def spellings(name: str) -> tuple[tuple[str, ...], ...]:
    """How face models may write one of ARKit's names, likeliest first; sliders of one spelling
    belong together.

    ICT-FaceKit writes mouthSmile_L for mouthSmileLeft, and has a left and a right browInnerUp.
    """
    for side in ("Left", "Right"):
        if name.endswith(side):
            return (name,), (f"{name.removesuffix(side)}_{side[0]}",)
    return (name,), (f"{name}_L", f"{name}_R")


def slider_weights(weights: Mapping[str, float], sliders: Collection[str]) -> dict[str, float]:
    """The weights of a model's ``sliders`` for ``weights`` by ARKit's names, as far as it has
    them.
    """
    found: dict[str, float] = {}
    for name, weight in weights.items():
        for together in spellings(name):
            if any(slider in sliders for slider in together):
                found |= {slider: weight for slider in together if slider in sliders}
                break
    return found

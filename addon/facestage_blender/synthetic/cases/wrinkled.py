"""Two people with grooves, bumps and a fine relief of known height, each in three lights. No bpy.

Pose and expression are almost the same in the three photos, so that what differs is the light.
"""

from __future__ import annotations

import zlib

from .lamps import Lamp
from .recipe import Recipe

PEOPLE = {"a": True, "b": False}  # whether they have freckles
STILL = dict.fromkeys(
    (
        "mouthSmileLeft",
        "mouthSmileRight",
        "browInnerUp",
        "browDownLeft",
        "browDownRight",
        "eyeSquintLeft",
        "eyeSquintRight",
        "jawOpen",
    ),
    0.0,
)
FILL = Lamp(0, 0, 0.12, 1.4, 0.5)
LIGHTS = {
    "left": ("a lamp from the left", (Lamp(-55, 15, 1.0, 1.0, 0.2), FILL)),
    "right": ("a lamp from the right", (Lamp(55, 20, 1.0, 1.0, 0.2), FILL)),
    "above": ("a lamp from above", (Lamp(8, 55, 1.0, 1.0, 0.2), FILL)),
}


def wrinkled() -> dict[str, tuple[Recipe, int]]:
    """The six cases by name, each with the seed of who it is."""
    result = {}
    for who, freckles in PEOPLE.items():
        seed = zlib.crc32(f"wrinkled_{who}".encode()) % 2**31
        for light, (words, lamps) in LIGHTS.items():
            name = f"{who}_{light}"
            hard = f"grooves and bumps{' and freckles' if freckles else ''}, {words}"
            result[name] = (
                Recipe(name, hard, lamps, STILL, freckles=freckles, melanin=0.0, relief=True),
                seed,
            )
    return result

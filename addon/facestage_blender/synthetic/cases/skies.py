"""Eight people, each in one of the surroundings that Blender ships: light from everywhere.

No bpy.
"""

from __future__ import annotations

from ..truth import Sky
from .lamps import Lamp
from .recipe import Recipe

# Every scene has lamps; here one that does not shine.
DARK = (Lamp(0, 0, 0.0),)
# Name: by how many degrees it is turned, yaw and pitch of the head in degrees, what is there.
SURROUNDINGS = {
    "city": (30.0, (12, 0), "a street under a clouded sky"),
    "courtyard": (120.0, (-15, 3), "a sky between walls"),
    "forest": (200.0, (5, -4), "the sun through trees"),
    "interior": (40.0, (-8, 0), "a room with windows"),
    "night": (75.0, (14, 4), "street lamps"),
    "studio": (160.0, (-12, -3), "studio lamps, two of them rims from behind"),
    "sunrise": (285.0, (8, 2), "a low sun"),
    "sunset": (200.0, (-5, 0), "a low sun and a blue sky"),
}


def skies() -> dict[str, Recipe]:
    """The cases by name."""
    return {
        name: Recipe(
            name, f"light from everywhere: {words}", DARK, pose=(*pose, 0.0), sky=Sky(name, turn)
        )
        for name, (turn, pose, words) in SURROUNDINGS.items()
    }

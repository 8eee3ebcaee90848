"""Photographs of one person at different times: another pose, expression, distance and light in
each. No bpy.
"""

from __future__ import annotations

from .lamps import Lamp
from .recipe import COOL, STUDIO, WARM, Recipe

PHOTOS = (
    Recipe("photo_1", "a studio portrait, almost frontal", STUDIO, pose=(4, 2, 0)),
    Recipe(
        "photo_2",
        "turned to one side, smiling, by a window",
        (Lamp(-52, 16, 1.0, 1.15, 0.9),),
        {
            "mouthSmileLeft": 0.6,
            "mouthSmileRight": 0.55,
            "cheekSquintLeft": 0.3,
            "cheekSquintRight": 0.3,
        },
        pose=(-24, -3, 2),
    ),
    Recipe(
        "photo_3",
        "turned to the other side, the mouth open, a hard lamp",
        (Lamp(48, 24, 1.0, 0.9, 0.12), Lamp(-30, 5, 0.08, 1.5, 0.4)),
        {"jawOpen": 0.35},
        pose=(26, 4, -3),
    ),
    Recipe(
        "photo_4",
        "the head bowed, a warm and a cool lamp",
        (
            Lamp(-50, 20, 1.0, 0.9, 0.2, WARM),
            Lamp(55, 5, 0.9, 1.0, 0.2, COOL),
            Lamp(0, 10, 0.15, 1.5, 0.4),
        ),
        pose=(-8, 14, 4),
    ),
    Recipe(
        "photo_5",
        "looking up, from above",
        (Lamp(14, 55, 1.0, 0.9, 0.2), Lamp(-30, 0, 0.2, 1.5, 0.4)),
        {"browInnerUp": 0.5},
        pose=(6, -14, -2),
    ),
    Recipe(
        "photo_6",
        "close to the lens, a lamp from the side",
        (Lamp(60, 12, 1.0, 0.75, 0.15), Lamp(-25, 5, 0.15, 1.5, 0.5)),
        pose=(10, 0, 3),
        distance=0.5,
    ),
    Recipe(
        "photo_7",
        "almost in profile, soft light",
        (Lamp(30, 30, 1.0, 1.2, 0.6), Lamp(-60, 0, 0.5, 1.2, 0.6)),
        pose=(42, 0, 0),
    ),
    Recipe(
        "photo_8",
        "a wide smile, a lamp from the other side",
        (Lamp(-58, 25, 1.0, 0.9, 0.15), Lamp(40, 0, 0.2, 1.4, 0.4)),
        {"mouthSmileLeft": 0.85, "mouthSmileRight": 0.8, "jawOpen": 0.15},
        pose=(-12, 3, -4),
    ),
)

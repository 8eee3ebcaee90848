"""36 people of six skin types under three lights: is skin tone told from light? No bpy.

Of each type there are two colors, which come from different places, so that a prior that was made
from one meets the other: ``a`` is the type's color as spectrophotometers find it (the skin color
volume of Chardon et al. 1991 and Del Bino and Bernerd 2013), ``b`` is what the pigments of
:mod:`facestage.models.anatomy.skin` make of much or little melanin and blood. Shape, eyes and teeth
are each photo's own: how white somebody's eyes are limits what a photo can say of a tone, so three
photos of one person would say the same error three times.
"""

from __future__ import annotations

import zlib

from .lamps import Lamp
from .recipe import Recipe

# CIELAB of the face's median color, D65.
COLORS = {
    "very_light": ((69.2, 7.0, 12.5), (66.7, 7.0, 9.6)),
    "light": ((67.9, 8.5, 15.0), (61.6, 10.0, 10.8)),
    "intermediate": ((62.7, 10.0, 17.5), (59.6, 9.3, 14.7)),
    "tan": ((57.5, 11.0, 18.5), (54.7, 12.0, 15.4)),
    "brown": ((48.8, 12.5, 17.5), (44.6, 13.2, 21.5)),
    "dark": ((36.7, 9.5, 12.0), (33.0, 15.4, 18.8)),
}
WHITE = (1.0, 1.0, 1.0)
# What a camera makes of light that its white balance has missed: a black body of 4500 K, daylight
# of 9500 K, a black body of 3500 K; linear Rec. 709 with the mean 1, 6500 K being white.
LAMP, SHADE, BULB = (1.345, 0.979, 0.676), (0.784, 0.945, 1.271), (1.639, 0.936, 0.425)
LIGHTS = {
    "studio": (
        "white lamps",
        (
            Lamp(-38, 26, 1.0, 1.1, 0.25, WHITE),
            Lamp(42, 5, 0.4, 1.3, 0.4, WHITE),
            Lamp(75, 30, 0.2, 0.8, 0.2, WHITE),
        ),
    ),
    "lamp": (
        "lamps of 4500 K",
        (Lamp(42, 34, 1.0, 1.0, 0.25, LAMP), Lamp(-35, 0, 0.35, 1.4, 0.5, LAMP)),
    ),
    "shade": (
        "a window of 9500 K, and a bulb from the other side",
        (Lamp(-52, 16, 1.0, 1.15, 0.7, SHADE), Lamp(55, 15, 0.3, 1.2, 0.15, BULB)),
    ),
}


def tones() -> dict[str, tuple[Recipe, int]]:
    """The 36 cases by name, light to dark, each with the seed of who it is."""
    result = {}
    for tone, colors in COLORS.items():
        for which, color in zip("ab", colors, strict=True):
            for light, (words, lamps) in LIGHTS.items():
                name = f"{tone}_{which}_{light}"
                seed = zlib.crc32(name.encode()) % 2**31
                hard = f"{tone.replace('_', ' ')} skin, {words}"
                result[name] = Recipe(name, hard, lamps, tone=color), seed
    return result

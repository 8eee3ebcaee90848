"""What each case is made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from ..truth import PERFECT, Optics, Sky
from .lamps import Lamp

WARM, COOL = (1.0, 0.62, 0.32), (0.4, 0.65, 1.0)
GREEN, ORANGE = (0.05, 0.5, 0.12), (0.65, 0.22, 0.06)
# A studio portrait: a key lamp, a fill and a weak one from the other side.
STUDIO = (Lamp(-32, 26, 1.0, 1.1), Lamp(40, 5, 0.45, 1.3, 0.3), Lamp(75, 30, 0.25, 0.8))


@dataclass(frozen=True)
class Recipe:
    """One hard thing about a photo; all else is drawn from the case's seed.

    ``pose`` is yaw, pitch and roll in degrees; expression weights have ARKit's names and replace
    the drawn ones.
    """

    name: str
    hard: str  # what is hard about it
    lamps: tuple[Lamp, ...] = STUDIO
    expression: Mapping[str, float] = field(default_factory=dict)
    pose: tuple[float, float, float] = (0.0, 0.0, 0.0)
    # m; the focal length follows, so that the face fills the same part of the picture
    distance: float = 0.78
    roughness: float | None = None
    melanin: float | None = None  # standard deviations of the model's first skin mode
    shade: float = 1.0  # factor on the albedo besides
    # CIELAB (D65) of the face's median albedo; then the whites of eyes and teeth are drawn as well
    tone: tuple[float, float, float] | None = None
    mottle: float = 0.05  # relative standard deviation of the albedo that the model cannot explain
    freckles: bool = False
    beard: bool = False
    worn: tuple[str, ...] = ()
    interreflection: bool = False  # also brings the pixel filter of a real camera instead of a box
    # albedo of a wall behind the head and one beside it
    walls: tuple[float, float, float] | None = None
    optics: Optics = PERFECT
    sky: Sky | None = None
    scattering: float = 0.0  # how far light wanders below the skin, of what is published
    relief: bool = False  # grooves, bumps and a fine relief of known height


RECIPES = (
    Recipe(
        "soft_many",
        "eight lamps from everywhere: shading is weak evidence for shape",
        tuple(
            Lamp(azimuth, elevation, 1.0, distance, 0.3)
            for azimuth, elevation, distance in (
                (-70, 0, 0.9),
                (-45, 40, 1.2),
                (-25, -25, 1.0),
                (0, 15, 1.4),
                (15, 60, 0.9),
                (35, 0, 1.1),
                (60, 35, 1.3),
                (80, -10, 0.8),
            )
        ),
    ),
    Recipe(
        "hard_side",
        "one lamp from the side: half the face in its own shadow",
        (Lamp(63, 12, 1.0, 0.75, 0.12), Lamp(-20, 5, 0.03, 1.5, 0.5)),
    ),
    Recipe(
        "yaw_open_mouth",
        "turned by 35 degrees, the mouth open, light grazing the face",
        (Lamp(-34, 8, 1.0, 0.9, 0.1), Lamp(40, 10, 0.05, 1.4, 0.4)),
        {"jawOpen": 0.65, "mouthLowerDownLeft": 0.2, "mouthLowerDownRight": 0.2},
        pose=(35, 2, 2),
    ),
    Recipe(
        "from_above",
        "a ceiling lamp: the eyes, the lip and the neck in shadow",
        (Lamp(12, 66, 1.0, 0.9, 0.15), Lamp(-30, 0, 0.05, 1.5, 0.4)),
    ),
    Recipe(
        "from_below",
        "a lamp below the chin: shadows run the wrong way",
        (Lamp(-18, -52, 1.0, 0.7, 0.12), Lamp(40, 20, 0.06, 1.5, 0.4)),
    ),
    Recipe(
        "backlit",
        "two lamps behind the head and a weak one in front",
        (
            Lamp(138, 28, 1.6, 1.1, 0.15),
            Lamp(-128, 15, 1.2, 1.0, 0.15),
            Lamp(12, 12, 0.22, 1.2, 0.4),
        ),
    ),
    Recipe(
        "two_colors",
        "a warm and a cool lamp from either side: the skin's color is uncertain",
        (
            Lamp(-55, 22, 1.0, 0.9, 0.2, WARM),
            Lamp(58, 3, 0.9, 1.0, 0.2, COOL),
            Lamp(0, 10, 0.05, 1.5, 0.4),
        ),
    ),
    Recipe(
        "point_lamp",
        "a lamp of 1 cm: shadows with sharp edges",
        (Lamp(36, 32, 1.0, 1.2, 0.01), Lamp(-45, 0, 0.06, 1.5, 0.4)),
    ),
    Recipe("window", "one softbox of 0.9 m from the side", (Lamp(-52, 16, 1.0, 1.15, 0.9),)),
    Recipe("pitch_down", "the head bowed by 22 degrees", pose=(-8, 22, 0)),
    Recipe(
        "strong_expression",
        "teeth bared, cheeks up, brows down",
        expression={
            "mouthSmileLeft": 0.9,
            "mouthSmileRight": 0.8,
            "mouthUpperUpLeft": 0.7,
            "mouthUpperUpRight": 0.6,
            "cheekSquintLeft": 0.8,
            "cheekSquintRight": 0.8,
            "browDownLeft": 0.8,
            "browDownRight": 0.7,
            "jawOpen": 0.2,
            "noseSneerLeft": 0.5,
            "noseSneerRight": 0.4,
            "browInnerUp": 0.0,
        },
    ),
    Recipe("dull_skin", "skin of roughness 0.6: highlights are wide and weak", roughness=0.6),
    Recipe("oily_skin", "skin of roughness 0.25: highlights are small and clip", roughness=0.25),
    Recipe("freckles", "freckles, and blotches of 12 %", mottle=0.12, freckles=True),
    Recipe(
        "interreflection",
        "light that the skin reflects onto itself, which the fit does not trace",
        (Lamp(48, 18, 1.0, 0.9, 0.15), Lamp(-60, -10, 0.1, 1.2, 0.3)),
        melanin=-0.3,
        interreflection=True,
    ),
    Recipe(
        "cap",
        "a brim hides the forehead and shades the eyes",
        (Lamp(-22, 48, 1.0, 1.1, 0.15), Lamp(25, 0, 0.3, 1.3, 0.4)),
        worn=("cap",),
    ),
    Recipe("fringe", "hair hides the forehead", worn=("fringe",)),
    Recipe("glasses", "a frame on the nose, and its shadow on the cheeks", worn=("glasses",)),
    Recipe("beard", "a dark beard, which no skin tone explains", beard=True),
    Recipe("dark_skin", "dark skin: highlights outshine it", melanin=1.1),
    Recipe("light_skin", "as light as skin is: hardly any color", melanin=-0.35),
    Recipe(
        "strands",
        "thin strands of hair over the forehead, with skin between them",
        worn=("strands",),
    ),
    Recipe("hand", "a hand of the same color leans on the cheek", worn=("hand",)),
    Recipe(
        "colored_wall",
        "saturated walls behind and beside the head tint its shaded cheek",
        (Lamp(38, 22, 1.0, 0.9, 0.15), Lamp(70, 0, 0.3, 1.2, 0.3)),
        interreflection=True,
        walls=GREEN,
    ),
    Recipe(
        "shallow_focus",
        "an open aperture: ears and nose are out of focus",
        optics=Optics(f_number=1.8),
    ),
    Recipe(
        "jpeg_50",
        "a JPEG of quality 50: blocks, and color at half the size",
        optics=Optics(jpeg_quality=50),
    ),
    Recipe(
        "high_iso",
        "sensor noise of little light: a pixel holds 400 electrons",
        optics=Optics(electrons=400),
    ),
    Recipe(
        "snapshot",
        "all of it: strands, a hand, orange walls, an open aperture, noise, a JPEG",
        (Lamp(35, 30, 1.0, 1.0, 0.3), Lamp(10, 60, 0.5, 1.3, 0.6, WARM)),
        {"mouthSmileLeft": 0.5, "mouthSmileRight": 0.5},
        pose=(-8, 3, 4),
        worn=("strands", "hand"),
        interreflection=True,
        walls=ORANGE,
        optics=Optics(f_number=2.8, electrons=1000, jpeg_quality=60),
    ),
    Recipe("close_up", "from 0.45 m: strong perspective", distance=0.45, pose=(12, -4, 3)),
    Recipe(
        "grazing",
        "turned by 40 degrees, the jaw wide open, one lamp that grazes the face",
        (Lamp(-44, 6, 1.0, 0.9, 0.1),),
        {"jawOpen": 0.95, "mouthLowerDownLeft": 0.2, "mouthLowerDownRight": 0.2},
        pose=(40, 2, 2),
    ),
)
# Skin that light wanders in, and lights itself: by the random walk of Cycles.
BELOW = tuple(
    replace(
        recipe,
        name=f"{recipe.name}_below",
        hard=f"{recipe.hard}; light below the skin",
        interreflection=True,
        scattering=1.0,
    )
    for recipe in RECIPES
    if recipe.name in ("soft_many", "hard_side", "point_lamp", "window")
)

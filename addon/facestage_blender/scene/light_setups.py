"""Portrait light that has a name: where its lamps are, and how the light is shared. No bpy.

Stage frame: x is the picture's right, z towards the camera. The key comes from the picture's left.
A face that looks elsewhere has the same light where it turns to: it is the face that photographers
count the degrees from.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .frames import LIGHT_DIRECTIONS

# Exponents of the cosine lobe: a soft light that still casts a shadow, a softbox, and a reflector.
SHARPNESS, SOFTBOX, REFLECTOR = 6.0, 14.0, 3.0


@dataclass(frozen=True)
class Beam:
    """Light ``towards`` (x, y, z) of which comes a ``share`` of all, the narrower the sharper."""

    towards: tuple[float, float, float]
    share: float = 1.0
    sharpness: float = SHARPNESS

    def lobe(self, outward: np.ndarray) -> np.ndarray:
        """(N,) shares of lights that stand ``outward`` (N, 3), unit vectors; where none is on that
        side the nearest has all.
        """
        towards = np.array(self.towards) / np.linalg.norm(self.towards)
        cosine = outward @ towards
        lobe = np.maximum(0.0, cosine) ** self.sharpness
        if lobe.sum() <= 1e-6:
            lobe = (np.arange(len(outward)) == np.argmax(cosine)).astype(float)
        return np.asarray(self.share * lobe / lobe.sum())


@dataclass(frozen=True)
class Setup:
    """What it is called, what it does to a face, and its beams, whose shares sum to 1."""

    label: str
    help: str
    beams: tuple[Beam, ...]

    def mirrored(self) -> Setup:
        """With the key from the picture's right."""
        beams = (
            replace(beam, towards=(-beam.towards[0], *beam.towards[1:])) for beam in self.beams
        )
        return replace(self, beams=tuple(beams))

    def before(self, yaw: float) -> Setup:
        """As a face sees it that is turned by ``yaw`` radians to the picture's right."""
        beams = (replace(beam, towards=_turned(beam.towards, yaw)) for beam in self.beams)
        return replace(self, beams=tuple(beams))


def _turned(towards: tuple[float, float, float], yaw: float) -> tuple[float, float, float]:
    """A direction turned about the vertical, from the camera to the picture's right."""
    x, y, z = towards
    cosine, sine = float(np.cos(yaw)), float(np.sin(yaw))
    return cosine * x + sine * z, y, cosine * z - sine * x


def direction(left: float, up: float) -> tuple[float, float, float]:
    """The direction that is so many degrees left of the camera and above it."""
    yaw, pitch = np.radians(left), np.radians(up)
    x, y, z = -np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)
    return float(x), float(y), float(z)


SETUPS = {
    "key_fill_rim": Setup(
        "Key, Fill and Rim",
        "Three softboxes: the key at 45 degrees, a weak fill from the other side, and a rim from "
        "behind where the stage has lights there",
        (
            Beam(direction(45, 30), 0.62, SOFTBOX),
            Beam(direction(-45, 5), 0.18, REFLECTOR),
            Beam(direction(-150, 30), 0.2, SOFTBOX),
        ),
    ),
    "butterfly": Setup(
        "Butterfly",
        "A softbox high above the camera, a reflector below: a small shadow under the nose, "
        "shaded cheeks",
        (Beam(direction(0, 45), 0.85, SOFTBOX), Beam(direction(0, -30), 0.15, REFLECTOR)),
    ),
    "loop": Setup(
        "Loop",
        "A softbox 35 degrees to the side and above: the nose's shadow makes a small loop on the "
        "cheek",
        (Beam(direction(35, 35), 0.85, SOFTBOX), Beam(direction(-40, 0), 0.15, REFLECTOR)),
    ),
    "rembrandt": Setup(
        "Rembrandt",
        "A softbox 55 degrees to the side, high, hardly any fill: a lit triangle on the cheek in "
        "shade",
        (Beam(direction(55, 45), 0.93, SOFTBOX), Beam(direction(-40, 5), 0.07, REFLECTOR)),
    ),
    "split": Setup(
        "Split",
        "A softbox straight from the side: one half of the face is lit",
        (Beam(direction(90, 5), 1.0, SOFTBOX),),
    ),
}
# By name: all that the light can come from.
LIGHT_FROM = {
    name: Setup(name.capitalize(), f"Light from the {name}", (Beam(towards),))
    for name, towards in LIGHT_DIRECTIONS.items()
} | SETUPS

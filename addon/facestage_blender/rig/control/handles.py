"""Which handle moves which sliders: a table, and what of it a face has.

Names and sides are those of Rigify's face (its `super_face`), so that poses can be mirrored and
bones are found where animators look for them; `mouth` is not among them. Axes are a handle's own:
X towards the face's left, Y up, Z forward. The jaw's and the eyes' Y points forward and their Z
down, so that a turn about X opens or lowers.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

from facestage.contract.arkit import spellings

SIDES = {"Left": ".L", "Right": ".R"}
BOTH = ("Left", "Right")

HEAD, EYES, BROWS, MOUTH, CHEEKS = "Head", "Eyes", "Brows", "Mouth", "Cheeks and Nose"


@dataclass(frozen=True)
class Drive:
    """A direction of a handle, and the slider that it moves."""

    axis: int  # 0, 1, 2 of the handle's own axes
    sign: int
    slider: str  # by ARKit's name; where handles are made of it, by the rig's own
    gain: float = 1.0  # of the slider at the end of the handle's way
    turn: bool = False  # the handle turns about the axis, else it moves along it


@dataclass(frozen=True)
class Handle:
    """A handle of the face."""

    name: str
    group: str
    drives: tuple[Drive, ...]
    at: str = ""  # the slider that moves the skin most where the handle stands; else its first
    toward: tuple[int, int] = (1, 1)  # axis and sign of that motion; X on the left side
    beside: str = ""  # a slider that moves the same skin, away from which the handle stands
    parent: str = "head"

    @property
    def side(self) -> int:
        """1 on the face's left, -1 on its right, else 0."""
        return next((s for end, s in ((".L", 1), (".R", -1)) if end in self.name), 0)


def _both(axis: int, sign: int, slider: str) -> tuple[Drive, ...]:
    return tuple(Drive(axis, sign, slider + side) for side in BOTH)


def _sided(handle: Handle) -> tuple[Handle, Handle]:
    """A handle of the left side, and its mirror image."""
    drives = tuple(
        replace(
            drive,
            sign=-drive.sign if drive.axis == (2 if drive.turn else 0) else drive.sign,
            slider=drive.slider.replace("Left", "Right"),
        )
        for drive in handle.drives
    )
    mirrored = replace(
        handle,
        name=handle.name.replace(".L", ".R"),
        drives=drives,
        at=handle.at.replace("Left", "Right"),
        beside=handle.beside.replace("Left", "Right"),
        parent=handle.parent.replace(".L", ".R"),
    )
    return handle, mirrored


JAW = Handle(
    "jaw_master",
    MOUTH,
    (
        Drive(0, 1, "jawOpen", turn=True),
        Drive(2, -1, "jawLeft", turn=True),
        Drive(2, 1, "jawRight", turn=True),
        Drive(1, 1, "jawForward"),
    ),
    toward=(1, -1),
)
EYE, OTHER_EYE = _sided(
    Handle(
        "master_eye.L",
        EYES,
        (
            Drive(0, 1, "eyeLookDownLeft", turn=True),
            Drive(0, -1, "eyeLookUpLeft", turn=True),
            Drive(2, 1, "eyeLookInLeft", turn=True),
            Drive(2, -1, "eyeLookOutLeft", turn=True),
        ),
    )
)
TARGETS = {"master_eye.L": "eye.L", "master_eye.R": "eye.R"}  # what each eye looks at
TARGET = "eyes"  # carries both
_HANDLES = (
    Handle(
        "lip.T",
        MOUTH,
        (
            *_both(1, 1, "mouthUpperUp"),
            Drive(1, -1, "mouthClose"),
            Drive(2, 1, "mouthShrugUpper"),
            Drive(2, -1, "mouthRollUpper"),
        ),
        at="mouthRollUpper",
        toward=(2, -1),
    ),
    Handle(
        "lip.B",
        MOUTH,
        (
            *_both(1, -1, "mouthLowerDown"),
            Drive(1, 1, "mouthShrugLower"),
            Drive(2, -1, "mouthRollLower"),
        ),
        at="mouthRollLower",
        toward=(2, -1),
        parent=JAW.name,
    ),
    Handle(
        "mouth",
        MOUTH,
        (Drive(0, 1, "mouthLeft"), Drive(0, -1, "mouthRight"), Drive(2, 1, "mouthFunnel")),
        at="mouthFunnel",
        toward=(2, 1),
    ),
    Handle("tongue", MOUTH, (Drive(2, 1, "tongueOut"),), toward=(2, 1), parent=JAW.name),
)
_PAIRS = (
    Handle("brow.T.L.003", BROWS, (Drive(1, 1, "browInnerUp"), Drive(1, -1, "browDownLeft", 0.5))),
    Handle("brow.T.L", BROWS, (Drive(1, 1, "browOuterUpLeft"), Drive(1, -1, "browDownLeft", 0.5))),
    Handle(
        "lid.T.L.002",
        EYES,
        (Drive(1, -1, "eyeBlinkLeft"), Drive(1, 1, "eyeWideLeft")),
        toward=(1, -1),
    ),
    Handle("lid.B.L.002", EYES, (Drive(1, 1, "eyeSquintLeft"),)),
    Handle("cheek.T.L.001", CHEEKS, (Drive(1, 1, "cheekSquintLeft"),), beside="mouthSmileLeft"),
    # Puffed cheeks go forward most at the mouth's corners, and outwards where they are cheeks.
    Handle("cheek.B.L.001", CHEEKS, (Drive(2, 1, "cheekPuff"),), toward=(0, 1)),
    Handle("nose.L.001", CHEEKS, (Drive(1, 1, "noseSneerLeft"),), beside="mouthSmileLeft"),
    Handle(
        "lips.L",
        MOUTH,
        (
            Drive(1, 1, "mouthSmileLeft"),
            Drive(1, -1, "mouthFrownLeft"),
            Drive(0, 1, "mouthStretchLeft"),
            Drive(0, -1, "mouthPucker"),
            Drive(2, -1, "mouthDimpleLeft"),
        ),
    ),
    Handle("lip.T.L.001", MOUTH, (Drive(1, 1, "mouthUpperUpLeft"),)),
    Handle(
        "lip.B.L.001",
        MOUTH,
        (Drive(1, -1, "mouthLowerDownLeft"), Drive(1, 1, "mouthPressLeft")),
        toward=(1, -1),
        parent=JAW.name,
    ),
)
ALL = (JAW, EYE, OTHER_EYE, *_HANDLES, *(one for left in _PAIRS for one in _sided(left)))


def handles_for(sliders: Collection[str]) -> list[Handle]:
    """The handles that move any of the rig's ``sliders``, with the rig's own names in them.

    A handle at one side of a slider that both sides share moves half of it.
    """
    found = []
    for handle in ALL:
        drives = tuple(each for drive in handle.drives for each in _own(handle, drive, sliders))
        if not drives:
            continue
        at = next((each.slider for each in _own(handle, Drive(0, 1, handle.at), sliders)), "")
        beside = next(
            (each.slider for each in _own(handle, Drive(0, 1, handle.beside), sliders)), ""
        )
        toward = handle.toward if at or not handle.at else (drives[0].axis, drives[0].sign)
        found.append(
            replace(handle, drives=drives, at=at or drives[0].slider, toward=toward, beside=beside)
        )
    names = {each.name for each in found}
    return [each if each.parent in names else replace(each, parent="head") for each in found]


def _own(handle: Handle, drive: Drive, sliders: Collection[str]) -> list[Drive]:
    """What a drive is with the rig's own sliders: none, one, or one for each side."""
    for together in spellings(drive.slider):
        there = [name for name in together if name in sliders]
        if not there:
            continue
        shared = handle.side and not drive.slider.endswith(BOTH)
        if shared and len(together) > 1:  # a left and a right one, of which this is one side's
            there = [name for name in there if name.endswith("_L" if handle.side > 0 else "_R")]
        gain = drive.gain * (0.5 if shared and len(together) == 1 else 1.0)
        return [replace(drive, slider=name, gain=gain) for name in there]
    return []

"""Expressions by name: those that come with Facestage, and those that the user keeps.

Sliders are told by ARKit's names where a face model has these, and by its own.
"""

from __future__ import annotations

import re
from pathlib import Path

import bpy

from facestage.contract.arkit import ARKIT_NAMES, slider_weights, spellings
from facestage.contract.errors import InputError
from facestage.contract.files.storage import read_json, write_json
from facestage.contract.schemas.fields import Figures, Whole
from facestage.contract.schemas.schema import FileSchema, check_version, checked

from .expressions import expression_keys, move

SCHEMA_VERSION = 1
LONGEST = 48
_BOTH = ("Left", "Right")


def _both(**weights: float) -> dict[str, float]:
    """Weights by ARKit's names, given once for left and right."""
    return {
        f"{name}{side}" if f"{name}{side}" in ARKIT_NAMES else name: weight
        for name, weight in weights.items()
        for side in _BOTH
    }


# Emotions by the muscles that Ekman, Friesen and Hager 2002 (FACS, Investigator's Guide) name for
# them, in the shapes that stand nearest.
BUILT_IN: dict[str, dict[str, float]] = {
    "Smile": _both(mouthSmile=0.6, cheekSquint=0.35, mouthDimple=0.1),
    "Laugh": _both(mouthSmile=0.9, cheekSquint=0.7, eyeSquint=0.4, jawOpen=0.35, mouthUpperUp=0.25),
    "Surprise": _both(browInnerUp=0.9, browOuterUp=0.8, eyeWide=0.7, jawOpen=0.45),
    "Anger": _both(browDown=0.9, eyeWide=0.3, eyeSquint=0.4, noseSneer=0.3, mouthPress=0.6),
    "Sadness": _both(browInnerUp=0.8, browDown=0.2, mouthFrown=0.6, mouthShrugLower=0.4),
    "Fear": _both(
        browInnerUp=0.9, browOuterUp=0.4, browDown=0.3, eyeWide=0.9, mouthStretch=0.6, jawOpen=0.2
    ),
    "Disgust": _both(noseSneer=0.9, mouthUpperUp=0.5, browDown=0.4, mouthFrown=0.3),
    "Wink": {"eyeBlinkLeft": 1.0, "cheekSquintLeft": 0.5, **_both(mouthSmile=0.25)},
    "Kiss": _both(mouthPucker=0.9, mouthFunnel=0.15),
    "Ah": _both(jawOpen=0.6, mouthLowerDown=0.2),
    "Ee": _both(mouthStretch=0.4, mouthSmile=0.3, mouthLowerDown=0.3, mouthUpperUp=0.2),
    "Oh": _both(mouthFunnel=0.7, jawOpen=0.3),
}


class PresetSchema(FileSchema):
    """A kept expression."""

    schema = Whole(SCHEMA_VERSION, SCHEMA_VERSION)
    weights = Figures()


def preset_names(folder: Path) -> list[str]:
    """The names of the expressions that the user keeps in ``folder``."""
    return sorted((path.stem for path in folder.glob("*.json")), key=str.casefold)


def apply_preset(rig: bpy.types.Object, name: str, folder: Path) -> None:
    """Move all expression sliders to a preset; those that it does not name come to rest.

    Raises InputError where there is none of this name, or the rig has none of its sliders.
    """
    keys = {key.name for keys in expression_keys(rig).values() for key in keys}
    weights = _kept(folder, name) if name in preset_names(folder) else BUILT_IN.get(name)
    if weights is None:
        raise InputError(
            f"There is no expression '{name}'; expected {', '.join(BUILT_IN)}, or one of yours."
        )
    wanted = {name: weight for name, weight in weights.items() if name in keys}
    wanted |= slider_weights(weights, keys)
    if not wanted:
        raise InputError(
            f"The face has none of the sliders of '{name}' ({', '.join(list(weights)[:3])}, ...); "
            "it is made for faces with ARKit's expressions."
        )
    move(rig, dict.fromkeys(keys, 0.0) | wanted)


def keep_preset(rig: bpy.types.Object, name: str, folder: Path) -> None:
    """Keep the rig's present expression in ``folder``, by ARKit's names where it has them.

    Raises InputError for a name that no file can have, or that comes with Facestage.
    """
    name = name.strip()
    if not re.fullmatch(r"[\w][\w .-]*", name) or len(name) > LONGEST or name.endswith("."):
        raise InputError(
            f"'{name}' cannot name an expression; use up to {LONGEST} letters, digits, spaces and "
            "hyphens."
        )
    if name in BUILT_IN:
        raise InputError(f"'{name}' comes with Facestage; choose another name.")
    values = {key.name: key.value for keys in expression_keys(rig).values() for key in keys}
    weights = {slider: value for slider, value in values.items() if value}
    for arkit in ARKIT_NAMES:
        for together in spellings(arkit)[1:]:
            given = [weights.get(slider, 0.0) for slider in together if slider in values]
            if any(given) and max(given) == min(given):  # one weight says them all
                weights = {key: each for key, each in weights.items() if key not in together}
                weights[arkit] = given[0]
    folder.mkdir(parents=True, exist_ok=True)
    write_json(_file(folder, name), {"schema": SCHEMA_VERSION, "weights": weights})


def forget_preset(name: str, folder: Path) -> None:
    """Delete an expression that the user kept. Raises InputError when there is none."""
    if name not in preset_names(folder):
        raise InputError(f"There is no expression '{name}' of yours.")
    _file(folder, name).unlink(missing_ok=True)


def _kept(folder: Path, name: str) -> dict[str, float]:
    path = _file(folder, name)
    what, again = f"The expression '{path}'", "keep it again"
    data = read_json(path, "expression")
    check_version(data, SCHEMA_VERSION, what, again)
    weights: dict[str, float] = checked(PresetSchema(), data, what, again)["weights"]
    return weights


def _file(folder: Path, name: str) -> Path:
    return folder / f"{name}.json"

"""The kinds of face models, and the one that the scene has chosen."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import bpy

from facestage.contract.errors import InputError
from facestage.contract.files.paths import is_file, is_folder
from facestage.contract.job import DEFAULT_MODEL

from ..scene.paths import absolute


@dataclass(frozen=True)
class ModelKind:
    """A kind of face model that the backend loads: what it is called, its license, and what files
    it comes as.
    """

    label: str
    license: str
    help: str
    icon: str = "FILE_FOLDER"
    patterns: str = "*"


# By the word that the backend's specification begins with.
KINDS = {
    DEFAULT_MODEL: ModelKind(
        "Built-in Head",
        "GPL-3.0-or-later",
        "A head made by code from published body measurements",
        "USER",
    ),
    "ict": ModelKind(
        "ICT-FaceKit",
        "MIT",
        "Scanned heads with 100 identities and 53 expressions: its folder or archive",
    ),
    "flame": ModelKind(
        "FLAME",
        "the FLAME license, non-commercial; FLAME 2023 Open alone is CC-BY-4.0",
        "Scanned heads with a jaw that turns: a FLAME file, or the folder it is in",
        patterns="*.pkl;*.npz",
    ),
    "bfm": ModelKind(
        "Basel Face Model",
        "the Basel Face Model's, non-commercial research only",
        "Scanned faces with their colors: a Basel Face Model file, or the folder it is in",
        patterns="*.mat;*.h5",
    ),
    "gnm": ModelKind(
        "GNM Head",
        "Apache-2.0",
        "Google's head model: its gnm_head.npz, or the folder it is in",
        patterns="*.npz",
    ),
    "rig": ModelKind(
        "Your Own Rig",
        "yours",
        "A mesh with shape keys that was written to a file",
        "SHAPEKEY_DATA",
    ),
    "npz": ModelKind(
        "Facestage Model",
        "as the file says",
        "A face model saved in Facestage's own form",
        "FILE",
        "*.npz",
    ),
}


def choose_model(scene: bpy.types.Scene, kind: str, filepath: str = "") -> None:
    """Make a kind's model in a file or folder the scene's. Raises InputError when it is not there.

    Whether it is such a model, the backend says when the rig is built.
    """
    if kind == DEFAULT_MODEL:
        scene.facestage.model = DEFAULT_MODEL
        return
    path = absolute(filepath) if filepath else Path()
    if not filepath or not (is_file(path) or is_folder(path)):
        raise InputError(
            f"The face model '{filepath}' does not exist; choose the file or folder of "
            f"{KINDS[kind].label}."
        )
    scene.facestage.model = f"{kind}:{path}"


def model_label(specification: str) -> str:
    """What the panel calls a model: its kind, and the file it is in."""
    name, _, path = specification.partition(":")
    kind = KINDS.get(name)
    if kind is None:
        return specification or "Choose a face model"
    return f"{kind.label} ({Path(path).name})" if path else kind.label


def model_license(scene: bpy.types.Scene) -> str:
    """The license of the chosen face model: as the model itself says once its rig is built, else as
    its kind says.
    """
    specification, rig = scene.facestage.model, scene.facestage.rig
    if rig is not None and rig.facestage_face.model == specification:
        return rig_license(rig)
    return _kind_license(specification)


def rig_license(rig: bpy.types.Object) -> str:
    """The license of the face model that a rig was built from."""
    if "facestage_license" in rig.data:
        return str(rig.data["facestage_license"])
    return _kind_license(rig.facestage_face.model)


def _kind_license(specification: str) -> str:
    kind = KINDS.get(specification.partition(":")[0])
    return kind.license if kind is not None else "unknown"

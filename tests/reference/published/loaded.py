"""The loaders of published models, each with the default head."""

from __future__ import annotations

from pathlib import Path

from facestage.contract.face_model import FaceModel
from facestage.models.loaders import bfm, flame, gnm, rig
from facestage.models.registry import default_model


def load_bfm(path: Path) -> FaceModel:
    return bfm.load_bfm(path, default_model)


def load_flame(path: Path) -> FaceModel:
    return flame.load_flame(path, default_model)


def load_gnm(path: Path) -> FaceModel:
    return gnm.load_gnm(path, default_model)


def load_rig(path: Path) -> FaceModel:
    return rig.load_rig(path, default_model)

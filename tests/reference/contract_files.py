"""A job and a rig with every field given, for the tests of the files that hold them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from facestage.contract.face_model import FaceModel
from facestage.contract.job import Job, Weights
from facestage.contract.pins import Pins
from facestage.contract.rig_file import RigFile


def full_job(image: Path, camera_to_stage: np.ndarray, **given: Any) -> Job:
    """``given``: landmarks, camera and stage."""
    return Job(
        image=image,
        model="npz:face.npz",
        camera_to_stage=camera_to_stage,
        light_color="uniform",
        freeze=("pose", "roughness"),
        weights=Weights(photo=0.5, light=2.0),
        initial={"identity": np.arange(3.0), "roughness": np.array(0.3)},
        budget_seconds=12.5,
        seed=7,
        device="cpu",
        truth=Path("/elsewhere/truth.npz"),
        face_region=Path("/elsewhere/face.npy"),
        face=2,
        pins=Pins(
            np.array([[0, 1, 2], [2, 4, 3]]),
            np.array([[0.5, 0.25, 0.25], [0.0, 1.0, 0.0]]),
            np.array([[3.5, 7.25], [-1.0, 2.0]]),
            np.array([0.125, 2.0]),
        ),
        **given,
    )


def full_rig(model: FaceModel, **changes: Any) -> RigFile:
    """The surface and the sliders of ``model`` as a mesh of the user's."""
    return RigFile(
        name="Alice",
        license="yours",
        vertices=model.vertices.astype(float),
        polygons=model.polygons,
        polygon_uvs=model.polygon_uvs,
        polygon_part=model.polygon_part,
        uvs=model.uvs,
        expression_names=model.expression_names,
        expression_offsets=model.expression_basis,
        identity_names=model.identity_names,
        identity_offsets=model.identity_basis,
        borrow_identity=False,
        marks={"chin": np.array([3, 5], np.int32)},
        **changes,
    )

"""Where the landmarks lie on a rig's mesh: kept on the mesh, as its face model says."""

from __future__ import annotations

import bpy
import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.face_model import FaceModel
from facestage.contract.landmarks import IBUG, MEDIAPIPE

KEY = "facestage_landmarks_"


def remember_landmarks(mesh: bpy.types.Mesh, model: FaceModel) -> None:
    """Keep the model's landmark tables on its mesh."""
    for scheme in (MEDIAPIPE, IBUG):
        if scheme in model.landmarks:
            mesh[KEY + scheme] = np.asarray(model.landmarks[scheme], np.float64).ravel().tolist()
        elif KEY + scheme in mesh:
            del mesh[KEY + scheme]


def landmark_points(rig: bpy.types.Object, scheme: str = "") -> tuple[str, np.ndarray, np.ndarray]:
    """A scheme, and of each of its landmarks the vertices (m, 3) and their barycentric weights
    (m, 3); without ``scheme`` the one that has most.

    Raises InputError when the rig knows none.
    """
    mesh = rig.data
    for name in (scheme,) if scheme else (MEDIAPIPE, IBUG):
        if KEY + name in mesh:
            table = np.array(mesh[KEY + name], np.float64).reshape(-1, 6)
            corners = table[:, :3].astype(int)
            if len(corners) and corners.min() >= 0 and corners.max() < len(mesh.vertices):
                return name, corners, table[:, 3:]
    again = "Use My Mesh" if rig.facestage_face.own_mesh else "Rebuild Face Rig"
    raise InputError(
        f"The mesh of '{rig.name}' does not say where its landmarks are; press {again}, then "
        "apply the result."
    )

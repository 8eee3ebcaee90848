"""A face model's mean face, straight before a camera."""

from __future__ import annotations

import numpy as np

from facestage.contract.camera import Camera
from facestage.contract.face_model import FaceModel
from facestage.fit.face.state import State


def front_view(model: FaceModel) -> State:
    """At 1.1 m, 256 x 256 pixels, unlit."""
    return State(
        np.eye(3),
        np.array([0.0, 0.0, -1.1]),
        Camera.default(256, 256, 600.0),
        np.zeros(len(model.identity_names)),
        np.zeros(len(model.expression_names)),
        np.zeros(0),
        np.zeros((1, 2)),
        np.zeros(len(model.albedo_basis)),
        0.4,
        np.full((4, 4), 0.8),
    )

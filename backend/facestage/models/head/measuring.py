"""The published measurements, taken on a shape of the built-in head."""

from __future__ import annotations

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.face_model import FaceModel

MM = 1e-3


def measured(
    model: FaceModel, shape: Float[np.ndarray, "vertices 3"] | None = None
) -> dict[str, float]:
    """In mm by the names of anthropometry.py, of ``shape`` (n, 3) in metres or the neutral face."""
    vertices = (model.vertices if shape is None else shape).astype(np.float64) / MM
    index, weights = model.landmark_vertices("ibug68")
    points = np.einsum("lkc,lk->lc", vertices[index], weights)
    head = vertices[np.setdiff1d(model.regions["skin"], model.regions["ears"])]
    eye_y = points[36:48, 1].mean()
    cranium = head[head[:, 1] > eye_y + 15]
    zygoma = head[(np.abs(head[:, 1] - eye_y + 18) < 6) & (head[:, 2] > points[27, 2] - 75)]
    jaw = head[(np.abs(head[:, 1] - eye_y + 80) < 4) & (head[:, 2] > points[27, 2] - 95)]
    pupils = [vertices[model.regions[f"eye_{side}"]] for side in ("left", "right")]
    pupils = [eye[eye[:, 2].argmax()] for eye in pupils]
    wings = vertices[model.regions["narrow_face"]]
    wings = wings[(np.abs(wings[:, 1] - points[33, 1] - 6) < 4) & (wings[:, 2] > points[31, 2] - 4)]
    return {
        "head_length": float(np.ptp(cranium[:, 2])),
        "head_breadth": float(np.ptp(cranium[:, 0])),
        "bizygomatic_breadth": float(np.ptp(zygoma[:, 0])),
        "bigonial_breadth": float(np.ptp(jaw[:, 0])),
        "menton_sellion_length": float(np.linalg.norm(points[27] - points[8])),
        "subnasale_sellion_length": float(np.linalg.norm(points[27] - points[33])),
        "interpupillary_distance": float(pupils[0][0] - pupils[1][0]),
        "nose_breadth": float(np.ptp(wings[:, 0])),
        "nose_protrusion": float(np.linalg.norm(points[30] - points[33])),
        "lip_length": float(np.linalg.norm(points[54] - points[48])),
        "eye_fissure_length": float(np.linalg.norm(points[45] - points[42])),
        "ear_length": float(np.ptp(vertices[model.regions["ears"], 1])),
    }

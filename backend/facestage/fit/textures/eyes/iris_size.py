"""How large the irises of a photo are beside those of the fitted head.

Eyeballs grow with the head, of which a photo knows no size; irises are alike in all people, and
their breadth beside the lids' is seen.
"""

from __future__ import annotations

import numpy as np

from facestage.contract.landmarks import Landmarks
from facestage.fit.energy.landmark_term import landmark_pixels
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.state import State
from facestage.models.anatomy.landmark_schemes import scheme_of

# Shares of the model's, as far as an iris is drawn smaller or larger.
SMALLEST, LARGEST = 0.8, 1.1


def iris_size(geometry: FaceGeometry, state: State, landmarks: Landmarks) -> float:
    """Radius of the photo's irises as a share of the model's; 1 where landmarks do not show it."""
    scheme = scheme_of(landmarks.scheme)
    points = landmarks.points
    shut = scheme.behind_closed_lids(points)
    fitted = landmark_pixels(geometry, landmarks, state) if scheme.eyes else points
    shares = []
    for eye in scheme.eyes:
        at = list(eye.iris)
        if landmarks.counted[at].all() and not shut[at].any():
            seen, own = (
                np.linalg.norm(each[at[1:]] - each[at[0]], axis=1).mean()
                for each in (points, fitted)
            )
            shares.append(seen / max(own, 1e-9))
    return float(np.clip(np.mean(shares), SMALLEST, LARGEST)) if shares else 1.0

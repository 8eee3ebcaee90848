"""How the built-in head's modes vary together in people: the weights of its whole-face modes.

python tools/derive_variation.py ict:PATH

Carries the identity modes of ICT-FaceKit, each of one standard deviation, to the face of the
built-in head, asks what coefficients of its independent modes say the same (a step of expectation
maximisation of their covariance, begun at the prior; Dempster, Laird and Rubin 1977), and prints
its largest directions. They are committed as TOGETHER in models/head/variation.py; nobody else
needs to run this.
"""

from __future__ import annotations

import argparse

import numpy as np
from derive_neutral import along_normals, carried, independent, similar, without

from facestage.contract.face_model import FaceModel
from facestage.contract.landmarks import IBUG
from facestage.models.registry import load_model

MM = 1e-3
# How many observations the face is, their deviation in mm, and that of a landmark.
OBSERVATIONS, DEVIATION, MARK = 150.0, 0.7, 1.2
JAW_MARKS = 17  # the first of ibug68, which are no places of the skin
DIRECTIONS = 2  # the others are hardly larger than the prior's
SMALLEST = 0.3  # a smaller weight is left out
# Size is no matter of shape; the registration knows nothing of neck, skull and ears.
LEFT_OUT = (
    "head_size", "head_length", "crown_height", "occiput_fullness", "neck_girth",
    "larynx_prominence", "ear_size", "ear_protrusion",
)  # fmt: skip


def rows(head: FaceModel, other: FaceModel) -> tuple[np.ndarray, np.ndarray]:
    """What is seen of the head's modes (r, k) and of the other's (r, o), in deviations and after a
    similarity: motion along the face's normals, and of the landmarks.
    """
    place = carried(head, other)
    points = head.vertices[place.face].astype(np.float64)
    middle = place.share @ points
    back = place.similarity.rotation / place.similarity.scale
    marks = np.arange(JAW_MARKS, 68)

    def seen(face: np.ndarray, landmarks: np.ndarray) -> np.ndarray:
        across = (
            np.sqrt(OBSERVATIONS) / DEVIATION * along_normals(head, place.face, place.share, face)
        )
        return np.concatenate([across, landmarks.reshape(len(landmarks), -1).T / (MARK * MM)])

    def moved(model: FaceModel) -> np.ndarray:
        corners, weights = model.landmark_vertices(IBUG)
        modes = model.identity_basis[:, corners[marks]].astype(np.float64)
        return np.einsum("mi,kmix->kmx", weights[marks], modes)

    corners, weights = head.landmark_vertices(IBUG)
    points_68 = np.einsum("mi,mix->mx", weights, head.vertices[corners].astype(np.float64))[marks]
    fields = seen(similar(points, middle), similar(points_68, middle))
    own = seen(head.identity_basis[:, place.face].astype(np.float64), moved(head))
    theirs = seen(place.of(other.identity_basis.astype(np.float64)) @ back, moved(other) @ back)
    return without(own, fields), without(theirs, fields)


def main() -> None:
    """Print the weights, largest first."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("model", help="ict:PATH")
    head = independent()
    names = np.array(head.identity_names)
    own, people = rows(head, load_model(parser.parse_args().model))
    free = np.array([name not in LEFT_OUT and "asymmetry" not in name for name in names])
    own, names = own[:, free], names[free]
    posterior = np.linalg.inv(np.eye(len(names)) + own.T @ own)
    means = posterior @ (own.T @ people)
    variances, directions = np.linalg.eigh(posterior + means @ means.T)
    print(f"variances {np.array2string(variances[:-9:-1], precision=1)}, the prior's are 1")
    taken: set[str] = set()
    for variance, direction in zip(variances[::-1], directions.T[::-1], strict=True):
        if len(taken) == DIRECTIONS:
            break
        weights = np.sqrt(variance - 1) * direction
        smooth = [k for k in np.argsort(-np.abs(weights)) if names[k].startswith("smooth")]
        bearer = next(k for k in smooth if names[k] not in taken)
        taken.add(names[bearer])
        weights *= np.sign(weights[bearer])
        # What the mode has of its own is in it too.
        weights[bearer] = np.hypot(1.0, weights[bearer])
        print(f'    "{names[bearer]}": {{')
        for number in np.argsort(-np.abs(weights)):
            if abs(weights[number]) >= SMALLEST:
                print(f'        "{names[number]}": {weights[number]:.1f},')
        print("    },")


if __name__ == "__main__":
    main()

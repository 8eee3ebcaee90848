"""Where the middle of all people lies on the built-in head: the weights of its neutral face.

python tools/derive_neutral.py ict:PATH

Lays the head as it was modelled by hand on the mean face of ICT-FaceKit, and prints the weights of
named identity modes that bring it there along its normals, from the brows down and after a
similarity, under the modes' own prior and the published means. They are committed as NEUTRAL in
models/head/neutral.py; nobody else needs to run this.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from facestage.contract.face_model import OTHER, SKIN, FaceModel
from facestage.models.correspondence.registration import register
from facestage.models.head.anthropometry import MEASUREMENTS
from facestage.models.head.default_head import build_default_model
from facestage.models.head.measuring import measured
from facestage.models.head.neutral import neutral_shift
from facestage.models.mesh.similarity import procrustes
from facestage.models.mesh.surface import Surface, normals_and_areas, vertex_normals
from facestage.models.registry import load_model

MM = 1e-3
# How many observations of 1 mm the face is, and how much more each published mean counts than the
# deviation between people.
OBSERVATIONS, PUBLISHED = 30.0, 8.0
SMALLEST = 0.25  # a smaller weight is left out, and the others found again
# Above the brows hair decides where a scan's skin is: what counts falls from 1 to 0 between these
# heights above the eyes. Lids are another expression: radius about an eye. All mm.
BROW, FOREHEAD, EYE = 20.0, 45.0, 22.0
REACH, COSINE = 4e-3, 0.5
# Modes of the skull, of neck and ears, and of what the registration cannot tell.
LEFT_OUT = (
    "head_size", "head_length", "head_breadth", "forehead_height", "forehead_slope",
    "minimum_frontal_breadth", "temple_fullness", "crown_height", "occiput_fullness", "neck_girth",
    "larynx_prominence", "ear_size", "ear_protrusion", "eye_fissure_height", "eye_fissure_length",
    "eye_tilt", "lip_thickness_upper", "lip_thickness_lower", "nasolabial_fold",
    "nose_dorsum_hump", "nostril_flare", "philtrum_depth",
)  # fmt: skip
# The ears and the lids do not move.
NOT_MEASURED = ("ear_length", "eye_fissure_length")


def modelled() -> FaceModel:
    """The built-in head before its neutral face was found."""
    model = build_default_model()
    shift = neutral_shift(model.identity_names, model.identity_basis.astype(np.float64))
    return replace(model, vertices=(model.vertices - shift).astype(np.float32))


def targets(head: FaceModel, other: FaceModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices of the head's face that have a place on the ``other`` mean, where that is (m, 3) in
    metres, and how much each counts (m,); in sum 1.
    """
    vertices = other.vertices.astype(np.float64)
    fit = register(head, vertices, other.triangles[other.triangle_part != OTHER])
    face = head.regions["face"]
    normals = vertex_normals(fit.vertices, head.triangles)[face]
    skin = Surface(vertices, other.triangles[other.triangle_part == SKIN])
    near = skin.nearest(fit.vertices[face], normals, COSINE)
    found = near.distance < REACH
    face = face[found]
    points = head.vertices[face].astype(np.float64)
    area = normals_and_areas(head.vertices.astype(np.float64), head.triangles)[1]
    share = np.bincount(head.triangles.ravel(), np.repeat(area, 3), len(head.vertices))[face]
    eyes = [head.vertices[head.regions[f"eye_{side}"]].mean(axis=0) for side in ("left", "right")]
    level = np.mean([eye[1] for eye in eyes])
    share *= np.clip((FOREHEAD * MM + level - points[:, 1]) / ((FOREHEAD - BROW) * MM), 0, 1)
    for eye in eyes:
        share[np.linalg.norm(points - eye, axis=1) < EYE * MM] = 0.0
    share[np.isin(face, head.regions["lips"])] = 0.0
    return face, near.point[found], share / share.sum()


def along_normals(
    head: FaceModel, face: np.ndarray, share: np.ndarray, offsets: np.ndarray
) -> np.ndarray:
    """(m, k) mm, ``offsets`` (k, m, 3) in metres along the normals, weighted, without what a
    similarity does.
    """
    points = head.vertices[face].astype(np.float64)
    x, y, z = (points - share @ points).T
    none, one = np.zeros_like(x), np.ones_like(x)
    fields = (
        (one, none, none), (none, one, none), (none, none, one),
        (none, -z, y), (z, none, -x), (-y, x, none), (x, y, z),
    )  # fmt: skip
    normals = vertex_normals(head.vertices.astype(np.float64), head.triangles)[face]
    root = np.sqrt(share)[:, None]
    similar = root * np.stack([(np.stack(f, axis=1) * normals).sum(axis=1) for f in fields], 1)
    space, _ = np.linalg.qr(similar)
    rows = root * np.einsum("kmc,mc->mk", offsets, normals) / MM
    return rows - space @ (space.T @ rows)


def published_rows(head: FaceModel) -> tuple[np.ndarray, np.ndarray]:
    """(r, k) by how many published deviations each mode changes each measurement, and (r,) how many
    the modelled head lacks.
    """
    names = [name for name in measured(head) if name not in NOT_MEASURED]
    sigma = np.array([MEASUREMENTS[name].sd for name in names])
    mean = np.array([MEASUREMENTS[name].mean for name in names])

    def values(shape: np.ndarray) -> np.ndarray:
        found = measured(head, shape)
        return np.array([found[name] for name in names])

    neutral = values(head.vertices)
    rows = [(values(head.vertices + mode) - neutral) / sigma for mode in head.identity_basis]
    return np.stack(rows, axis=1), (mean - neutral) / sigma


def weights(head: FaceModel, other: FaceModel) -> np.ndarray:
    """(k,) standard deviations of the modes."""
    face, place, share = targets(head, other)
    points = head.vertices[face].astype(np.float64)
    # The similarity that lays the other mean on the head, by the vertices that count.
    counted = share > 0
    laid = procrustes(place[counted], points[counted]).apply(place)
    wanted = along_normals(head, face, share, (laid - points)[None])[:, 0]
    rows = along_normals(head, face, share, head.identity_basis[:, face].astype(np.float64))
    published, lacking = published_rows(head)
    free = np.array(
        [
            name not in LEFT_OUT and not name.startswith("smooth") and "asymmetry" not in name
            for name in head.identity_names
        ]
    )
    result = np.zeros(len(free))
    while True:
        some, known = rows[:, free], published[:, free]
        matrix = OBSERVATIONS * some.T @ some + PUBLISHED * known.T @ known + np.eye(free.sum())
        right = OBSERVATIONS * some.T @ wanted + PUBLISHED * known.T @ lacking
        result[:] = 0.0
        result[free] = np.linalg.solve(matrix, right)
        small = free & (np.abs(result) < SMALLEST)
        if not small.any():
            break
        free &= ~small
    before, after = (np.linalg.norm(left) for left in (wanted, wanted - rows @ result))
    print(f"along the normals {before:.2f} mm from the mean face, with these weights {after:.2f}")
    return result


def main() -> None:
    """Print the weights, largest first."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("model", help="ict:PATH")
    head = modelled()
    found = weights(head, load_model(parser.parse_args().model))
    for number in np.argsort(-np.abs(found)):
        if found[number]:
            print(f'    "{head.identity_names[number]}": {found[number]:.1f},')


if __name__ == "__main__":
    main()

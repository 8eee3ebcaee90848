"""Where the middle of all people lies on the built-in head: the weights of its neutral face.

python tools/derive_neutral.py ict:PATH

Lays the head as it was modelled by hand on the mean face of ICT-FaceKit, and prints the weights of
named identity modes that bring it there along its normals, forehead and all, after a
similarity, under the modes' own prior and the published means. They are committed as NEUTRAL in
models/head/neutral.py; nobody else needs to run this.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace

import numpy as np

from facestage.contract.face_model import OTHER, SKIN, FaceModel
from facestage.models.correspondence.registration import register
from facestage.models.head.anthropometry import MEASUREMENTS
from facestage.models.head.default_head import build_default_model
from facestage.models.head.face_form import without_form
from facestage.models.head.measuring import measured
from facestage.models.head.neutral import neutral_shift
from facestage.models.head.variation import mixing
from facestage.models.mesh.similarity import Similarity, procrustes
from facestage.models.mesh.surface import Surface, normals_and_areas, vertex_normals
from facestage.models.registry import load_model

MM = 1e-3
# How many observations of 1 mm the face is, and how much more each published mean counts than the
# deviation between people.
OBSERVATIONS, PUBLISHED = 100.0, 16.0
SMALLEST = 0.25  # a smaller weight is left out, and the others found again
# Hair decides where a head's skin is: what counts falls from 1 to 0 between these heights above the
# eyes. Lids are another expression: radius about an eye. All mm.
FOREHEAD, HAIR, EYE = 50.0, 75.0, 22.0
REACH, COSINE = 4e-3, 0.5
# Modes of the skull, of neck and ears, of what the registration cannot tell, those that crease the
# lids where they are added to a face for good, and one that widens the rows of teeth.
LEFT_OUT = (
    "head_size", "head_length", "head_breadth", "crown_height", "occiput_fullness", "neck_girth",
    "larynx_prominence", "ear_size", "ear_protrusion", "eye_fissure_height", "eye_fissure_length",
    "eye_tilt", "eye_height", "eye_depth", "brow_height", "nose_root_breadth",
    "lip_thickness_upper", "lip_thickness_lower", "nasolabial_fold", "nose_dorsum_hump",
    "nostril_flare", "philtrum_depth", "smooth_breadth_01",
)  # fmt: skip
# The ears and the lids do not move.
NOT_MEASURED = ("ear_length", "eye_fissure_length")


@dataclass(frozen=True)
class Carried:
    """Vertices of the head's face that have a place on another model's mean face."""

    face: np.ndarray  # (m,) vertices of the head
    corners: np.ndarray  # (m, 3) vertices of the other
    weights: np.ndarray  # (m, 3) of these corners
    share: np.ndarray  # (m,) how much each counts, in sum 1
    similarity: Similarity  # the head's frame -> the other's

    def of(self, values: np.ndarray) -> np.ndarray:
        """``values`` (..., n, 3) of the other's vertices at the places: (..., m, 3)."""
        return np.einsum("mi,...mix->...mx", self.weights, values[..., self.corners, :])


def independent() -> FaceModel:
    """The built-in head with identity modes that vary each by itself, and no form beyond them."""
    model = without_form(build_default_model())
    apart = np.linalg.inv(mixing(model.identity_names))
    modes = np.tensordot(apart, model.identity_basis.astype(np.float64), 1)
    return replace(model, identity_basis=modes.astype(np.float32))


def modelled() -> FaceModel:
    """The built-in head before its neutral face was found."""
    model = independent()
    shift = neutral_shift(model.identity_names, model.identity_basis.astype(np.float64))
    return replace(model, vertices=(model.vertices - shift).astype(np.float32))


def carried(head: FaceModel, other: FaceModel) -> Carried:
    """Where the ``head`` lies on the ``other`` mean face."""
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
    share *= np.clip((HAIR * MM + level - points[:, 1]) / ((HAIR - FOREHEAD) * MM), 0, 1)
    for eye in eyes:
        share[np.linalg.norm(points - eye, axis=1) < EYE * MM] = 0.0
    share[np.isin(face, head.regions["lips"])] = 0.0
    corners, weights = skin.triangles[near.triangle[found]], near.weights[found]
    return Carried(face, corners, weights, share / share.sum(), fit.similarity)


def along_normals(
    head: FaceModel, face: np.ndarray, share: np.ndarray, offsets: np.ndarray
) -> np.ndarray:
    """(m, k) mm, ``offsets`` (k, m, 3) in metres along the normals of the head's ``face`` (m,), by
    the root of its ``share`` (m,).
    """
    normals = vertex_normals(head.vertices.astype(np.float64), head.triangles)[face]
    return np.sqrt(share)[:, None] * np.einsum("kmc,mc->mk", offsets, normals) / MM


def similar(points: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """(7, m, 3) what shifts, turns and growth about ``middle`` do to ``points`` (m, 3)."""
    x, y, z = (points - middle).T
    none, one = np.zeros_like(x), np.ones_like(x)
    fields = (
        (one, none, none), (none, one, none), (none, none, one),
        (none, -z, y), (z, none, -x), (-y, x, none), (x, y, z),
    )  # fmt: skip
    return np.stack([np.stack(each, axis=1) for each in fields])


def without(rows: np.ndarray, fields: np.ndarray) -> np.ndarray:
    """``rows`` (m, k) but for what ``fields`` (m, f) can say of them."""
    space, _ = np.linalg.qr(fields)
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
    found = carried(head, other)
    face, share = found.face, found.share
    place = found.of(other.vertices.astype(np.float64))
    points = head.vertices[face].astype(np.float64)
    # The similarity that lays the other mean on the head, by the vertices that count.
    counted = share > 0
    laid = procrustes(place[counted], points[counted]).apply(place)
    fields = along_normals(head, face, share, similar(points, share @ points))
    wanted = without(along_normals(head, face, share, (laid - points)[None]), fields)[:, 0]
    modes = head.identity_basis[:, face].astype(np.float64)
    rows = without(along_normals(head, face, share, modes), fields)
    published, lacking = published_rows(head)
    free = np.array(
        [name not in LEFT_OUT and "asymmetry" not in name for name in head.identity_names]
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

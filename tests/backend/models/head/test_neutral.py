"""The neutral face of the built-in head: in the middle of people, as the modes can say it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from facestage.contract.face_model import SKIN, FaceModel
from facestage.models.head.default_head import build_default_model
from facestage.models.head.face_form import without_form
from facestage.models.head.neutral import NEUTRAL, neutral_shift
from facestage.models.head.variation import mixing
from facestage.models.mesh.closest_alignment import closest_alignment
from facestage.models.mesh.similarity import Similarity
from facestage.models.mesh.surface import Surface


def modelled() -> FaceModel:
    """As it was before the weights."""
    model = without_form(build_default_model())
    apart = np.linalg.inv(mixing(model.identity_names))
    modes = np.tensordot(apart, model.identity_basis.astype(np.float64), 1)
    shift = neutral_shift(model.identity_names, modes)
    return replace(model, vertices=(model.vertices - shift).astype(np.float32))


def marks(model: FaceModel) -> np.ndarray:
    """(68, 3) metres."""
    corners, weights = model.landmark_vertices("ibug68")
    return np.einsum("mi,mix->mx", weights, model.vertices[corners].astype(np.float64))


def distances(model: FaceModel, people: Surface) -> tuple[float, float]:
    """Median in mm of the model's neutral face, without eyes and lips, below the lowest of the
    brows' landmarks and from 10 to 30 mm above it, from the surface ``people``, laid on both by a
    similarity.
    """
    face = np.setdiff1d(model.regions["face"], model.regions["lips"])
    points = model.vertices[face].astype(np.float64)
    height = points[:, 1] - marks(model)[17:27, 1].min()
    for side in ("left", "right"):
        eye = model.vertices[model.regions[f"eye_{side}"]].mean(axis=0)
        height[np.linalg.norm(points - eye, axis=1) < 0.022] = np.inf
    points, height = points[height < 0.03], height[height < 0.03]
    at = closest_alignment(people, points, Similarity(1.0, np.eye(3), np.zeros(3)))
    distance = 1e3 * people.nearest(at.inverse().apply(points)).distance
    return float(np.median(distance[height < 0])), float(np.median(distance[height > 0.01]))


def test_weights_are_of_symmetric_modes_and_small():
    names = build_default_model().identity_names
    assert set(NEUTRAL) <= set(names)
    assert not any("asymmetry" in name for name in NEUTRAL)
    assert max(abs(weight) for weight in NEUTRAL.values()) <= 2.5


def test_the_shift_is_the_sum_of_its_modes():
    model = build_default_model()
    one = next(iter(NEUTRAL))
    modes = np.zeros((len(model.identity_names), 2, 3))
    modes[model.identity_names.index(one), 1] = (1.0, 2.0, 3.0)
    shift = neutral_shift(model.identity_names, modes)
    np.testing.assert_allclose(shift, np.array([[0, 0, 0], [1, 2, 3]]) * NEUTRAL[one])


def test_the_neutral_face_is_nearer_to_the_mean_of_people(ict_facekit: FaceModel):
    """ICT-FaceKit's mean, as its scans have it: chin, lips and nose less far before the cheeks, and
    a forehead that is less steep.
    """
    skin = ict_facekit.triangles[ict_facekit.triangle_part == SKIN]
    people = Surface(ict_facekit.vertices.astype(np.float64), skin)
    neutral = without_form(build_default_model())
    before, after = (distances(model, people) for model in (modelled(), neutral))
    print("below the brows and above, mm: as modelled {:.2f} {:.2f}".format(*before))
    print("as it is {:.2f} {:.2f}".format(*after))
    assert after[0] < 0.6 * before[0]
    assert after[1] < 0.5 * before[1]

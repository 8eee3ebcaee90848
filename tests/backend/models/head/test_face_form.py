"""What people's faces have beyond the identity modes, on the built-in head."""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.spatial import cKDTree

from facestage.contract.face_model import SKIN, FaceModel
from facestage.models.head import eyes, mouth
from facestage.models.head.assemble import SIDES, HeadMesh, assemble
from facestage.models.head.default_head import build_default_model
from facestage.models.head.face_form import face_form, without_form
from facestage.models.mesh.closest_alignment import closest_alignment
from facestage.models.mesh.similarity import Similarity
from facestage.models.mesh.surface import Surface


@cache
def moves() -> np.ndarray:
    """(n, 3) mm."""
    return face_form(len(build_default_model().vertices))


@cache
def mesh() -> HeadMesh:
    return assemble()


def length(index: np.ndarray) -> np.ndarray:
    return np.linalg.norm(moves()[index], axis=-1)


def test_both_sides_move_alike():
    points = mesh().vertices
    _, opposite = cKDTree(points * [-1, 1, 1]).query(points)
    # Lips that meet lie in one place, where the nearest may be the other lip.
    meeting = mesh().loops["mouth"][mouth.LIP_LOOPS]
    moved = np.delete(moves() * [-1, 1, 1] - moves()[opposite], meeting, axis=0)
    assert np.abs(moved).max() < 0.01


def test_ears_neck_and_skull_stay():
    model = build_default_model()
    neck = np.flatnonzero(mesh().vertices[:, 1] < -129.0)
    assert len(neck) > 300
    assert length(np.concatenate([model.regions["ears"], neck])).max() < 0.01
    assert length(model.regions["scalp"]).max() < 0.5


def test_outlines_keep_their_published_breadths():
    model = build_default_model()
    face = model.regions["face"]
    outer = face[np.abs(mesh().vertices[face, 0]) > 62.0]
    assert len(outer) > 100
    assert length(outer).max() < 0.2


def test_eyes_and_the_margins_of_their_lids_move_as_one():
    for side in SIDES:
        eye = moves()[mesh().eyeballs[side]]
        assert np.ptp(eye, axis=0).max() < 0.01
        margin = mesh().loops[f"eye_{side}"][eyes.MARGIN :]
        np.testing.assert_allclose(
            moves()[margin], np.broadcast_to(eye[0], (*margin.shape, 3)), atol=0.01
        )


def test_lips_meet_and_teeth_and_tongue_keep_their_form():
    model = build_default_model()
    meeting = mesh().loops["mouth"][mouth.LIP_LOOPS]
    lips = model.vertices[meeting].astype(float)
    gap = np.linalg.norm(lips - np.roll(lips[::-1], 1, axis=0), axis=1)
    across = np.abs(lips[:, 0])
    # In the middle the upper lip's bow hides some of the lower one.
    assert gap.max() < 7e-4
    assert gap[across > 9e-3].max() < 3e-4 and gap[(across > 9e-3) & (across < 12e-3)].max() < 2e-5
    for part in (*mesh().teeth.values(), mesh().tongue):
        assert np.ptp(moves()[part], axis=0).max() < 0.01


def distance(model: FaceModel, people: Surface, where: np.ndarray) -> float:
    """Median in mm of the points of ``where`` from the surface, laid on it by the narrow face."""
    points = model.vertices[model.regions["narrow_face"]].astype(np.float64)
    at = closest_alignment(people, points, Similarity(1.0, np.eye(3), np.zeros(3)))
    there = people.nearest(at.inverse().apply(model.vertices[where].astype(np.float64)))
    return 1e3 * float(np.median(there.distance))


def test_the_nose_is_the_mean_of_people_s(ict_facekit: FaceModel):
    skin = ict_facekit.triangles[ict_facekit.triangle_part == SKIN]
    people = Surface(ict_facekit.vertices.astype(np.float64), skin)
    model = build_default_model()
    plain = without_form(model)
    narrow = model.regions["narrow_face"]
    x, y, _ = mesh().vertices[narrow].T
    nose = narrow[(np.abs(x) < 20) & (y < 0) & (y > -55)]
    assert len(nose) > 300
    before, after = (distance(each, people, nose) for each in (plain, model))
    print(f"{len(nose)} points of the nose: {before:.2f} mm without, {after:.2f} with")
    assert before > 0.6
    assert after < 0.25

"""What is worn lies on the skin and hides it from the camera."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from addon.synthetic.people import SIZE, landmarks_of, person_of, recipe
from facestage.contract.face_model import FaceModel
from facestage.contract.files.storage import read_arrays
from facestage.contract.landmarks import Landmarks

if TYPE_CHECKING:
    from mathutils.bvhtree import BVHTree

OCCLUDERS = ("cap", "fringe", "glasses", "strands")


def outside(skin: BVHTree, point: np.ndarray) -> float:
    """How far (m) a point is before a surface, less than 0: behind it. Normals of all that is as
    near within a millimetre decide: that of an edge's one side, or of a tiny fold, may face away.
    """
    nearest, _, _, distance = skin.find_nearest(point.tolist())
    touching = skin.find_nearest_range(point.tolist(), distance + 1e-3)
    normal = np.sum([np.array(each[1]) for each in touching], axis=0)
    return float(np.sign((point - np.array(nearest)) @ normal)) * distance


@pytest.mark.parametrize("kind", OCCLUDERS)
@pytest.mark.parametrize("seed", range(3))
def test_what_is_worn_lies_on_the_skin(model: FaceModel, kind: str, seed: int) -> None:
    from mathutils.bvhtree import BVHTree

    person = person_of(model, recipe(kind), seed)
    (item,) = person.worn
    vertices = model.shape(person.identity, person.expression)
    skin = BVHTree.FromPolygons(
        vertices.tolist(), model.triangles[model.triangle_part == 0].tolist()
    )
    brows = landmarks_of(model, vertices)[17:27]
    some = item.vertices[:: max(1, len(item.vertices) // 2000)]
    above = np.array([outside(skin, point) for point in some])
    assert np.isfinite(item.vertices).all()
    assert item.triangles.max() < len(item.vertices)
    if kind == "glasses":
        assert above.min() > 0.0
        assert np.abs(item.vertices[:, 0]).max() < 0.11
        assert item.vertices[:, 2].max() < landmarks_of(model, vertices)[30, 2] + 0.01
    else:
        # The brim starts inside the head.
        assert np.mean(above > 0) > (0.9 if kind == "cap" else 0.99)
        assert item.vertices[:, 1].max() > vertices[:, 1].max()
        assert item.vertices[:, 1].min() > brows[:, 1].min() - 0.04


@pytest.mark.parametrize("seed", range(2))
def test_a_hand_leans_on_a_cheek(model: FaceModel, seed: int) -> None:
    from mathutils.bvhtree import BVHTree

    person = person_of(model, recipe("hand"), seed)
    (hand,) = person.worn
    vertices = model.shape(person.identity, person.expression)
    marks, skin = landmarks_of(model, vertices), model.triangles[model.triangle_part == 0]
    # One closed surface, before the cheek of one side, of the face's own color.
    edges = np.sort(hand.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    side = np.sign(hand.vertices[:, 0].mean())
    cheek = marks[[3, 4, 48]] if side < 0 else marks[[13, 12, 54]]
    tree = BVHTree.FromPolygons(hand.vertices.tolist(), hand.triangles.tolist())
    middle = cheek.mean(axis=0)
    hits = [
        tree.ray_cast((middle[0] + dx, middle[1] + dy, 1.0), (0, 0, -1))[0]
        for dx in np.linspace(-0.03, 0.03, 7)
        for dy in np.linspace(-0.03, 0.03, 7)
    ]
    assert sum(hit is not None for hit in hits) > 15
    face = BVHTree.FromPolygons(vertices.tolist(), skin.tolist())
    behind = [
        (hit, face.ray_cast((hit.x, hit.y, 1.0), (0, 0, -1))[0]) for hit in hits if hit is not None
    ]
    assert np.mean([surface is None or hit.z > surface.z for hit, surface in behind]) > 0.9
    np.testing.assert_allclose(
        hand.color, np.median(person.albedo.reshape(-1, 3), axis=0), rtol=0.1
    )
    assert np.ptp(hand.vertices, axis=0).max() < 0.4


@pytest.mark.parametrize("kind", OCCLUDERS)
def test_what_is_worn_hides_the_face(scene, model: FaceModel, kind: str, tmp_path: Path) -> None:
    from facestage_blender.pictures.render import read_pixels
    from facestage_blender.synthetic.photograph import render_person
    from facestage_blender.synthetic.sightlines import WORN

    person = person_of(model, recipe(kind), 1)
    render_person(scene, model, person, tmp_path / "case", samples=4, seed=1, size=2 * SIZE)
    truth = read_arrays(tmp_path / "case" / "truth.npz", "truth")
    worn = truth["labels"] == WORN
    assert 0.005 < worn.mean() < 0.3
    assert not truth["mask"][worn].any()
    photo = read_pixels(tmp_path / "case" / "photo.exr")[..., :3]
    assert 0.7 < np.percentile(photo[truth["mask"]], 99) < 1.0
    # It is the render that shows it there: its color is not the skin's.
    share = photo / np.maximum(photo.sum(axis=2, keepdims=True), 1e-6)
    difference = np.abs(share[worn].mean(axis=0) - share[truth["mask"]].mean(axis=0)).max()
    assert difference > 0.02
    landmarks = Landmarks.read(tmp_path / "case" / "landmarks.json")
    if kind == "fringe":
        assert not landmarks.visible[17:27].all()
    assert landmarks.visible[28:36].all()

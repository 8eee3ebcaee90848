"""A user's own mesh as a face model: the default head in disguise, so that everything is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.face_model import SKIN, TEETH, FaceModel
from facestage.contract.rig_file import MARKS, UNKNOWN_PART, RigFile
from facestage.models.correspondence.coarse_alignment import axis_rotation
from facestage.models.registry import load_model
from reference.published.loaded import load_rig

TURN = 100.0 * axis_rotation(2, 4)  # model frame -> centimetres, Z up, looking along -Y
COUNT = 6  # expressions


@pytest.fixture(scope="module")
def default() -> FaceModel:
    return load_model("default")


@pytest.fixture(scope="module")
def rig(default: FaceModel) -> RigFile:
    """The default head with some of its expressions, no identity, no word about its parts."""
    return RigFile(
        name="Alice",
        license="yours",
        vertices=default.vertices @ TURN.T + [0.0, 2.0, 160.0],
        polygons=default.polygons,
        polygon_uvs=default.polygon_uvs,
        polygon_part=np.full(len(default.polygons), UNKNOWN_PART, np.uint8),
        uvs=default.uvs,
        expression_names=default.expression_names[20 : 20 + COUNT],
        expression_offsets=(default.expression_basis[20 : 20 + COUNT] @ TURN.T).astype(np.float32),
        identity_names=(),
        identity_offsets=np.zeros((0, len(default.vertices), 3), np.float32),
        marks={
            name: default.landmarks["ibug68"][index, :1].astype(np.int32)
            for name, (_, index) in MARKS.items()
        },
    )


@pytest.fixture(scope="module")
def model(rig: RigFile, tmp_path_factory: pytest.TempPathFactory) -> FaceModel:
    path = tmp_path_factory.mktemp("rig") / "alice.npz"
    rig.save(path)
    return load_model(f"rig:{path}")


def test_it_stands_upright_in_metres_in_the_same_order(model: FaceModel, default: FaceModel):
    offset = (model.vertices - default.vertices).astype(np.float64)
    assert np.ptp(offset, axis=0).max() < 1e-6
    assert np.abs(offset).max() < 0.01
    np.testing.assert_array_equal(model.polygons, default.polygons)
    np.testing.assert_allclose(
        model.expression_basis, default.expression_basis[20 : 20 + COUNT], atol=1e-7
    )


def test_parts_of_loose_pieces_are_recognized(model: FaceModel, default: FaceModel):
    """Eyes and teeth are loose pieces of the default head; what hangs on the skin is skin."""
    wrong = (model.polygon_part != default.polygon_part).mean()
    print(f"{wrong:.1%} of the polygons have another part")
    assert wrong < 0.05


def test_landmarks_and_regions_are_carried_over(model: FaceModel, default: FaceModel):
    def places(of: FaceModel) -> np.ndarray:
        corners, weights = of.landmark_vertices("ibug68")
        return np.einsum("mk,mkc->mc", weights, model.vertices[corners])

    error = np.linalg.norm(places(model) - places(default), axis=1)
    assert error[[index for _, index in MARKS.values()]].max() < 1e-6
    assert np.median(error) < 1e-3
    for name in ("face", "narrow_face"):
        ours, theirs = set(model.regions[name].tolist()), set(default.regions[name].tolist())
        assert len(ours & theirs) / len(ours | theirs) > 0.895


def test_borrowed_identity_moves_the_mesh_as_the_default_head(model: FaceModel, default: FaceModel):
    assert model.identity_names == default.identity_names
    face = default.regions["face"]
    ours, theirs = model.identity_basis[:, face], default.identity_basis[:, face]
    difference = np.sqrt(((ours - theirs) ** 2).sum() / (theirs**2).sum())
    print(f"borrowed modes differ by {difference:.0%}, at most 25 %")
    assert difference < 0.25


def test_teeth_stand_higher_behind_lips_that_stay(model: FaceModel, default: FaceModel):
    mode = model.identity_basis[model.identity_names.index("teeth_height")]
    teeth = np.unique(model.triangles[default.triangle_part == TEETH])
    skin = np.unique(model.triangles[default.triangle_part == SKIN])
    print(
        f"teeth {1e3 * np.median(mode[teeth, 1]):.2f} mm, skin {1e3 * np.abs(mode[skin]).max():.3f}"
    )
    assert np.median(mode[teeth, 1]) > 1e-3 and np.abs(mode[skin]).max() < 1e-6


def test_own_identity_is_kept(rig: RigFile, tmp_path: Path, default: FaceModel):
    own = replace(
        rig,
        identity_names=("identity/long",),
        identity_offsets=(default.identity_basis[:1] @ TURN.T),
        expression_names=(),
        expression_offsets=rig.expression_offsets[:0],
    )
    own.save(tmp_path / "own.npz")
    model = load_rig(tmp_path / "own.npz")
    assert (model.identity_names, model.expression_names) == (("identity/long",), ())
    np.testing.assert_allclose(model.identity_basis, default.identity_basis[:1], atol=1e-7)


def test_a_mesh_without_skin_is_refused(rig: RigFile, tmp_path: Path):
    eyes = replace(rig, polygon_part=np.ones(len(rig.polygons), np.uint8))
    eyes.save(tmp_path / "eyes.npz")
    with pytest.raises(InputError, match="'Alice' has 0 triangles of skin"):
        load_rig(tmp_path / "eyes.npz")

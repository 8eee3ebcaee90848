"""FLAME: a file of the published structure is read exactly; jaw and eyes turn as skinning says; the
rest is refused.
"""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from scipy import sparse
from scipy.spatial.transform import Rotation

from facestage.contract.errors import InputError
from facestage.contract.face_model import EYES, SKIN, FaceModel
from facestage.models.loaders.flame import LICENSE, OPEN_LICENSE
from facestage.models.mesh.unwrap import flipped
from reference.published.flame import (
    EYE,
    EYE_RADIUS,
    HEAD,
    embedding,
    flame_arrays,
    write_embedding,
    write_flame,
)
from reference.published.loaded import load_flame
from reference.published.scene import fewer_modes, fit_error, model_scene


@pytest.fixture(scope="module")
def arrays() -> dict:
    return flame_arrays()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, arrays: dict) -> Path:
    folder = tmp_path_factory.mktemp("flame")
    write_flame(folder / "generic_model.pkl", arrays)
    write_embedding(folder / "landmark_embedding.npy", embedding())
    return folder


@pytest.fixture(scope="module")
def model(folder: Path) -> FaceModel:
    return load_flame(folder)


def small(arrays: dict, **change) -> dict:
    """Entries that are quick to write: shapedirs as single precision zeros."""
    return arrays | {"shapedirs": np.zeros((5023, 3, 400), np.float32)} | change


def test_everything_published_is_there(model: FaceModel, arrays: dict):
    shift = model.vertices[0] - arrays["v_template"][0]
    np.testing.assert_allclose(model.vertices, arrays["v_template"] + shift, atol=1e-6)
    np.testing.assert_allclose(model.vertices[model.regions["narrow_face"]].mean(0), 0, atol=1e-6)
    np.testing.assert_array_equal(model.triangles, arrays["f"])
    modes = np.moveaxis(arrays["shapedirs"], -1, 0)
    np.testing.assert_allclose(model.identity_basis, modes[:300], atol=1e-8)
    np.testing.assert_allclose(model.expression_basis[:100], modes[300:], atol=1e-8)
    assert not model.expression_box[:100].any() and model.expression_box[100:].all()
    assert model.license == LICENSE and model.name == "FLAME"


def skinned(arrays: dict, joint: int, rotation: tuple[float, float, float]) -> np.ndarray:
    """SMPL's equations vertex by vertex: slow, with 4 x 4 transforms."""
    vertices = arrays["v_template"]
    joints = arrays["J_regressor"].toarray() @ vertices
    turns = [np.eye(3)] * 5
    turns[joint] = Rotation.from_rotvec(rotation).as_matrix()
    feature = np.concatenate([(turn - np.eye(3)).ravel() for turn in turns[1:]])
    posed = vertices + arrays["posedirs"] @ feature
    world: list[np.ndarray] = []
    for k, parent in enumerate((None, 0, 1, 1, 1)):
        local = np.eye(4)
        local[:3, :3] = turns[k]
        local[:3, 3] = joints[k] - (joints[parent] if parent is not None else 0)
        world.append(local if parent is None else world[parent] @ local)
    rest = []
    for k, transform in enumerate(world):
        back = np.eye(4)
        back[:3, 3] = -joints[k]
        rest.append(transform @ back)
    blended = np.einsum("nj,jab->nab", arrays["weights"], np.array(rest))
    return (
        np.einsum("nab,nb->na", blended, np.append(posed, np.ones((len(posed), 1)), axis=1))[:, :3]
        - vertices
    )


@pytest.mark.parametrize(
    ("name", "joint", "rotation"),
    [
        ("jawOpen", 2, (np.pi / 8, 0, 0)),
        ("jawLeft", 2, (0, 0.1, 0)),
        ("eyeLookDown_L", 3, (np.radians(25), 0, 0)),
        ("eyeLookIn_R", 4, (0, np.pi / 6, 0)),
    ],
)
def test_turned_joints_are_exact_shapes(
    model: FaceModel, arrays: dict, name: str, joint: int, rotation
):
    shape = model.expression_basis[model.expression_names.index(name)]
    np.testing.assert_allclose(shape, skinned(arrays, joint, rotation), atol=1e-7)


def test_jaw_and_eyes_go_where_their_names_say(model: FaceModel):
    tables, weights = model.landmark_vertices("ibug68")

    def moved(name: str) -> np.ndarray:
        shape = model.expression_basis[model.expression_names.index(name)]
        return np.einsum("mk,mkc->mc", weights, shape[tables])

    assert moved("jawOpen")[8, 1] < -0.02 and abs(moved("jawOpen")[30]).max() < 3e-3
    assert moved("jawLeft")[8, 0] > 0.005 and moved("jawRight")[8, 0] < -0.005
    for side, start in (("L", HEAD), ("R", HEAD + EYE)):
        ball = model.vertices[start : start + EYE]
        front = start + int(ball[:, 2].argmax())
        for word, axis, sign in (("Up", 1, 1), ("Down", 1, -1)):
            offset = model.expression_basis[model.expression_names.index(f"eyeLook{word}_{side}")][
                front
            ]
            assert sign * offset[axis] == pytest.approx(EYE_RADIUS * 0.42, rel=0.15)
        inward = -1 if side == "L" else 1
        assert (
            inward
            * model.expression_basis[model.expression_names.index(f"eyeLookIn_{side}")][front, 0]
            > 0.004
        )


def test_parts_regions_and_colors(model: FaceModel):
    part = model.triangle_part
    assert (part[(model.triangles >= HEAD).all(1)] == EYES).all() and (
        part[(model.triangles < HEAD).all(1)] == SKIN
    ).all()
    assert set(model.regions) == {"narrow_face", "face", "skin", "eye_left", "eye_right"}
    assert (
        model.vertices[model.regions["eye_left"], 0].mean()
        > 0
        > model.vertices[model.regions["eye_right"], 0].mean()
    )
    narrow = model.vertices[model.regions["narrow_face"]]
    assert (
        0.08 < np.ptp(narrow[:, 0]) < 0.14
        and 0.10 < np.ptp(narrow[:, 1]) < 0.18
        and narrow[:, 2].min() > -0.06
    )
    assert set(model.regions["narrow_face"]) <= set(model.regions["face"])
    eye = model.albedo_mean[model.regions["eye_left"]]
    assert eye.min() < 0.02 and eye.max() > 0.5
    assert len(model.albedo_basis) == 80 and not model.albedo_basis[:, HEAD:].any()


def test_the_chart_made_here_does_not_overlap(model: FaceModel):
    skin = model.triangle_part == SKIN
    assert not flipped(model.uvs.astype(float), model.triangle_uvs[skin]).any()
    assert model.uvs.min() >= 0 and model.uvs.max() <= 1
    # Triangles that all face up cover no more than the disc's area unless they overlap.
    corners = model.uvs[model.triangle_uvs[skin]].astype(float)
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    assert (
        0.5 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]).sum() <= np.pi / 4 * model.face_tile[2] ** 2
    )


def test_the_npz_and_the_2023_files(tmp_path: Path, arrays: dict):
    entries = small(arrays)
    plain = {name: value for name, value in entries.items() if isinstance(value, np.ndarray)}
    np.savez(tmp_path / "flame2023.npz", **plain, J_regressor=entries["J_regressor"].toarray())
    write_embedding(tmp_path / "landmark_embedding.npy", embedding())
    first = load_flame(tmp_path / "flame2023.npz")
    (tmp_path / "flame2023_Open.pkl").write_bytes(
        pickle.dumps(entries | {"J_regressor": sparse.csc_matrix(entries["J_regressor"])})
    )
    second = load_flame(tmp_path)
    np.testing.assert_allclose(first.vertices, second.vertices, atol=1e-7)
    np.testing.assert_allclose(first.expression_basis, second.expression_basis, atol=1e-7)
    assert first.license == LICENSE and second.license == OPEN_LICENSE


def test_the_authors_uvs_are_taken_from_beside(tmp_path: Path, arrays: dict):
    write_flame(tmp_path / "generic_model.pkl", small(arrays))
    write_embedding(tmp_path / "landmark_embedding.npy", embedding())
    points = np.random.default_rng(0).random((5118, 2))
    faces = np.random.default_rng(0).integers(0, 5118, (9976, 3)).astype(np.uint32)
    np.savez(tmp_path / "FLAME_texture.npz", vt=points, ft=faces, mean=np.zeros((2, 2, 3)))
    model = load_flame(tmp_path)
    np.testing.assert_allclose(model.uvs, points, atol=1e-7)
    np.testing.assert_array_equal(model.triangle_uvs, faces)
    np.savez(tmp_path / "FLAME_texture.npz", vt=points, ft=faces[:50])
    with pytest.raises(InputError, match=r"FLAME_texture\.npz' has no UV layout of 9976 triangles"):
        load_flame(tmp_path)


def test_the_51_landmarks_keep_their_places_and_the_jaw_is_carried_over(
    tmp_path: Path, arrays: dict
):
    (tmp_path / "generic_model.pkl").write_bytes(pickle.dumps(small(arrays)))
    full = embedding()
    rows, weights = full["static_lmk_faces_idx"], full["static_lmk_bary_coords"]
    static = {"lmk_face_idx": rows.astype(np.uint32), "lmk_b_coords": weights}
    (tmp_path / "flame_static_embedding.pkl").write_bytes(pickle.dumps(static, 2))
    table = load_flame(tmp_path).landmarks["ibug68"]
    np.testing.assert_array_equal(table[17:, :3], arrays["f"][rows])
    found = np.einsum(
        "mk,mkc->mc", table[:17, 3:], arrays["v_template"][table[:17, :3].astype(int)]
    )
    truth = np.einsum(
        "mk,mkc->mc",
        full["full_lmk_bary_coords"][0, :17],
        arrays["v_template"][arrays["f"][full["full_lmk_faces_idx"][0, :17]]],
    )
    assert np.linalg.norm(found - truth, axis=1).mean() < 0.006


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            {"v_template": np.zeros((6890, 3))},
            r"v_template is float64 \(6890, 3\), not \(5023, 3\)",
        ),
        ({"f": np.full((9976, 3), 5023, np.uint32)}, r"f refers to vertices outside 0\.\.5022"),
        ({"weights": np.full((5023, 5), np.nan)}, "weights holds NaN"),
        (
            {"kintree_table": np.array([[0, 4, 1, 1, 1], [0, 1, 2, 3, 4]])},
            "kintree_table orders its joints wrongly",
        ),
        ({"posedirs": np.zeros((5023, 3, 36)).astype(str)}, "array of type"),
    ],
)
def test_wrong_arrays_are_named(tmp_path: Path, arrays: dict, change: dict, words: str):
    (tmp_path / "generic_model.pkl").write_bytes(pickle.dumps(small(arrays, **change)))
    with pytest.raises(InputError, match=words) as caught:
        load_flame(tmp_path)
    assert "\n" not in str(caught.value)


def test_other_files_are_refused_in_a_sentence(tmp_path: Path):
    with pytest.raises(
        InputError, match=r"holds no FLAME model; expected .* from https://flame\.is\.tue\.mpg\.de"
    ):
        load_flame(tmp_path)
    with pytest.raises(InputError, match=r"none\.pkl' does not exist; expected FLAME's"):
        load_flame(tmp_path / "none.pkl")
    (tmp_path / "generic_model.pkl").write_bytes(pickle.dumps({"v_template": np.zeros((6890, 3))}))
    with pytest.raises(InputError, match="is no FLAME model, it lacks f, shapedirs, posedirs"):
        load_flame(tmp_path)
    (tmp_path / "generic_model.pkl").write_text("<html>log in</html>")
    with pytest.raises(InputError, match="is a web page"):
        load_flame(tmp_path)
    np.savez(tmp_path / "x.npz", a=np.zeros(3))
    with pytest.raises(InputError, match="is no FLAME model, it lacks v_template"):
        load_flame(tmp_path / "x.npz")


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        ({"lmk": np.zeros(3)}, "lacks full_lmk_faces_idx"),
        ({"full_lmk_faces_idx": np.full((1, 68), 9976)}, "of another mesh"),
        (
            {
                "full_lmk_faces_idx": np.zeros((1, 30), int),
                "full_lmk_bary_coords": np.ones((1, 30, 3)) / 3,
            },
            "30 landmarks",
        ),
        ({"full_lmk_bary_coords": np.ones((1, 68, 3))}, "do not add up to 1"),
    ],
)
def test_wrong_landmark_files_are_named(tmp_path: Path, arrays: dict, entries: dict, words: str):
    (tmp_path / "generic_model.pkl").write_bytes(pickle.dumps(small(arrays)))
    write_embedding(
        tmp_path / "landmark_embedding.npy", (embedding() if "lmk" not in entries else {}) | entries
    )
    with pytest.raises(InputError, match=words):
        load_flame(tmp_path)


def test_a_small_fit_goes_all_the_way(tmp_path: Path, model: FaceModel):
    quick = fewer_modes(model, 8, ("expression000", "expression001", "jawOpen", "eyeLookUp_L"))
    error, result = fit_error(
        tmp_path, model_scene(quick, yaw=0.3, expression={"jawOpen": 0.6, "expression000": -0.8})
    )
    assert error < 0.002
    jaw, first = result.expression[2], result.expression[0]
    assert 0.3 < jaw <= 1 and first < 0

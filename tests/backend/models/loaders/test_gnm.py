"""GNM Head: a file of the published structure is read exactly; eyes turn as skinning says; the rest
is refused.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from facestage.contract.errors import InputError
from facestage.contract.face_model import EYES, MOUTH, OTHER, SKIN, TEETH, FaceModel
from facestage.models.anatomy.regions import IRIS, PART_ALBEDO, PUPIL, TONGUE
from reference.published.gnm import gnm_arrays, write_landmarks
from reference.published.loaded import load_gnm
from reference.published.scene import fewer_modes, fit_error, model_scene


@pytest.fixture(scope="module")
def arrays() -> dict[str, np.ndarray]:
    return gnm_arrays()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, arrays: dict[str, np.ndarray]) -> Path:
    """As in the repository: data/versions/v3_0/gnm_head.npz and
    data/landmarks/head_sparse_68.txt.
    """
    data = tmp_path_factory.mktemp("gnm") / "data"
    folder = data / "versions" / "v3_0"
    folder.mkdir(parents=True)
    (data / "landmarks").mkdir()
    np.savez(folder / "gnm_head.npz", **arrays)
    write_landmarks(data / "landmarks" / "head_sparse_68.txt", shuffled_jaw=True)
    return folder


@pytest.fixture(scope="module")
def model(folder: Path) -> FaceModel:
    return load_gnm(folder)


def test_everything_published_is_there(model: FaceModel, arrays: dict[str, np.ndarray]):
    shift = model.vertices[0] - arrays["template_vertex_positions"][0]
    np.testing.assert_allclose(
        model.vertices, arrays["template_vertex_positions"] + shift, atol=1e-6
    )
    np.testing.assert_array_equal(model.polygons, arrays["quads"])
    np.testing.assert_allclose(model.identity_basis, arrays["vertex_identity_basis"], atol=1e-8)
    np.testing.assert_allclose(model.expression_basis[:7], arrays["expression_basis"], atol=1e-8)
    assert model.identity_names == tuple(arrays["identity_names"])
    assert model.expression_names[:7] == tuple(arrays["expression_names"])
    assert model.expression_box.tolist() == [False] * 7 + [True] * 8
    assert model.license == "Apache-2.0 (Google LLC)"


def test_the_jaw_is_put_in_the_ibug_order(tmp_path: Path, model: FaceModel):
    wanted = write_landmarks(tmp_path / "head_sparse_68.txt")
    vertices, weights = model.landmark_vertices("ibug68")
    found = np.einsum("mk,mkc->mc", weights, model.vertices[vertices])
    np.testing.assert_allclose(found - found[30], wanted - wanted[30], atol=1e-5)


def test_gaze_is_exact_with_correctives(model: FaceModel, arrays: dict[str, np.ndarray]):
    turn = Rotation.from_rotvec([0, -np.pi / 6, 0]).as_matrix()
    features = np.zeros((4, 3, 3))
    features[2] = turn - np.eye(3)
    place = arrays["template_vertex_positions"].astype(float)
    posed = place + (features.ravel() @ arrays["pose_correctives_regressor"].astype(float)).reshape(
        -1, 3
    )
    joint = arrays["template_joint_positions"][2].astype(float)
    weight = arrays["skinning_weights"].T.astype(float)
    rest = (weight[:, [0]] + weight[:, [1]] + weight[:, [3]]) * posed
    exact = rest + weight[:, [2]] * ((posed - joint) @ turn.T + joint) - place
    shape = model.expression_basis[model.expression_names.index("eyeLookIn_L")]
    np.testing.assert_allclose(shape, exact, atol=1e-7)


def test_parts_colors_and_atlas(model: FaceModel, arrays: dict[str, np.ndarray]):
    names = list(arrays["vertex_group_names"])
    group = {name: arrays["vertex_groups"][names.index(name)] > 0.5 for name in names}

    def parts(name: str) -> set[int]:
        return set(model.polygon_part[group[name][model.polygons].all(axis=1)].tolist())

    assert parts("skin") == {SKIN} and parts("teeth") == {TEETH} and parts("tongue") == {MOUTH}
    assert parts("eye_interiors") == {EYES} and parts("eye_exteriors") == {OTHER}
    np.testing.assert_allclose(
        model.albedo_mean[group["pupils"]], [PUPIL] * int(group["pupils"].sum()), atol=1e-6
    )
    for name, value in (("tongue", TONGUE), ("teeth", PART_ALBEDO[TEETH])):
        rows = model.albedo_mean[group[name] & ~group["skin"]]
        np.testing.assert_allclose(rows, [value] * len(rows), atol=1e-6)
    np.testing.assert_allclose(
        model.albedo_mean[group["irises"] & ~group["pupils"]][0], IRIS, atol=1e-6
    )
    assert (
        model.vertices[model.regions["eye_left"], 0].mean()
        > 0
        > model.vertices[model.regions["eye_right"], 0].mean()
    )
    # Each region has a square of its own, in which it lies as published.
    u, v, side = model.face_tile
    skin = model.polygon_uvs[model.polygon_part == SKIN]
    published = arrays["quad_uvs"][model.polygon_part == SKIN]
    np.testing.assert_allclose(model.uvs[skin], np.array([u, v]) + side * published, atol=1e-6)
    cells = [
        {
            tuple(cell)
            for cell in np.floor(
                model.uvs[model.polygon_uvs[model.polygon_part == label]] * 19.9
            ).reshape(-1, 2)
        }
        for label in (SKIN, EYES, TEETH)
    ]
    assert not cells[0] & cells[1] and not cells[0] & cells[2] and not cells[1] & cells[2]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"quads": None}, "is no GNM head, it lacks quads"),
        ({"variant": np.array("hand")}, "is the GNM variant 'hand' of version 3.0"),
        ({"version": np.array("2.1")}, "is the GNM variant 'head' of version 2.1"),
        (
            {"expression_basis": np.zeros((7, 5, 3))},
            r"expression_basis is float64 \(7, 5, 3\), not \(7, \d+, 3\)",
        ),
        ({"vertex_groups": np.full((15, 3), np.nan)}, "vertex_groups is float64"),
        ({"joint_names": np.array(["a", "b", "c", "d"])}, "its joints are a, b, c, d"),
        (
            {"vertex_group_names": np.array([f"g{k}" for k in range(15)])},
            "has no vertex group skin, left_eye, right_eye",
        ),
    ],
)
def test_wrong_arrays_are_named(
    tmp_path: Path, arrays: dict[str, np.ndarray], change: dict, words: str
):
    entries = {name: array for name, array in (arrays | change).items() if array is not None}
    np.savez(tmp_path / "gnm_head.npz", **entries)
    write_landmarks(tmp_path / "head_sparse_68.txt")
    with pytest.raises(InputError, match=words) as caught:
        load_gnm(tmp_path)
    assert "\n" not in str(caught.value)


def test_other_files_are_refused_in_a_sentence(tmp_path: Path, arrays: dict[str, np.ndarray]):
    with pytest.raises(
        InputError,
        match=r"holds no GNM head; expected gnm_head\.npz \(v3\) from https://github\.com",
    ):
        load_gnm(tmp_path)
    with pytest.raises(InputError, match="does not exist; expected"):
        load_gnm(tmp_path / "gnm_head.npz")
    path = tmp_path / "gnm_head.npz"
    for content in (
        b"<html>sign in</html>",
        b"version https://git-lfs.github.com/spec/v1\noid sha256:61d7\nsize 53\n",
    ):
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"is a web page|is a Git LFS pointer"):
            load_gnm(path)
    np.savez(path, **arrays)
    path.write_bytes(path.read_bytes()[:50000])
    with pytest.raises(InputError, match=r"is not a readable \.npz"):
        load_gnm(path)


@pytest.mark.parametrize(
    "text", ["a b c\n", "1 2 3\n", "0 0.5 1 0.5 2 0.5\n" * 68, "999999 1 0 0 0 0\n" * 68]
)
def test_wrong_landmark_files_are_named(tmp_path: Path, arrays: dict[str, np.ndarray], text: str):
    np.savez(tmp_path / "gnm_head.npz", **arrays)
    (tmp_path / "head_sparse_68.txt").write_text(text)
    with pytest.raises(InputError, match=r"head_sparse_68\.txt'"):
        load_gnm(tmp_path)


def test_a_small_fit_goes_all_the_way(tmp_path: Path, model: FaceModel):
    quick = fewer_modes(model, 4, (*model.expression_names[:2], "eyeLookUp_L"))
    error, _ = fit_error(
        tmp_path, model_scene(quick, yaw=0.25, expression={model.expression_names[0]: 1.0})
    )
    assert error < 0.002

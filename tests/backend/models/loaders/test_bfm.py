"""The Basel Face Model: files of the published structures are read exactly, in metres and linear
light.
"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

from facestage.contract.errors import InputError
from facestage.contract.face_model import FaceModel
from facestage.contract.files.color import srgb_to_linear
from facestage.models.loaders.bfm import LICENSE, log_albedo
from facestage.models.mesh.unwrap import flipped
from reference.published.bfm import color_modes, head_2009, skin_srgb, write_2009, write_statismo
from reference.published.heads import Head, head
from reference.published.loaded import load_bfm
from reference.published.scene import fewer_modes, fit_error, model_scene


@pytest.fixture(scope="module")
def face() -> Head:
    return head(4000, ring=70)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("bfm")


@pytest.fixture(scope="module")
def held(folder: Path, face: Head) -> dict[str, np.ndarray]:
    return write_statismo(folder / "model2019_fullHead.h5", face)


@pytest.fixture(scope="module")
def model(folder: Path, held: dict[str, np.ndarray]) -> FaceModel:
    return load_bfm(folder)


def test_statismo_files_are_read_exactly(model: FaceModel, held: dict[str, np.ndarray], face: Head):
    shift = model.vertices[0] - face.vertices[0]
    np.testing.assert_allclose(model.vertices, face.vertices + shift, atol=2e-7)
    np.testing.assert_array_equal(model.triangles, face.triangles)
    np.testing.assert_allclose(model.identity_basis, held["shape"], atol=1e-8)
    np.testing.assert_allclose(model.expression_basis[0], held["expression_mean"], atol=1e-8)
    np.testing.assert_allclose(model.expression_basis[1:], held["expression"], atol=1e-8)
    assert model.expression_names == (
        "expressionMean",
        "expression000",
        "expression001",
        "expression002",
    )
    assert model.expression_box.tolist() == [True, False, False, False]
    assert (model.name, model.license) == ("Basel Face Model 2019", LICENSE)


def test_landmarks_come_from_the_named_points_and_the_default_head(model: FaceModel, face: Head):
    vertices, weights = model.landmark_vertices("ibug68")
    shift = model.vertices[0] - face.vertices[0]
    found = np.einsum("mk,mkc->mc", weights, model.vertices[vertices]) - shift
    error = np.linalg.norm(found - face.landmarks, axis=1)
    print(f"landmarks: {error.mean() * 1e3:.2f} mm on average, {error.max() * 1e3:.2f} at most")
    named = [8, 30, 36, 39, 42, 45, 48, 51, 54, 57, 62, 66]
    assert error[named].max() < 1e-3 and error[17:].mean() < 0.003 and error.mean() < 0.004


def test_the_mean_color_is_linear_and_modes_are_log_albedo():
    vertices = head(2000).vertices
    color, modes = skin_srgb(vertices), color_modes(vertices, 6)
    mean, basis = log_albedo(color, modes)
    np.testing.assert_allclose(mean, srgb_to_linear(color), rtol=1e-5)
    worst: dict[float, float] = {}
    for sigma in (1.0, 2.0):
        for sign in (-1, 1):
            for k in range(6):
                exact = srgb_to_linear(np.clip(color + sign * sigma * modes[k], 1 / 255, 0.99))
                ratio = np.exp(np.log(mean) + sign * sigma * basis[k]) / exact
                worst[sigma] = max(worst.get(sigma, 0), float(np.abs(np.log(ratio)).max()))
    print(
        f"log albedo is off by at most {worst[1.0]:.3f} at one standard deviation, "
        f"{worst[2.0]:.3f} at two"
    )
    assert worst[1.0] < 0.1 and worst[2.0] < 0.5


def test_the_chart_does_not_overlap(model: FaceModel):
    assert not flipped(model.uvs.astype(float), model.triangle_uvs).any()
    assert model.uvs.min() >= 0 and model.uvs.max() <= 1


def test_the_2009_file_of_true_size(tmp_path: Path):
    face, wanted = head_2009()
    assert (len(face.vertices), len(face.triangles)) == (53490, 106466)
    arrays = write_2009(tmp_path / "01_MorphableModel.mat", face)
    model = load_bfm(tmp_path)
    shift = model.vertices[0] - face.vertices[0]
    np.testing.assert_allclose(model.vertices, face.vertices + shift, atol=1e-6)
    # The published list of triangles faces inwards.
    np.testing.assert_array_equal(model.triangles, face.triangles)
    basis = (arrays["shapePC"] * arrays["shapeEV"].T).T.reshape(3, -1, 3) * 1e-6
    np.testing.assert_allclose(model.identity_basis, basis, atol=1e-8)
    np.testing.assert_allclose(
        model.albedo_mean, srgb_to_linear(skin_srgb(face.vertices)), rtol=1e-4
    )
    np.testing.assert_array_equal(model.landmarks["ibug68"][:, 0], wanted)
    assert model.expression_names == () and model.name == "Basel Face Model 2009"
    assert not flipped(model.uvs.astype(float), model.triangle_uvs).any()
    vertices, _ = model.landmark_vertices("ibug68")
    points = model.vertices[vertices[:, 0]]
    # The first eye of the ibug scheme is the subject's right one, on -X.
    assert points[36, 0] < 0 < points[45, 0] and points[8, 1] < points[30, 1] < points[27, 1]


def test_files_without_expressions_or_landmarks(tmp_path: Path, face: Head):
    path = tmp_path / "model2009-publicmm1-bfm.h5"
    write_statismo(path, face)
    with h5py.File(path, "a") as file:
        del file["expression"], file["metadata"]
        file.move("shape/representer", "representer")
    model = load_bfm(path)
    assert (
        model.expression_names == ()
        and model.name == "Basel Face Model 2009"
        and "ibug68" in model.landmarks
    )


def damage(path: Path, name: str, value) -> None:
    with h5py.File(path, "a") as file:
        del file[name]
        if value is not None:
            file[name] = value


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("shape/model/pcaBasis", None, "lacks shape/model/pcaBasis"),
        (
            "shape/model/pcaBasis",
            np.zeros((5, 4)),
            r"pcaBasis has shape \(5, 4\), not \(12000, 4\)",
        ),
        ("shape/model/mean", np.zeros(12000), "its face is 0 mm high"),
        ("shape/model/mean", np.full(12000, np.nan), "mean holds NaN"),
        ("color/model/mean", np.zeros(30), "color/model/mean has 30 entries"),
        ("shape/model/pcaVariance", np.array(["a"] * 4, dtype="S1"), "pcaVariance"),
        ("shape/representer/cells", np.full((3, 10), 4000), r"vertices outside 0\.\.3999"),
        ("shape/representer/cells", np.zeros(5), "lacks shape/representer/cells"),
        ("metadata/landmarks/json", "not json", "damaged landmarks"),
    ],
)
def test_wrong_arrays_are_named(tmp_path: Path, face: Head, name: str, value, words: str):
    path = tmp_path / "model2017-1_bfm_nomouth.h5"
    write_statismo(path, face)
    damage(path, name, value)
    with pytest.raises(InputError, match=words) as caught:
        load_bfm(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["01_MorphableModel.mat", "model2019_bfm.h5"])
@pytest.mark.parametrize(
    "content", [b"", b"text", b"\x89HDF\r\n\x1a\n broken", b"MATLAB 5.0 MAT-file" + bytes(300)]
)
def test_what_is_no_model_is_named(tmp_path: Path, name: str, content: bytes):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(
        InputError, match=rf"{name}' .*expected 01_MorphableModel\.mat, model2017"
    ) as caught:
        load_bfm(tmp_path)
    assert "\n" not in str(caught.value)


def test_other_files_are_refused_in_a_sentence(tmp_path: Path):
    with pytest.raises(InputError, match="holds no Basel Face Model; expected"):
        load_bfm(tmp_path)
    with pytest.raises(InputError, match="does not exist; expected"):
        load_bfm(tmp_path / "model.h5")
    (tmp_path / "model2019_bfm.h5").write_text("<!DOCTYPE html><html>request access</html>")
    with pytest.raises(InputError, match="is a web page, not the Basel Face Model"):
        load_bfm(tmp_path)
    scipy.io.savemat(tmp_path / "01_MorphableModel.mat", {"shapeMU": np.zeros((30, 1))})
    with pytest.raises(InputError, match=r"shapeMU is float64 \(30, 1\), not \(160470, 1\)"):
        load_bfm(tmp_path / "01_MorphableModel.mat")


def test_a_small_fit_goes_all_the_way(tmp_path: Path, model: FaceModel):
    quick = fewer_modes(model, 4, ("expressionMean", "expression000"))
    identity = np.array([1.0, -0.7, 0.5, 0.0])
    error, result = fit_error(tmp_path, model_scene(quick, yaw=0.25, identity=identity))
    assert error < 0.002
    assert np.sign(result.identity[:2]).tolist() == [1, -1]

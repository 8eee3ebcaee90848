"""ICT-FaceKit: what is not the published model is refused; the published one is read completely."""

from __future__ import annotations

import io
import tarfile
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from facestage.contract.errors import InputError
from facestage.contract.face_model import EYES, MOUTH, OTHER, SKIN, TEETH, FaceModel
from facestage.models.anatomy.regions import GUM, PALATE, PART_ALBEDO, TONGUE
from facestage.models.loaders.ict import NARROW_FACE, VERTEX_COUNT, load_ict


def write_folder(root: Path, files: dict[str, str]) -> Path:
    folder = root / "FaceXModel"
    folder.mkdir(parents=True)
    for name, text in files.items():
        (folder / name).write_text(text)
    return root


TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n"


def test_a_missing_path_is_named(tmp_path: Path):
    with pytest.raises(
        InputError, match="ICT-FaceKit path '.*none' does not exist".replace(".*", "[^']*")
    ):
        load_ict(tmp_path / "none")


def test_another_folder_is_named(tmp_path: Path):
    with pytest.raises(
        InputError, match=r"has no FaceXModel/generic_neutral_mesh\.obj; expected ICT-FaceKit"
    ):
        load_ict(tmp_path)
    write_folder(tmp_path / "half", {"generic_neutral_mesh.obj": TRIANGLE})
    with pytest.raises(InputError, match=r"has no FaceXModel/vertex_indices\.json"):
        load_ict(tmp_path / "half")


@pytest.mark.parametrize("text", [TRIANGLE, "", "v 0 0\n", "v a b c\n"])
def test_a_truncated_or_garbled_mesh_is_named(tmp_path: Path, text: str):
    root = write_folder(
        tmp_path / "cut", {"generic_neutral_mesh.obj": text, "vertex_indices.json": "{}"}
    )
    with pytest.raises(InputError, match=r"generic_neutral_mesh\.obj"):
        load_ict(root)


@pytest.mark.parametrize(
    "lines",
    [
        ["v 0 0 0"] * VERTEX_COUNT,
        ["v 0 0 x"] * VERTEX_COUNT,
        ["v 0 0 0"] * VERTEX_COUNT + ["f a b c"],
    ],
)
def test_a_mesh_of_the_right_size_but_wrong_content_is_named(tmp_path: Path, lines: list[str]):
    files = {"generic_neutral_mesh.obj": "\n".join(lines), "vertex_indices.json": "{}"}
    with pytest.raises(InputError, match=r"cut"):
        load_ict(write_folder(tmp_path / "cut", files))


def archive(path: Path, files: dict[str, bytes]) -> Path:
    if path.suffix == ".zip":
        with zipfile.ZipFile(path, "w") as file:
            for name, data in files.items():
                file.writestr(name, data)
    else:
        mode: Any = f"w:{path.suffix[1:]}"
        with tarfile.open(path, mode) as tar:
            for name, data in files.items():
                info = tarfile.TarInfo(name)
                info.size = len(data)
                tar.addfile(info, io.BytesIO(data))
    return path


@pytest.mark.parametrize("suffix", [".zip", ".gz", ".xz"])
def test_archives_are_opened(tmp_path: Path, suffix: str):
    files = {
        "ICT/FaceXModel/generic_neutral_mesh.obj": TRIANGLE.encode(),
        "ICT/FaceXModel/vertex_indices.json": b"{}",
    }
    with pytest.raises(InputError, match=r"generic_neutral_mesh\.obj has 3 vertices"):
        load_ict(archive(tmp_path / f"a{suffix}", files))
    with pytest.raises(InputError, match=r"has no FaceXModel/generic_neutral_mesh\.obj"):
        load_ict(archive(tmp_path / f"b{suffix}", {"README": b"text"}))


@pytest.mark.parametrize("suffix", [".zip", ".xz"])
def test_a_cut_archive_is_named(tmp_path: Path, suffix: str):
    random = np.random.default_rng(0).bytes(20000)
    whole = archive(tmp_path / f"a{suffix}", {"ICT/FaceXModel/generic_neutral_mesh.obj": random})
    whole.write_bytes(whole.read_bytes()[:9000])
    with pytest.raises(InputError, match=rf"a{suffix}"):
        load_ict(whole)


@pytest.mark.parametrize("content", [b"", b"text", b"\xfd7zXZ\x00 broken"])
def test_what_is_no_archive_is_named(tmp_path: Path, content: bytes):
    (tmp_path / "ict.tar.xz").write_bytes(content)
    with pytest.raises(InputError, match=r"ict\.tar\.xz"):
        load_ict(tmp_path / "ict.tar.xz")


@pytest.fixture(scope="module")
def published(ict_facekit: FaceModel) -> FaceModel:
    return ict_facekit


def test_sizes_and_names(published: FaceModel):
    assert published.vertices.shape == (VERTEX_COUNT, 3)
    assert len(published.identity_names) == 100 and published.identity_names[0] == "identity000"
    assert len(published.expression_names) >= 53 and "jawOpen" in published.expression_names
    assert list(published.expression_names) == sorted(published.expression_names)
    assert len(published.albedo_basis) == 80 and published.expression_prior == "box"


def test_it_is_a_head_in_metres_that_looks_along_z(published: FaceModel):
    face = published.vertices[:NARROW_FACE]
    np.testing.assert_allclose(face.mean(0), 0, atol=1e-4)
    assert 0.13 < np.ptp(face[:, 1]) < 0.3 and 0.1 < np.ptp(face[:, 0]) < 0.25
    vertices, _ = published.landmark_vertices("ibug68")
    nose_tip, chin, brow = (published.vertices[vertices[index, 0]] for index in (30, 8, 27))
    assert nose_tip[2] > 0.03 and chin[1] < nose_tip[1] < brow[1]
    # The first eye in ibug's order is the subject's right one, on -X.
    assert published.vertices[vertices[36, 0], 0] < published.vertices[vertices[45, 0], 0]


def test_modes_are_of_a_face_s_size(published: FaceModel):
    for basis in (published.identity_basis, published.expression_basis):
        largest = np.linalg.norm(basis, axis=2).max(axis=1)
        assert (largest < 0.06).all() and largest[0] > 1e-3 and (largest > 1e-5).all()
    jaw = published.expression_basis[published.expression_names.index("jawOpen")]
    assert jaw[:, 1].min() < -0.01


def test_eyes_teeth_and_mouth_move_with_the_face(published: FaceModel):
    def moved(name: str) -> np.ndarray:
        return published.expression_basis[published.expression_names.index(name)]

    part_of = np.zeros(len(published.vertices), np.uint8)
    part_of[published.triangles] = published.triangle_part[:, None]
    teeth = np.flatnonzero(part_of == TEETH)
    upper = teeth[published.vertices[teeth, 1] > np.median(published.vertices[teeth, 1]) + 0.005]
    lower = teeth[published.vertices[teeth, 1] < np.median(published.vertices[teeth, 1]) - 0.005]
    # The jaw takes its teeth along, the upper ones stay.
    assert np.abs(moved("jawOpen")[upper]).max() < 1e-4
    assert moved("jawOpen")[lower, 1].max() < -0.01
    mouth = np.flatnonzero(part_of == MOUTH)
    assert moved("jawOpen")[mouth, 1].min() < -0.015
    for side, region, outward in (("L", "eye_left", 1), ("R", "eye_right", -1)):
        ball = published.regions[region]
        front = ball[published.vertices[ball, 2].argmax()]
        assert (
            moved(f"eyeLookUp_{side}")[front, 1]
            > 0.002
            > moved(f"eyeLookDown_{side}")[front, 1] + 0.004
        )
        assert outward * moved(f"eyeLookOut_{side}")[front, 0] > 0.002
        # It turns and keeps its shape: distances within the ball are those at rest.
        turned = published.vertices[ball] + moved(f"eyeLookUp_{side}")[ball]
        rest = np.linalg.norm(published.vertices[ball] - published.vertices[front], axis=1)
        np.testing.assert_allclose(
            np.linalg.norm(turned - turned[ball == front], axis=1), rest, atol=1e-6
        )
        assert np.abs(turned.mean(0) - published.vertices[ball].mean(0)).max() < 4e-3


def test_tongue_and_gums_have_their_own_color_in_a_dark_mouth(published: FaceModel):
    color, place = published.albedo_mean, published.vertices
    mouth, teeth = (
        np.unique(published.triangles[published.triangle_part == part]) for part in (MOUTH, TEETH)
    )

    def colored(value: tuple[float, float, float]) -> np.ndarray:
        return mouth[np.abs(color[mouth] - np.array(value, np.float32)).max(axis=1) < 1e-6]

    gums, tongue, palate, socket = map(colored, (GUM, TONGUE, PALATE, PART_ALBEDO[MOUTH]))
    assert min(map(len, (gums, tongue, palate, socket))) > 200
    near = cKDTree(place[teeth])
    assert near.query(place[gums])[0].max() < 0.0041 < near.query(place[tongue])[0].min()
    front = tongue[place[tongue, 2] > np.percentile(place[teeth, 2], 20)]
    assert len(front) > 20 and np.median(np.abs(place[front, 0])) < 0.015
    assert place[palate, 1].mean() > place[tongue, 1].mean()


def test_parts_and_atlas(published: FaceModel):
    used = published.polygon_uvs[published.polygon_uvs >= 0]
    uvs = published.uvs[np.unique(used)]
    assert uvs.min() >= 0 and uvs.max() <= 1
    assert set(np.unique(published.polygon_part)) >= {SKIN, EYES, TEETH, OTHER}
    # Skin, teeth and eyes do not overlap in the atlas.
    cells = {}
    for part in (SKIN, TEETH, EYES):
        rows = published.triangle_part == part
        centres = published.uvs[published.triangle_uvs[rows]].mean(axis=1)
        cells[part] = {tuple(cell) for cell in np.floor(centres * 20).astype(int)}
    assert not cells[SKIN] & cells[EYES] and not cells[TEETH] & cells[EYES]
    assert published.albedo_mean.min() > 0 and published.albedo_mean.max() < 1

"""The synthetic photo agrees with its truth, and is the same every time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from facestage.contract.camera import Camera
from facestage.contract.face_model import FaceModel
from facestage.contract.files.storage import read_arrays
from facestage.contract.landmarks import Landmarks

SIZE, TEXTURE = 64, 192


def render_case(scene: Any, head: FaceModel, folder: Path) -> Path:
    """A photo of person number 3."""
    from facestage_blender.synthetic.cases.person import random_person
    from facestage_blender.synthetic.photograph import render_person

    person = random_person(head, 3, TEXTURE)
    render_person(scene, head, person, folder, samples=8, seed=3, size=SIZE)
    return folder


@pytest.fixture(scope="module")
def case(empty_scene, head: FaceModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    with empty_scene() as scene:
        return render_case(scene, head, tmp_path_factory.mktemp("person") / "case")


def test_truth_is_where_the_photo_shows_it(case: Path) -> None:
    from facestage_blender.pictures.render import read_pixels

    truth = read_arrays(case / "truth.npz", "truth")
    camera = Camera.read(case / "camera.json")
    photo = read_pixels(case / "photo.exr")[..., :3]
    pixels = np.floor(camera.project(truth["vertices"])).astype(int)
    inside = ((pixels >= 0) & (pixels < SIZE)).all(axis=1)
    shown = np.zeros((SIZE, SIZE), bool)
    shown[pixels[inside, 1], pixels[inside, 0]] = True
    assert truth["mask"][shown].mean() > 0.85  # but for pixels that the silhouette cuts
    assert photo[truth["mask"]].mean() > 2 * photo[~truth["mask"]].mean()
    assert 0.5 < np.percentile(photo[truth["mask"]], 99) < 1.0
    encoded = read_pixels(case / "photo.png")[..., :3]
    from facestage_blender.pictures.render import srgb

    np.testing.assert_allclose(encoded, srgb(photo), atol=0.6 / 255)


def test_landmarks_have_noise_and_true_visibility(case: Path, head: FaceModel) -> None:
    truth = read_arrays(case / "truth.npz", "truth")
    landmarks = Landmarks.read(case / "landmarks.json")
    corners, weights = head.landmark_vertices("ibug68")
    exact = Camera.read(case / "camera.json").project(
        np.einsum("mi,mix->mx", weights, truth["vertices"][corners])
    )
    noise = landmarks.points - exact
    assert 0.7 < noise.std() * 256 / SIZE < 1.3  # in a picture of 256 pixels
    assert landmarks.visible.all()  # the egg's landmarks surround its nose


def test_lights_of_the_truth_face_the_head(case: Path) -> None:
    truth = read_arrays(case / "truth.npz", "truth")
    centre = truth["model_to_camera"][:3, 3]
    towards = centre - truth["light_position"]
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    np.testing.assert_allclose(towards, truth["light_direction"], atol=1e-6)
    assert (truth["light_radiance"] > 0).any(axis=1).sum() == 5
    np.testing.assert_allclose(
        truth["light_corners"].mean(axis=1), truth["light_position"], atol=1e-9
    )


def test_same_seed_same_photo(scene, case: Path, head: FaceModel, tmp_path: Path) -> None:
    from facestage_blender.pictures.render import read_pixels
    from facestage_blender.synthetic.cases.person import random_person

    render_case(scene, head, tmp_path / "again")
    np.testing.assert_array_equal(
        read_pixels(case / "photo.exr"), read_pixels(tmp_path / "again" / "photo.exr")
    )
    assert (case / "landmarks.json").read_text() == (
        tmp_path / "again" / "landmarks.json"
    ).read_text()
    one, other = (random_person(head, seed, TEXTURE) for seed in (3, 4))
    assert not np.allclose(other.identity, one.identity)

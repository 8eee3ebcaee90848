"""Faces are found wherever, however large and however turned they are; what is no face is
refused.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.camera import Camera
from facestage.contract.errors import InputError
from facestage.images.image_io import Photograph, read_photograph
from facestage.landmarks.face_mesh import LEFT_EYE_OUTER, RIGHT_EYE_OUTER
from facestage.landmarks.finder import Face, FaceFinder, choose_face, require_faces
from facestage.landmarks.ibug68 import to_ibug68
from facestage.landmarks.model_file import Bundle
from facestage.landmarks.search import coarse_windows, fine_windows

AsPhoto = Callable[[np.ndarray], Photograph]
INNER = np.arange(17, 68)  # all of ibug68 but the jaw


def only(finder: FaceFinder, photograph: Photograph) -> Face:
    faces = finder.find(photograph).faces
    assert len(faces) == 1
    return faces[0]


def distance(points: np.ndarray, expected: np.ndarray, face: Face) -> np.ndarray:
    """(m,) distances in shares of the distance between the outer corners of the eyes."""
    eyes = face.mesh.points[[RIGHT_EYE_OUTER, LEFT_EYE_OUTER], :2]
    return np.linalg.norm(points - expected, axis=1) / np.linalg.norm(eyes[1] - eyes[0])


def test_the_astronaut_agrees_with_the_landmarks_that_ship_with_the_demo(
    found: Face, repository: Path
):
    shipped = json.loads(
        (repository / "addon/facestage_blender/headless/data/astronaut_landmarks.json").read_text()
    )
    error = distance(to_ibug68(found.landmarks).points, np.array(shipped["points"]), found)
    print(
        f"median {np.median(error):.3f}, worst inside {error[INNER].max():.3f}, worst "
        f"{error.max():.3f}"
    )
    assert np.median(error) < 0.02 and error[INNER].max() < 0.06 and error.max() < 0.12
    assert found.confidence > 0.8 and found.visible.mean() > 0.9


@pytest.mark.parametrize("degrees", [45, 90, 135, 180, -70])
def test_a_turned_photo_gives_the_same_points(
    finder: FaceFinder, astronaut: np.ndarray, photo_of: AsPhoto, found: Face, degrees: int
):
    import cv2

    # About the picture's middle in the contract's pixels; OpenCV counts half a pixel less.
    matrix = cv2.getRotationMatrix2D((255.5, 255.5), -degrees, 1.0)
    matrix[:, 2] += 100
    turned = cv2.warpAffine(astronaut, matrix, (712, 712))
    face = only(finder, photo_of(turned))
    expected = (found.mesh.points[:, :2] - 0.5) @ matrix[:, :2].T + matrix[:, 2] + 0.5
    error = distance(face.mesh.points[:, :2], expected, face)
    print(f"{degrees} degrees: mean {error.mean():.4f}, worst {error.max():.4f}")
    assert error.mean() < 0.015 and error.max() < 0.06
    turn = np.degrees(face.mesh.roll - found.mesh.roll) - degrees
    assert abs((turn + 180) % 360 - 180) < 2


@pytest.mark.parametrize("factor", [0.25, 0.5, 2.0])
def test_another_size_gives_the_same_points(
    finder: FaceFinder, astronaut: np.ndarray, photo_of: AsPhoto, found: Face, factor: float
):
    import cv2

    how = cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC
    face = only(
        finder, photo_of(cv2.resize(astronaut, None, fx=factor, fy=factor, interpolation=how))
    )
    error = distance(face.mesh.points[:, :2] / factor, found.mesh.points[:, :2], found)
    print(f"x {factor}: mean {error.mean():.4f}, worst {error.max():.4f}")
    assert error.mean() < (0.01 if factor >= 0.5 else 0.03), (
        "at a quarter the face is 27 pixels wide"
    )


@pytest.mark.parametrize("place", [(0, 0), (900, 400)])
def test_a_face_of_a_twelfth_of_the_photo_is_found(
    finder: FaceFinder,
    astronaut: np.ndarray,
    photo_of: AsPhoto,
    found: Face,
    place: tuple[int, int],
):
    # 92 pixels wide on 1160: 8 %.
    photo = np.full((800, 1160, 3), 110, np.uint8)
    x, y = place
    patch = astronaut[20:220, 120:340]
    photo[y : y + 200, x : x + 220] = patch
    face = only(finder, photo_of(photo))
    error = distance(face.mesh.points[:, :2] - place + [120, 20], found.mesh.points[:, :2], found)
    assert error.mean() < 0.01


@pytest.mark.parametrize(("left", "right"), [(170, 290), (195, 300), (160, 255)])
def test_a_portrait_that_fills_or_leaves_the_frame_is_found(
    finder: FaceFinder, astronaut: np.ndarray, photo_of: AsPhoto, found: Face, left: int, right: int
):
    face = only(finder, photo_of(astronaut[75:180, left:right]))
    points = found.mesh.points[:, :2]
    inside = (
        (points[:, 0] > left) & (points[:, 0] < right) & (points[:, 1] > 75) & (points[:, 1] < 180)
    )
    error = distance(face.mesh.points[:, :2] + [left, 75], points, found)
    print(f"{inside.mean():.2f} inside, mean error {error[inside].mean():.4f}")
    assert error[inside].mean() < 0.03
    seen = face.mesh.points[face.visible, :2]
    assert (seen > 0).all() and (seen < [right - left, 105]).all(), (
        "what the frame cuts off is not seen"
    )


def test_two_faces_are_told_apart_by_size(
    finder: FaceFinder, astronaut: np.ndarray, photo_of: AsPhoto, found: Face
):
    import cv2

    small = cv2.resize(astronaut, (256, 256), interpolation=cv2.INTER_AREA)
    photo = np.concatenate([np.pad(small, ((256, 0), (0, 0), (0, 0))), astronaut], axis=1)
    faces = finder.find(photo_of(photo)).faces
    assert len(faces) == 2 and faces[0].size > 1.5 * faces[1].size
    first, second = (choose_face(faces, number) for number in (1, 2))
    assert choose_face(faces, None) is first
    assert (
        distance(first.mesh.points[:, :2] - [256, 0], found.mesh.points[:, :2], found).mean() < 0.01
    )
    assert (
        distance(second.mesh.points[:, :2] * 2 - [0, 512], found.mesh.points[:, :2], found).mean()
        < 0.015
    )
    for number in (0, 3, -1):
        with pytest.raises(InputError, match=f"Face {number} was asked for but 2 faces were found"):
            choose_face(faces, number)


@pytest.mark.parametrize("brightness", [1e-3, 1e3])
def test_a_linear_photo_of_any_brightness_gives_the_same_points(
    finder: FaceFinder, astronaut: np.ndarray, photo_of: AsPhoto, found: Face, brightness: float
):
    photo = photo_of(astronaut)
    face = only(finder, replace(photo, color=photo.color * np.float32(brightness)))
    assert distance(face.mesh.points[:, :2], found.mesh.points[:, :2], found).mean() < 0.02


def no_face(name: str) -> np.ndarray:
    import skimage.data

    rng = np.random.default_rng(0)
    made: dict[str, Callable[[], np.ndarray]] = {
        "noise": lambda: rng.integers(0, 256, (300, 400, 3), np.uint8),
        "black": lambda: np.zeros((120, 90, 3), np.uint8),
        "white": lambda: np.full((90, 120), 255, np.uint8),
        "one pixel": lambda: np.full((1, 1, 3), 90, np.uint8),
        "tiny": lambda: rng.integers(0, 256, (5, 8, 3), np.uint8),
        "thin": lambda: rng.integers(0, 256, (3, 3000, 3), np.uint8),
        "cat": skimage.data.chelsea,
        "coffee": skimage.data.coffee,
        "rocket": skimage.data.rocket,
        "cells": skimage.data.cell,
        "coins": skimage.data.coins,
        "page": skimage.data.page,
    }
    return made[name]()


@pytest.mark.parametrize(
    "name",
    [
        "noise",
        "black",
        "white",
        "one pixel",
        "tiny",
        "thin",
        "cat",
        "coffee",
        "rocket",
        "cells",
        "coins",
        "page",
    ],
)
def test_what_is_no_face_is_refused(finder: FaceFinder, photo_of: AsPhoto, name: str):
    search = finder.find(photo_of(no_face(name)))
    assert search.faces == []
    with pytest.raises(InputError, match=r"No face was found .* --landmarks"):
        require_faces(search)


def test_a_transparent_face_is_not_there(
    finder: FaceFinder, astronaut: np.ndarray, photo_of: AsPhoto
):
    photo = photo_of(astronaut)
    mask = photo.mask.copy()
    mask[60:190, 160:290] = False
    assert finder.find(replace(photo, mask=mask)).faces == []


@pytest.mark.parametrize("name", ["soft", "hard_side"])
@pytest.mark.parametrize("suffix", ["png", "exr"])
def test_reference_cases_are_near_their_true_landmarks(
    finder: FaceFinder, shared_data: Path, name: str, suffix: str
):
    folder = shared_data / "cases" / name
    face = only(finder, read_photograph(folder / f"photo.{suffix}"))
    true = json.loads((folder / "landmarks.json").read_text())
    assert Camera.read(folder / "camera.json").width == 256
    seen = np.array(true["visible"])
    converted = to_ibug68(face.landmarks)
    error = distance(converted.points, np.array(true["points"]), face)[seen]
    print(f"{name}.{suffix}: median {np.median(error):.3f}, 95 % {np.quantile(error, 0.95):.3f}")
    assert np.median(error) < 0.05 and np.quantile(error, 0.95) < 0.13
    assert (converted.visible == seen).mean() > 0.85


def test_windows_cover_the_photo_and_their_number_is_bounded():
    for width, height in ((640, 480), (480, 640), (1, 1), (10000, 1000), (3, 3000)):
        windows = coarse_windows(width, height) + fine_windows(width, height)
        assert len(windows) < 200
        x, y = np.meshgrid(np.linspace(0, width, 9), np.linspace(0, height, 9))
        places = np.stack([x.ravel(), y.ravel()], axis=1)
        sides = {round(window.side, 6) for window in windows if window.angle == 0}
        for side in sides:
            inside = [
                np.abs(window.from_photo(places) - 0.5).max(axis=1) <= 0.5 + 1e-9
                for window in windows
                if window.angle == 0 and round(window.side, 6) == side
            ]
            assert np.any(inside, axis=0).all(), (width, height, side)


class OneByOne:
    """An executor that has the work done at once, in this thread."""

    def submit(self, work: Callable[..., object], *given: object) -> Future[object]:
        future: Future[object] = Future()
        future.set_result(work(*given))
        return future


def test_a_mirror_image_in_another_thread_says_what_it_does_in_this_one(
    finder: FaceFinder, bundle: Bundle, astronaut: np.ndarray, photo_of: AsPhoto, found: Face
):
    # Large, so that the networks see copies that are halved when they are first needed.
    photograph = photo_of(np.kron(astronaut[:256, 96:352], np.ones((8, 8, 1), np.uint8)))
    last = 8 * (found.mesh.points[:, :2] - [96, 0])
    alone = FaceFinder(bundle)
    alone._beside, alone._mirror_mesh = OneByOne(), alone._mesh  # type: ignore[assignment]
    one, other = finder.follow(photograph, last), alone.follow(photograph, last)
    assert one is not None and other is not None
    np.testing.assert_array_equal(one.mesh.points, other.mesh.points)
    np.testing.assert_array_equal(one.visible, other.visible)
    assert one.confidence == other.confidence

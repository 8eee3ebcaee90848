"""A map of all directions as lights: where its texels lie, and that a face gets the map's light."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.contract.environment import directions, environment_stage, split_turn
from facestage.contract.errors import InputError
from facestage.contract.light_stage import FROZEN

HEIGHT, WIDTH = 64, 128


def irradiance(picture: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(n, 3) of surfaces with these normals, by the sum over all texels."""
    towards = directions(HEIGHT, WIDTH).reshape(-1, 3)
    area = np.cos(np.arcsin(towards[:, 1])) * (np.pi / HEIGHT) * (2 * np.pi / WIDTH)
    return np.maximum(normals @ towards.T, 0) @ (area[:, None] * picture.reshape(-1, 3))


def stage_irradiance(stage, normals: np.ndarray) -> np.ndarray:
    """The same of square lights, each taken for a point of its solid angle."""
    distance = np.linalg.norm(stage.position, axis=1)
    quarter = 0.25 * stage.side**2
    angle = 4 * np.arcsin(quarter / (quarter + distance**2))
    cosine = np.maximum(normals @ (stage.position / distance[:, None]).T, 0)
    return cosine @ (angle[:, None] * stage.radiance)


def test_places_on_the_map():
    towards = directions(HEIGHT, WIDTH)
    np.testing.assert_allclose(np.linalg.norm(towards, axis=-1), 1)
    assert towards[0, :, 1].min() > 0.99 and towards[-1, :, 1].max() < -0.99
    level = towards[HEIGHT // 2]
    for column, axis in ((WIDTH // 2, [1, 0, 0]), (3 * WIDTH // 4, [0, 0, 1]), (0, [-1, 0, 0])):
        np.testing.assert_allclose(level[column], axis, atol=0.05)


def test_a_turned_map():
    quarter = directions(HEIGHT, WIDTH, 90.0)
    np.testing.assert_allclose(
        quarter, np.roll(directions(HEIGHT, WIDTH), -WIDTH // 4, axis=1), atol=1e-12
    )


@pytest.mark.parametrize("count", [40, 60, 120])
def test_a_face_gets_the_light_of_the_map(count: int):
    """Smooth light with a lamp in it."""
    towards = directions(HEIGHT, WIDTH)
    picture = 1 + towards @ np.array([[0.5, 0.1, 0.3], [0.2, 0.6, 0.1], [0.1, 0.2, 0.4]])
    lamp = np.array([0.6, 0.48, 0.64])
    picture[towards @ lamp > 0.995] = 200.0
    normals = directions(8, 16).reshape(-1, 3)
    stage = environment_stage(picture, count=count)
    assert len(stage) == count and (stage.state == FROZEN).all()
    wanted, found = irradiance(picture, normals), stage_irradiance(stage, normals)
    error = np.abs(found - wanted).max() / wanted.max()
    print(f"{count} lights: irradiance off by {error:.3f} of its most")
    assert error < 0.06
    brightest = stage.position[stage.radiance.mean(axis=1).argmax()]
    assert brightest @ lamp > 0.97


def test_all_light_is_kept_and_none_is_negative():
    picture = np.random.default_rng(2).normal(size=(HEIGHT, WIDTH, 3))
    picture[: HEIGHT // 2] = 0
    stage = environment_stage(picture, degrees=33.0, radius=2.0)
    assert (stage.radiance >= 0).all() and (stage.radiance == 0).any()
    np.testing.assert_allclose(np.linalg.norm(stage.position, axis=1), 2.0)
    towards = directions(HEIGHT, WIDTH)
    area = np.cos(np.arcsin(towards[..., 1])) * (np.pi / HEIGHT) * (2 * np.pi / WIDTH)
    wanted = (area[..., None] * np.maximum(picture, 0)).sum(axis=(0, 1))
    quarter = (0.5 * stage.side) ** 2
    angle = 4 * np.arcsin(quarter / (quarter + 4.0))
    np.testing.assert_allclose((angle[:, None] * stage.radiance).sum(axis=0), wanted, rtol=2e-3)


@pytest.mark.parametrize(
    ("said", "name", "degrees"),
    [
        ("sky.exr@-40.5", "sky.exr", -40.5),
        ("sky.exr", "sky.exr", 0.0),
        ("/some/where@home/sky.exr@90", "/some/where@home/sky.exr", 90.0),
    ],
)
def test_the_turn_stands_behind_the_last_at(said: str, name: str, degrees: float):
    assert split_turn(said) == (name, degrees)


@pytest.mark.parametrize("turn", ["left", "nan", "inf", ""])
def test_a_turn_that_is_no_number_is_refused(turn: str):
    with pytest.raises(InputError, match=f"turned by '{turn}'"):
        split_turn(f"sky.exr@{turn}")

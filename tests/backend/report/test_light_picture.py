from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.light_stage import fibonacci_stage
from facestage.report.light_picture import (
    MATTE_PIXELS,
    MIRROR_PIXELS,
    latlong,
    latlong_directions,
    matte_sphere,
    mirror_sphere,
)


def test_directions_and_places_on_the_map_are_inverse() -> None:
    directions = latlong_directions(6, 12)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1.0)
    place = latlong(directions.reshape(-1, 3)).reshape(6, 12, 2)
    np.testing.assert_allclose(place[..., 0], np.broadcast_to((np.arange(12) + 0.5) / 12, (6, 12)))
    np.testing.assert_allclose(
        place[..., 1], np.broadcast_to((np.arange(6)[:, None] + 0.5) / 6, (6, 12))
    )


def test_the_map_has_the_camera_in_its_middle_and_right_on_its_right() -> None:
    place = latlong(np.array([[0.0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, 1, 0]]))
    np.testing.assert_allclose(place[:3], [[0.5, 0.5], [0.75, 0.5], [0.25, 0.5]], atol=1e-12)
    assert place[3, 1] == 0.0


def test_the_marks_lie_on_the_lights_of_the_probe_that_the_fit_writes() -> None:
    rendering = pytest.importorskip("facestage.fit.forward.rendering")
    stage = fibonacci_stage(20)
    for index in range(len(stage)):
        radiance = np.zeros((20, 3))
        radiance[index] = 1.0
        # The file is seen from inside, the report's picture as the camera sees the face.
        probe = rendering.light_probe(replace(stage, radiance=radiance))[:, ::-1]
        (u, v), (height, width) = latlong(stage.position[index]), probe.shape[:2]
        assert probe[int(v * height), int(u * width)].min() > 0.5, (
            f"light {index + 1} is not at ({u:.3f}, {v:.3f})"
        )


def test_a_matte_sphere_in_uniform_light_is_as_bright_as_the_light() -> None:
    sphere = matte_sphere(np.full((32, 64, 3), 2.0, np.float32), np.eye(3))
    inside = sphere[..., 3] == 1.0
    np.testing.assert_allclose(sphere[inside][:, :3], 2.0, rtol=0.01)


def test_both_spheres_are_bright_on_the_side_of_the_light() -> None:
    probe = np.zeros((32, 64, 3), np.float32)
    probe[14:18, 46:50] = 1.0  # +X, the photo's right
    matte = matte_sphere(probe, np.eye(3))[..., 0]
    assert matte[:, MATTE_PIXELS // 2 :].sum() > 100 * matte[:, : MATTE_PIXELS // 2].sum()
    mirror = mirror_sphere(probe, np.eye(3))[..., 0]
    column = np.nonzero(mirror)[1].mean() / MIRROR_PIXELS
    # reflected at 45 degrees
    assert column == pytest.approx(0.5 + 0.5 * np.sin(np.radians(45)), abs=0.02)


def test_the_camera_turned_half_around_sees_the_other_side_of_the_sphere() -> None:
    probe = np.random.default_rng(0).uniform(0, 1, (16, 32, 3)).astype(np.float32)
    behind = np.diag([-1.0, 1.0, -1.0])
    np.testing.assert_allclose(
        matte_sphere(probe, behind), matte_sphere(np.roll(probe, 16, axis=1), np.eye(3)), atol=1e-5
    )

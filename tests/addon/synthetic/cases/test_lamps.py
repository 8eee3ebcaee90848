"""Lamps and walls stand where the recipe says."""

from __future__ import annotations

import numpy as np

from facestage.contract.light_stage import fibonacci_stage
from reference.known import known


def test_a_lamp_lights_the_face_as_much_as_it_says() -> None:
    from facestage_blender.synthetic.cases.lamps import (
        AIM_SPREAD,
        ANGLE_SPREAD,
        DISTANCE_SPREAD,
        POWER_SPREAD,
        Lamp,
        light_stage,
    )

    lamps = [
        Lamp(azimuth, 20, 2.0, distance, side)
        for azimuth in (-60, 150)
        for distance, side in ((1, 0.01), (2, 0.1))
    ]
    stage = light_stage(lamps, np.random.default_rng(4))
    distance = np.linalg.norm(stage.position, axis=1)
    np.testing.assert_allclose(distance, [1, 2, 1, 2], rtol=DISTANCE_SPREAD)
    np.testing.assert_allclose(np.linalg.norm(stage.direction, axis=1), 1)
    np.testing.assert_allclose((stage.axis_x * stage.direction).sum(1), 0, atol=1e-12)
    aim = -(stage.direction * stage.position).sum(1) / distance
    assert (aim > np.cos(np.radians(2 * AIM_SPREAD))).all()
    # A small lamp of radiance L and area A, seen face on from distance d: E = L A / d^2.
    irradiance = stage.radiance * (stage.side**2 / distance**2)[:, None]
    np.testing.assert_allclose(irradiance, 2.0, rtol=POWER_SPREAD)
    azimuth = np.degrees(np.arctan2(stage.position[:, 0], stage.position[:, 2]))
    np.testing.assert_allclose(azimuth, [-60, -60, 150, 150], atol=ANGLE_SPREAD + 1e-9)


def test_lamps_lie_on_no_lattice() -> None:
    from facestage_blender.synthetic.cases.lamps import light_stage
    from facestage_blender.synthetic.cases.recipe import RECIPES

    lattice = fibonacci_stage().position
    for index, each in enumerate(RECIPES):
        position = light_stage(each.lamps, np.random.default_rng(index)).position
        nearest = np.linalg.norm(position[:, None] - lattice[None], axis=2).min(axis=1)
        assert nearest.max() > 0.05, each.name


def test_walls_stand_where_no_lamp_does() -> None:
    from facestage_blender.synthetic.cases.lamps import light_stage
    from facestage_blender.synthetic.cases.recipe import RECIPES
    from facestage_blender.synthetic.cases.surroundings import walls

    walled = [each for each in RECIPES if each.walls is not None]
    assert walled
    for each in walled:
        behind, beside = walls(known(each.walls), each.lamps)
        assert behind.vertices[:, 2].max() < -0.2
        x, forward = beside.vertices[0, 0], beside.vertices[:, 2].max()
        for position in light_stage(each.lamps, np.random.default_rng(0)).position:
            # The straight line from the lamp to the face's centre passes the wall's plane in front
            # of it, or never.
            assert (
                position[0] * x <= 0
                or abs(position[0]) < abs(x)
                or position[2] * x / position[0] > forward
            )

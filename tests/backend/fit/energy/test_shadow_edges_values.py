"""What the edges of shadows are computed from, in numbers done by hand."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import ArrayLike

from facestage.contract.light_stage import ON, LightStage
from facestage.fit.energy.shadow_edges import (
    ShadowEdges,
    _by_point,
    _silhouette,
    _unshadowed,
    casting_lights,
    omission,
)
from facestage.fit.forward.shading import Surface


def lamps(position: ArrayLike, direction: ArrayLike, side: ArrayLike) -> LightStage:
    """Square lights; what they shine on lies in no particular frame."""
    place, count = np.array(position, float), len(np.array(side))
    across = np.tile([0.0, 1.0, 0.0], (count, 1))
    return LightStage(
        place,
        np.array(direction, float),
        across,
        np.array(side, float),
        np.ones((count, 3)),
        np.full(count, ON),
    )


def test_a_light_casts_when_it_gives_more_than_a_fiftieth_of_all():
    stage = lamps(np.eye(3), -np.eye(3)[[0, 0, 0]], [2.0, 1.0, 0.5])
    # By area and mean radiance: 95.9, 2.1 and 2 of 100.
    radiance = np.array([[23.975] * 3, [0.0, 0.0, 6.3], [8.0, 8.0, 8.0]])
    np.testing.assert_array_equal(casting_lights(stage, radiance), [True, True, False])


def test_light_that_nothing_shadows_falls_off_with_both_cosines_and_the_distance():
    stage = lamps(
        np.array([[0, 0, 2], [3, 0, -0.1], [0, 0, 2], [3, 0, -0.6], [0, 3, 4]]),
        [[0, 0, -1], [-1, 0, 0], [0, 0, 1], [-1, 0, 0], [0, 0, -1]],
        [0.5, 1.0, 0.5, 1.0, 2.0],
    )
    radiance = np.array([[1, 2, 6], [1, 1, 1], [9, 9, 9], [9, 9, 9], [2, 2, 2]], float)
    point = np.zeros((1, 3))
    surface = surface_at(point, np.array([[0.0, 0.0, 1.0]]))
    found = _unshadowed(surface, stage, radiance)
    wanted = [
        0.25 * 3 * 2.25 * 2 / 16,  # its far edge stands a quarter of a metre higher
        0.4 * 3 / 9.01**2,  # has set, but for half of it
        0.0,  # turned away
        0.0,  # has set
        4 * 2 * 5 * 4 / 625,
    ]
    np.testing.assert_allclose(found, [wanted])


def surface_at(points: np.ndarray, normals: np.ndarray) -> Surface:
    """Pixels that see ``points``; nothing else of a surface is asked for."""
    count = len(points)
    flat, corners = np.zeros((count, 3)), np.zeros((count, 3), int)
    return Surface(
        np.zeros((count, 2)),
        flat,
        np.zeros(count, int),
        corners,
        flat,
        np.ones(count),
        points,
        normals,
        np.ones(count),
        normals,
        np.zeros((count, 3, 3)),
        np.zeros((3, 3)),
        np.zeros((3, 3)),
        np.ones(3),
    )


# An edge of y from -1 to 1 before x = 0.1, and a third corner away from it.
CORNERS = np.array([[0.1, -1, 1], [0.1, 1, 1], [2, 0, 1]], float)


@pytest.mark.parametrize("order", [[0, 1, 2], [2, 0, 1], [1, 2, 0]])
@pytest.mark.parametrize(("height", "along"), [(0.25, 0.625), (1.5, 1.0), (-1.5, 0.0)])
def test_the_silhouette_is_the_edge_that_the_ray_touches(
    order: list[int], height: float, along: float
):
    ray = np.array([[0.2, 2 * height, 2.0]])  # through x = 0.1 at depth 1, half the way
    triangle = np.array([order])
    corners, found, normal = _silhouette(triangle, CORNERS, np.zeros((1, 3)), ray)
    np.testing.assert_array_equal(corners, [[0, 1]])
    np.testing.assert_allclose(found, [along], atol=1e-12)
    np.testing.assert_allclose(normal, np.array([[1, 0, -0.1]]) / np.sqrt(1.01), atol=1e-12)


def test_each_ray_has_a_silhouette_of_its_own():
    rays = np.array([[0.2, 0.5, 2.0], [1.05 * 2, 2 * 0.5, 2.0]])
    corners, along, _ = _silhouette(np.array([[0, 1, 2]] * 2), CORNERS, np.zeros((2, 3)), rays)
    np.testing.assert_array_equal(corners, [[0, 1], [1, 2]])
    np.testing.assert_allclose(along, [0.625, 0.5])


def test_places_that_shade_one_pixel_add_up():
    each = np.arange(27.0).reshape(3, 3, 3)
    found = _by_point(np.array([0, 2, 2]), each, 4)
    np.testing.assert_array_equal(
        found, [each[0], np.zeros((3, 3)), each[1] + each[2], 0 * each[0]]
    )


@pytest.fixture
def edges() -> ShadowEdges:
    """Four places that shade the first, the third (twice) and the last of five pixels."""
    random = np.random.default_rng(3)
    return ShadowEdges(
        pixel=np.array([0, 2, 2, 4]),
        corners=np.array([[7, 3], [3, 5], [5, 7], [7, 5]]),
        weights=np.array([[0.25, 0.75], [1, 0], [0.5, 0.5], [0.125, 0.875]]),
        place=random.normal(size=(4, 3)),
        rate=random.normal(size=(4, 3)),
        color=random.uniform(size=(4, 3)),
        by_point=np.zeros((5, 3, 3)),
        by_surface=np.zeros((5, 3, 3)),
    )


PARTS = [slice(0, 5), slice(0, 2), slice(1, 3), slice(2, 5), slice(3, 4)]


@pytest.mark.parametrize("part", PARTS, ids=str)
def test_the_head_carries_the_edges_of_its_shadows_along(edges: ShadowEdges, part: slice):
    centre = np.array([0.5, -1.0, 2.0])
    wanted = np.zeros((3, 5, 6))
    for pixel, place, rate, color in zip(
        edges.pixel, edges.place, edges.rate, edges.color, strict=True
    ):
        arm = place - centre
        turn = [
            arm[1] * rate[2] - arm[2] * rate[1],
            arm[2] * rate[0] - arm[0] * rate[2],
            arm[0] * rate[1] - arm[1] * rate[0],
        ]
        wanted[:, pixel] += color[:, None] * [*turn, *rate]
    found = edges.pose(part, centre)
    np.testing.assert_allclose(found, wanted[:, part], rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("part", PARTS, ids=str)
def test_a_mode_moves_an_edge_by_its_two_ends(edges: ShadowEdges, part: slice):
    np.testing.assert_array_equal(edges.vertices, [3, 5, 7])
    random = np.random.default_rng(4)
    rotation = np.linalg.qr(random.normal(size=(3, 3)))[0]
    modes = random.normal(size=(8, 3, 2))  # of vertex, axis and mode, in the model's frame
    wanted = np.zeros((3, 5, 2))
    for number, pixel in enumerate(edges.pixel):
        motion = sum(
            weight * rotation @ modes[vertex]
            for vertex, weight in zip(edges.corners[number], edges.weights[number], strict=True)
        )
        wanted[:, pixel] += edges.color[number][:, None] * (edges.rate[number] @ motion)
    basis = modes[[3, 5, 7]].reshape(9, 2)
    found = edges.shape(part, rotation, basis)
    np.testing.assert_allclose(found, wanted[:, part], rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize(
    ("share", "why"),
    [
        (
            None,
            "a shadow tells shape only of lamps whose places are known; these stand on a lattice",
        ),
        (0.0059, "0.59 % of the light on the face comes from partly hidden lights"),
        (0.006, "of lights that stand on the lattice, or while hardly any was partly hidden"),
    ],
)
def test_why_edges_were_left_out(share: float | None, why: str):
    assert omission(share) == ("motion of cast shadows in the derivatives", why)

"""What the edges of shadows are computed from, in numbers done by hand."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike

from facestage.contract import brdf
from facestage.contract.job import Job
from facestage.contract.light_stage import OFF, ON, LightStage, fibonacci_stage, joined
from facestage.fit.energy.shadow_edges import (
    CLOSEST,
    COSINE_MIN,
    PENUMBRA_SAMPLES,
    Penumbra,
    ShadowEdges,
    _by_point,
    _silhouette,
    _unshadowed,
    casting_lights,
    find_penumbra,
    lamps_known,
    omission,
    refined,
    shadow_edges,
)
from facestage.fit.forward.shading import Image, Surface
from facestage.render.light_terms import Asked
from facestage.render.shadow_crossings import shadow_crossings
from facestage.render.tracer import SHADOW_OFFSET
from reference.shadow_scene import shadow_scene
from reference.synthetic_scene import Scene, moved


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


SEED = 6
DERIVED = Asked(by_surface=True, by_roughness=True)


@pytest.fixture(scope="module", params=["in the air", "on the wall"])
def shadowed(renderer: str, request: pytest.FixtureRequest) -> tuple[Scene, Image, Penumbra]:
    """A card's soft shadow on a wall, every second pixel of it, with two samples of the lamp."""
    scene = shadow_scene()
    if request.param == "on the wall":
        # It leans there under a wide lamp, and touches what it shades.
        scene = shadow_scene(side_of_light=0.6)
        scene = replace(scene, state=moved(scene.state, identity=[0, 0, -11, 0, 2, 0]))
    state = scene.state
    y, x = np.mgrid[0 : state.camera.height : 2, 0 : state.camera.width : 2]
    surface = scene.forward.surface(state, np.stack([x.ravel(), y.ravel()], axis=1) + 0.5)
    terms = scene.forward.light_terms(state, surface, scene.stage, 2, SEED, DERIVED)
    found = penumbra_of(scene, surface, np.ones(len(surface.pixels)))
    assert len(found.cells.point) > 50
    return scene, scene.forward.shade(state, surface, terms), found


def penumbra_of(scene: Scene, surface: Surface, weight: np.ndarray, lines: int = 1) -> Penumbra:
    every = np.ones(len(scene.stage), bool)
    return find_penumbra(
        scene.forward, scene.state, surface, scene.stage, weight, every, SEED, lines
    )


def test_the_penumbra_is_looked_for_where_pixels_count(shadowed: tuple[Scene, Image, Penumbra]):
    scene, image, _ = shadowed
    surface = image.surface
    weight = np.random.default_rng(0).uniform(0.5, 2, len(surface.pixels))
    weight[::3] = 0
    found = penumbra_of(scene, surface, weight, lines=3)
    # Of one lamp: it lights every pixel of the wall, and is looked at along both of its sides.
    light = weight * _unshadowed(surface, scene.stage, scene.stage.radiance)[:, 0]
    assert found.lines == 2 * 3 * np.count_nonzero(light)
    pixel, lamp = found.pairs
    np.testing.assert_array_equal(pixel, np.unique(found.cells.point))
    assert len(pixel) > 50 and not lamp.any() and (pixel % 3).all()
    assert found.share == pytest.approx(light[pixel].sum() / light.sum())


def test_more_samples_replace_few_where_a_lamp_is_partly_hidden(
    shadowed: tuple[Scene, Image, Penumbra],
):
    scene, image, found = shadowed
    forward, state, surface = scene.forward, scene.state, image.surface
    given = (forward, state, surface, scene.stage)
    after = refined(*given, image.terms, found, samples=2, seed=SEED, asked=DERIVED)
    many = forward.light_terms(state, surface, scene.stage, PENUMBRA_SAMPLES, SEED, DERIVED)
    inside = np.zeros(len(surface.pixels), bool)
    inside[found.pairs[0]] = True
    for name in (field.name for field in fields(many) if field.name not in ("pairs", "indirect")):
        kept, changed, wanted = (getattr(terms, name) for terms in (image.terms, after, many))
        np.testing.assert_array_equal(changed[~inside], kept[~inside])
        bound = 1e-5 * np.abs(wanted).max()
        np.testing.assert_allclose(changed[inside], wanted[inside], rtol=1e-4, atol=bound)
    samples = PENUMBRA_SAMPLES
    enough = refined(*given, many, found, samples=samples, seed=SEED, asked=DERIVED)
    assert enough is many


def test_each_edge_says_how_fast_it_crosses_its_scan_line(shadowed: tuple[Scene, Image, Penumbra]):
    """The module's formulas, place by place, with the nearest points of two lines by least
    squares.
    """
    scene, image, penumbra = shadowed
    forward, state, stage = scene.forward, scene.state, scene.stage
    surface, cells = image.surface, penumbra.cells
    edges = shadow_edges(forward, state, image, stage, penumbra)
    found = shadow_crossings(forward.tracer, forward.lit_points(state, surface, stage), cells)
    rows, by_point = [], np.zeros((len(surface.points), 3, 3))
    for number, pixel in enumerate(cells.point):
        start = surface.points[pixel] + SHADOW_OFFSET * surface.facing[pixel]
        ray = found.target[number] + state.translation - start
        triangle = forward.geometry.triangles[found.triangle[number]]
        best = np.inf
        for one, other in ((0, 1), (1, 2), (2, 0)):
            begin, end = surface.vertices[triangle[[one, other]]]
            lines = np.stack([end - begin, -ray], axis=1)
            along, _ = np.linalg.lstsq(lines, start - begin, rcond=None)[0]
            normal = np.cross(end - begin, ray)
            normal /= np.linalg.norm(normal)
            gap = abs(normal @ (start - begin))
            if gap < best:
                best, at = gap, min(max(along, 0.0), 1.0)
                ends, place, across = triangle[[one, other]], begin + at * (end - begin), normal
        share = (place - start) @ ray / (ray @ ray)
        slope = np.array([across @ stage.axis_x[0], across @ stage.axis_y[0]])
        steep = slope @ slope
        near = np.linalg.norm(place - start) <= CLOSEST
        if near or not 0 < share < 1 or steep <= COSINE_MIN**2 or found.diffuse[number] <= 0:
            continue
        gains = 1.0 if cells.visible[number] < cells.hidden[number] else -1.0
        rate = gains * slope[cells.axis[number]] / steep / share * across
        matte = brdf.K_DIFFUSE / np.pi * image.albedo[pixel] * found.diffuse[number]
        gloss = brdf.K_SPECULAR * image.c_spec[pixel] * found.specular[number]
        color = image.radiance[0] * (matte + gloss)
        by_point[pixel] -= color[:, None] * (1 - share) * rate
        rows.append((pixel, ends, [1 - at, at], place, rate, color))
    assert 50 < len(rows) <= len(cells.point)
    # Where the card touches the wall, some of its edges are too near.
    assert (len(rows) < len(cells.point)) == (state.identity[2] != 0)
    names = ("pixel", "corners", "weights", "place", "rate", "color")
    for name, values in zip(names, zip(*rows, strict=True), strict=True):
        wanted = np.array(values)
        bound = 1e-6 * float(np.abs(wanted).max())
        np.testing.assert_allclose(
            getattr(edges, name), wanted, rtol=1e-5, atol=bound, err_msg=name
        )
    bound = 1e-6 * float(np.abs(by_point).max())
    np.testing.assert_allclose(edges.by_point, by_point, rtol=1e-5, atol=bound)
    for pixel in np.unique(cells.point):
        facing, ray = surface.facing[pixel], surface.rays[pixel]
        wanted = np.zeros((3, 3))
        if facing @ ray < -COSINE_MIN:
            wanted = np.outer(by_point[pixel] @ ray, facing) / (facing @ ray)
        np.testing.assert_allclose(edges.by_surface[pixel], wanted, rtol=1e-4, atol=10 * bound)


def test_a_lamp_is_known_once_it_has_left_its_place_on_the_lattice():
    lattice = fibonacci_stage(6, radius=0.8)
    job = Job(Path("photo.png"), stage=lattice, camera_to_stage=np.eye(4))
    assert not lamps_known(job) and not lamps_known(Job(Path("photo.png")))
    # By more than a thousandth of the radius, whatever that is, along some axis.
    outward = lattice.position / 0.8
    aside = np.cross(outward, np.roll(outward, 1, axis=1))
    aside /= np.abs(aside).max(axis=1, keepdims=True)
    for distance, known in ((0.9e-3, False), (1.1e-3, True)):
        stage = replace(lattice, position=2.5 * (outward + distance * aside))
        assert lamps_known(replace(job, stage=stage)) is known
    far = replace(lattice, position=-lattice.position)
    assert lamps_known(replace(job, stage=far))
    # One that still stands there, and is lit, is enough not to know.
    mixed = np.where(np.arange(6)[:, None] == 2, lattice.position, far.position)
    stage = replace(lattice, position=mixed)
    assert not lamps_known(replace(job, stage=stage))
    off = replace(stage, state=np.where(np.arange(6) == 2, OFF, ON))
    assert lamps_known(replace(job, stage=off))
    assert not lamps_known(replace(job, stage=far, camera_to_stage=None))


def test_lights_that_a_fit_put_behind_the_lattice_make_no_lamp_known():
    lattice = fibonacci_stage(6, radius=0.8)
    behind = fibonacci_stage(9, radius=0.8, behind=True)
    job = Job(Path("photo.png"), stage=joined(lattice, behind), camera_to_stage=np.eye(4))
    assert not lamps_known(job)
    assert lamps_known(replace(job, stage=behind))

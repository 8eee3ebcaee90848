"""How shadows move: the Jacobian with shadow edges against central finite differences of
well-sampled pictures.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike

from facestage.contract.camera import Camera
from facestage.contract.job import Job, Weights
from facestage.contract.landmarks import Landmarks
from facestage.contract.light_stage import OFF, ON, fibonacci_stage
from facestage.fit.energy.photo_jacobian import Jacobian
from facestage.fit.energy.photo_term import PhotoTerm
from facestage.fit.energy.shadow_edges import (
    LINES,
    PENUMBRA_MIN,
    PENUMBRA_SAMPLES,
    Penumbra,
    ShadowEdges,
    find_penumbra,
    lamps_known,
    omission,
    refined,
    shadow_edges,
)
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import SHAPE
from facestage.fit.forward.shading import ForwardModel, Image, Surface
from facestage.fit.given.fineness import Fineness
from facestage.fit.given.problem import read_problem
from facestage.fit.result.left_out import left_out
from facestage.fit.runs.driver import FitRun
from facestage.fit.stages.phases import PhaseName, Schedule, default_schedule
from facestage.fit.stages.view import View
from facestage.render.light_terms import PLAIN, Asked
from reference.known import known
from reference.rendering.meshes import stage_at
from reference.shadow_scene import shadow_scene
from reference.synthetic_case import Case
from reference.synthetic_scene import Scene, moved, plain_photo

SAMPLES, SEED = 1024, 6
DERIVED = Asked(by_surface=True, by_roughness=True)
# Steps that move the shadow by about a tenth of its penumbra.
STEPS: dict[str, ArrayLike] = {
    "pose": np.array([5e-3, 5e-3, 5e-3, 1e-3, 1e-3, 2e-3]),
    "focal": 1e-2,
    "identity": 0.25,
    "expression": 0.25,
}
SUM_BOUND, CORRELATION_BOUND = 0.10, 0.9


@dataclass(frozen=True)
class SoftShadow:
    """The wall's pixels that see a part of the lamp, and what the two Jacobians say of them."""

    scene: Scene
    image: Image
    partly: np.ndarray  # (P,) bool
    edges: ShadowEdges
    frozen: np.ndarray  # (3 P, size) visibility held fixed
    moving: np.ndarray  # (3 P, size)


def picture(scene: Scene, state: State, pixels: np.ndarray, asked: Asked = PLAIN) -> Image:
    surface = scene.forward.surface(state, pixels)
    terms = scene.forward.light_terms(state, surface, scene.stage, SAMPLES, SEED, asked)
    return scene.forward.shade(state, surface, terms)


def jacobian(scene: Scene, image: Image, edges: ShadowEdges | None) -> np.ndarray:
    layout = Layout(scene.state)
    found = Jacobian(scene.forward, scene.state, image, layout, layout.mask(SHAPE), edges=edges)
    result = np.zeros((len(image.color), 3, layout.size))
    for block in found.blocks():
        result[block.pixels, :, found.dense_columns] = block.dense.transpose(1, 0, 2)
    return result.reshape(-1, layout.size)


def penumbra_of(scene: Scene, surface: Surface, lines: int = LINES) -> Penumbra:
    every = np.ones(len(scene.stage), bool)
    weight = np.ones(len(surface.pixels))
    return find_penumbra(
        scene.forward, scene.state, surface, scene.stage, weight, every, SEED, lines
    )


def edges_of(scene: Scene, image: Image, lines: int) -> ShadowEdges:
    found = penumbra_of(scene, image.surface, lines)
    assert 0.02 < found.share < 0.5
    return shadow_edges(scene.forward, scene.state, image, scene.stage, found)


def wall_pixels(scene: Scene) -> np.ndarray:
    """(P, 2) pixels whose whole neighbourhood shows the wall."""
    height, width = scene.state.camera.height, scene.state.camera.width
    y, x = np.mgrid[:height, :width]
    surface = scene.forward.surface(scene.state, np.stack([x.ravel(), y.ravel()], axis=1) + 0.5)
    wall = np.zeros((height, width), bool)
    column, row = surface.pixels.astype(int).T
    wall[row, column] = surface.corners.max(axis=1) < len(scene.geometry.mean) - 9
    inner = wall.copy()
    for shift in (-2, -1, 1, 2):
        inner &= np.roll(wall, shift, axis=0) & np.roll(wall, shift, axis=1)
    rows, columns = np.nonzero(inner)
    return np.stack([columns, rows], axis=1) + 0.5


@pytest.fixture(scope="module")
def penumbra(renderer: str) -> SoftShadow:
    scene = shadow_scene()
    pixels = wall_pixels(scene)
    image = picture(scene, scene.state, pixels, DERIVED)
    asked = Asked(shadows=False)
    whole = scene.forward.light_terms(scene.state, image.surface, scene.stage, SAMPLES, SEED, asked)
    share = image.terms.diffuse[:, 0] / whole.diffuse[:, 0]
    edges = edges_of(scene, image, lines=8)
    frozen, moving = jacobian(scene, image, None), jacobian(scene, image, edges)
    return SoftShadow(scene, image, (share > 0.02) & (share < 0.98), edges, frozen, moving)


def differences(
    penumbra: SoftShadow, block: str
) -> Iterator[tuple[str, int, np.ndarray, np.ndarray]]:
    """Name, column, pixels to compare (P,) and d color / d parameter (P,), the mean of the
    channels.
    """
    scene, image = penumbra.scene, penumbra.image
    layout = Layout(scene.state)
    where = layout.slices[block]
    for offset, step in enumerate(np.broadcast_to(STEPS[block], where.stop - where.start)):
        increment = np.zeros(layout.size)
        increment[where.start + offset] = step
        plus = picture(scene, layout.apply(scene.state, increment), image.surface.pixels)
        minus = picture(scene, layout.apply(scene.state, -increment), image.surface.pixels)
        same = (plus.surface.triangle == image.surface.triangle) & (
            minus.surface.triangle == image.surface.triangle
        )
        wanted = ((plus.color - minus.color) / (2 * step)).mean(axis=1)
        yield f"{block}[{offset}]", where.start + offset, same & penumbra.partly, wanted


def column(matrix: np.ndarray, index: int) -> np.ndarray:
    """(P,) a column, the mean of the channels."""
    return matrix[:, index].reshape(-1, 3).mean(axis=1)


def test_the_scene_has_a_soft_shadow(penumbra: SoftShadow):
    print(
        f"{penumbra.partly.sum()} of {len(penumbra.partly)} pixels in penumbra, "
        f"{len(penumbra.edges.pixel)} places"
    )
    assert penumbra.partly.sum() > 200


def test_one_scan_line_is_right_on_average(penumbra: SoftShadow):
    one = jacobian(
        penumbra.scene, penumbra.image, edges_of(penumbra.scene, penumbra.image, lines=1)
    )
    layout = Layout(penumbra.scene.state)
    for name in ("pose", "identity", "expression"):
        for index in range(layout.slices[name].start, layout.slices[name].stop):
            wanted = column(penumbra.moving, index) - column(penumbra.frozen, index)
            found = column(one, index) - column(penumbra.frozen, index)
            slope = found @ wanted / (wanted @ wanted)
            print(f"{name} column {index}: one line against eight, slope {slope:.3f}")
            assert abs(slope - 1) < 0.06


def test_few_samples_are_mended_where_the_lamp_is_partly_hidden(penumbra: SoftShadow):
    scene, surface = penumbra.scene, penumbra.image.surface
    found = penumbra_of(scene, surface)
    few = scene.forward.light_terms(scene.state, surface, scene.stage, 2, SEED, DERIVED)

    model, stage = scene.forward, scene.stage
    mended = refined(
        model, scene.state, surface, stage, few, found, samples=2, seed=SEED, asked=DERIVED
    )
    truth = penumbra.image.terms.diffuse[:, 0]
    inside = np.zeros(len(truth), bool)
    inside[found.pairs[0]] = True
    # Eight shadow rays along two lines may miss a sliver at the rim of the square.
    missed = penumbra.partly & ~inside
    before, after = (
        np.sqrt(((terms.diffuse[:, 0] - truth)[penumbra.partly] ** 2).mean()) / truth.max()
        for terms in (few, mended)
    )
    print(
        f"{missed.sum()} of {penumbra.partly.sum()} missed; light wrong by {before:.3f} "
        f"before, {after:.3f} after"
    )
    assert missed.sum() < 0.25 * penumbra.partly.sum()
    assert after < 0.5 * before
    many = scene.forward.light_terms(
        scene.state, surface, scene.stage, PENUMBRA_SAMPLES, SEED, DERIVED
    )
    for name in (field.name for field in fields(few) if field.name not in ("pairs", "indirect")):
        before, after, wanted = (getattr(terms, name) for terms in (few, mended, many))
        np.testing.assert_array_equal(after[~inside], before[~inside])
        np.testing.assert_allclose(
            after[inside], wanted[inside], rtol=1e-4, atol=1e-5 * np.abs(wanted).max()
        )


def test_a_shadow_alone_tells_where_the_card_is(renderer: str):
    """Only pixels of the wall are compared: without its shadow's motion, no derivative knows of the
    card.
    """
    scene = shadow_scene()
    photo, _ = scene.render(samples=256)
    start = moved(scene.state, identity=[1.5, -1.0, 0.0, 0.0, 0.0, 0.0])
    wall = np.ones(photo.shape[:2], bool)
    for state in (scene.state, start):
        shown = np.zeros_like(wall)
        across, down = wall_pixels(replace(scene, state=state)).astype(int).T
        shown[down, across] = True
        wall &= shown
    layout = Layout(scene.state)
    first = layout.slices["identity"].start
    active = np.zeros(layout.size, bool)
    active[first : first + 2] = True
    left = {}
    for edges in (False, True):
        casting = np.ones(1, bool) if edges else None
        given = replace(plain_photo(photo), usable=wall)
        term = PhotoTerm(scene.forward, given, scene.stage, 4, casting=casting)
        state = start
        for number in range(5):
            evaluation = term.evaluate(state, SEED + number)
            hessian, gradient = term.normal_equations(
                evaluation, evaluation.base_weight, layout, active
            )
            step = np.zeros(layout.size)
            step[active] = np.linalg.lstsq(
                hessian[np.ix_(active, active)], -gradient[active], rcond=1e-9
            )[0]
            state = layout.apply(state, step)
        left[edges] = float(np.linalg.norm(state.identity) / np.linalg.norm(start.identity))
        print(
            f"shadow edges {edges}: {100 * left[edges]:.1f} % of the offset left after five "
            "Gauss-Newton steps"
        )
    assert left[False] == 1.0
    assert left[True] < 0.05


def test_without_shadows_nothing_changes(renderer: str):
    """A card that the lamp does not see before a wall it sees whole: no cells, and the very same
    Jacobian.
    """
    scene = shadow_scene()
    front = replace(
        scene.stage,
        position=np.array([[0.0, 0.0, 0.2]]),
        direction=np.array([[0.0, 0.0, -1.0]]),
        axis_x=np.array([[1.0, 0.0, 0.0]]),
    )
    state = moved(scene.state, identity=[0, 0, -18.0, 0, 0, 0])  # behind the wall
    pixels = wall_pixels(replace(scene, state=state))
    bare = replace(scene, stage=front, state=state)
    image = picture(bare, state, pixels, DERIVED)
    found = penumbra_of(bare, image.surface)
    assert found.share == 0 and len(found.cells.point) == 0
    edges = shadow_edges(bare.forward, state, image, front, found)
    np.testing.assert_array_equal(jacobian(bare, image, edges), jacobian(bare, image, None))


def correlation(found: np.ndarray, wanted: np.ndarray) -> float:
    """Pearson's; 0 for a derivative that is 0 everywhere."""
    return float(np.corrcoef(found, wanted)[0, 1]) if found.std() > 0 else 0.0


@pytest.mark.parametrize("block", SHAPE)
def test_every_parameter_that_moves_the_shadow(penumbra: SoftShadow, block: str, tmp_path: Path):
    for name, index, compared, wanted in differences(penumbra, block):
        frozen, moving = (
            column(penumbra.frozen, index)[compared],
            column(penumbra.moving, index)[compared],
        )
        wanted = wanted[compared]
        size = np.abs(wanted).sum()
        off = {
            key: abs(found.sum() - wanted.sum()) / size
            for key, found in (("with", moving), ("without", frozen))
        }
        like = {
            key: correlation(found, wanted)
            for key, found in (("with", moving), ("without", frozen))
        }
        error = {
            key: float(np.linalg.norm(found - wanted) / np.linalg.norm(wanted))
            for key, found in (("with", moving), ("without", frozen))
        }
        print(
            f"{name:14s} {compared.sum():4d} pixels: sum off by {100 * off['with']:.1f} % (without "
            f"edges {100 * off['without']:.0f} %), allowed {100 * SUM_BOUND:.0f} %, margin "
            f"{SUM_BOUND / off['with']:.0f}x; correlation {like['with']:.3f} (without "
            f"{like['without']:.3f}); error {error['with']:.2f} (without {error['without']:.2f})"
        )
        np.savez(
            tmp_path / f"{name}.npz",
            pixels=penumbra.image.surface.pixels[compared],
            wanted=wanted,
            found=moving,
        )
        assert compared.sum() > 100
        assert off["with"] < SUM_BOUND, f"see {tmp_path}"
        assert like["with"] > CORRELATION_BOUND
        assert error["with"] < 0.5 * error["without"]


def test_where_no_shadow_falls_the_fit_ends_the_same(scene: Scene):
    """The rule of omission: a lamp at the camera hides its shadows, and edges change nothing."""
    matrix = np.eye(4)
    matrix[:3, 3] = scene.state.translation
    lamp = stage_at(np.array([[0.01, 0.02, 0.8]] * len(scene.stage)), side=0.1).transformed(matrix)
    scene = replace(scene, stage=lamp.with_radiance(scene.stage.radiance))
    photo, _ = scene.render()
    start = moved(
        scene.state, identity=[0.3, -0.2, 0.25, 0.2], pose=[0.01, -0.01, 0.005, 1e-3, -5e-4, 2e-3]
    )
    ends, share = {}, 0.0
    for edges in (False, True):
        stage = scene.solver(photo, ("pose", "identity", "expression"), 4, Weights())
        term = stage.energy.term(PhotoTerm)
        every = np.ones(len(scene.stage), bool)
        term = replace(term, casting=every if edges else None)
        stage.energy = replace(stage.energy, terms=(*stage.energy.without(PhotoTerm).terms, term))
        share = term.penumbra_share(start, every, SEED)
        ends[edges] = scene.forward.pose(scene.fit(stage, start)[0])[1]
    moved_by = 1e3 * np.linalg.norm(ends[True] - ends[False], axis=1).mean()
    offset = (
        1e3
        * np.linalg.norm(
            scene.forward.pose(start)[1] - scene.forward.pose(scene.state)[1], axis=1
        ).mean()
    )
    print(
        f"{100 * share:.2f} % in penumbra: the ends differ by {moved_by:.3f} mm, the start was "
        f"{offset:.2f} mm off"
    )
    assert share < PENUMBRA_MIN
    assert moved_by < 0.02 * offset
    assert f"{100 * share:.2f} %" in omission(share)[1]


def test_what_is_left_out_is_said():
    assert "lattice" in omission(None)[1]
    assert omission(0.5 * PENUMBRA_MIN)[1] != omission(PENUMBRA_MIN)[1]


def test_a_schedule_asks_for_edges_where_the_shape_moves():
    asked = [
        phase.name for phase in Schedule().with_shadow_edges(True).phases if phase.shadow_edges
    ]
    assert asked == ["geometry", "joint"]
    assert Schedule().with_shadow_edges(True).with_shadow_edges(False) == Schedule()


def test_shadows_tell_shape_only_of_lamps_that_someone_placed(case: Case):
    job = Job(case.photo, case.model_option, Landmarks.read(case.landmarks), device="cpu")
    lattice = fibonacci_stage(6, radius=0.8)
    placed = replace(lattice, position=lattice.position + np.array([0.2, 0.0, 0.1]))
    first = np.array([1, 0, 0, 0, 0, 0], bool)
    one_placed = replace(
        lattice,
        position=np.where(first[:, None], placed.position, lattice.position),
        state=np.where(first, ON, OFF),
    )
    assert not lamps_known(job)
    assert not lamps_known(replace(job, stage=lattice, camera_to_stage=np.eye(4)))
    assert not lamps_known(replace(job, stage=placed)), (
        "where the camera stands in the stage is a guess"
    )
    for stage in (placed, one_placed):
        known = replace(job, stage=stage, camera_to_stage=np.eye(4))
        assert lamps_known(known)
        phases = default_schedule(known).phases
        assert [phase.name for phase in phases if phase.shadow_edges] == ["geometry", "joint"]
    assert default_schedule(job) == Schedule()


def test_only_lights_that_cast_are_looked_at(penumbra: SoftShadow):
    scene, surface = penumbra.scene, penumbra.image.surface
    none = np.zeros(len(scene.stage), bool)
    found = find_penumbra(
        scene.forward, scene.state, surface, scene.stage, np.ones(len(surface.pixels)), none, SEED
    )
    assert found.lines == found.share == len(found.cells.point) == 0


def test_a_fit_looks_for_penumbra_only_when_it_is_asked_to(case: Case, small_maps: Fineness):
    """Of placed lamps all cast; of a lattice only the lights that may turn to where a lamp was."""
    job = Job(
        case.photo,
        case.model_option,
        Landmarks.read(case.landmarks),
        Camera.read(case.camera),
        device="cpu",
    )
    lattice = fibonacci_stage(4)
    placed = replace(lattice, position=lattice.position + np.array([0.2, 0.0, 0.1]))
    first = np.array([True, False, False, False])
    found: dict[tuple[str, bool, float], tuple[float | None, np.ndarray | None]] = {}
    for name, given in (
        ("lattice", replace(job, stage=lattice)),
        ("placed", replace(job, stage=placed, camera_to_stage=np.eye(4))),
    ):
        problem = read_problem(given, fineness=small_maps)
        forward = ForwardModel(problem.geometry, problem.lights)
        for edges, minimum in ((False, 0.0), (True, 0.0), (True, 1.0)):
            view = View(problem, forward, minimum)
            view.strong = first
            state = replace(view.start_state(), lights=np.ones(problem.lights.size))
            stage = view.descent(Schedule().with_shadow_edges(edges)[PhaseName.GEOMETRY], state)
            assert stage is not None and stage.energy.photo is not None
            found[name, edges, minimum] = (view.penumbra, stage.energy.photo.casting)
    for name, casting in (("lattice", first), ("placed", np.ones(4, bool))):
        assert found[name, False, 0.0] == (None, None)
        share, lights = found[name, True, 0.0]
        print(f"{name}: {100 * known(share):.2f} % in penumbra")
        np.testing.assert_array_equal(known(lights), casting)
        assert found[name, True, 1.0] == (share, None)


def test_the_result_counts_the_scan_lines_that_were_left_out(
    case: Case, small_maps: Fineness, tmp_path: Path
):
    job = Job(
        case.photo,
        case.model_option,
        Landmarks.read(case.landmarks),
        Camera.read(case.camera),
        device="cpu",
    )
    problem = read_problem(replace(job, stage=fibonacci_stage(4)), fineness=small_maps)
    phases = tuple(replace(phase, steps=min(phase.steps, 1)) for phase in Schedule().phases)
    run = FitRun(
        problem, ForwardModel(problem.geometry, problem.lights), tmp_path, schedule=Schedule(phases)
    )
    (entry,) = (
        entry for entry in left_out(problem, run.run(float("inf"))) if "shadows" in entry["what"]
    )
    assert "scan lines on the lights" in entry["saved"] and "lattice" in entry["why"]

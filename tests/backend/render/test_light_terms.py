"""Diffuse and specular light of small scenes against the float64 reference, sample for sample and
as integrals.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.light_stage import fibonacci_stage
from facestage.render.light_terms import Asked, LightTerms
from reference.rendering.area_light import direct_light, grid, lattice
from reference.rendering.meshes import (
    Mesh,
    Points,
    lit_points,
    plane,
    seen_points,
    sphere,
    stage_at,
)

ROUGHNESS = 0.35
OFFSET = 2e-4
OPEN, MATTE = Asked(shadows=False), Asked(specular=False)
DERIVED = Asked(by_surface=True, by_roughness=True)


@pytest.fixture(scope="module")
def scene() -> tuple[Mesh, Points]:
    mesh = sphere().joined(plane())
    return mesh, seen_points(mesh, 20)


def relative(found: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    return np.abs(found - wanted) / (wanted + 1e-3 * wanted.max())


@pytest.mark.parametrize("roughness", [0.05, 0.35, 1.0])
def test_unshadowed_terms_equal_the_reference_sample_for_sample(tracer_of, scene, roughness: float):
    mesh, seen = scene
    stage = fibonacci_stage(6, radius=0.8, side=0.25)
    terms = tracer_of(mesh).light_terms(seen.lit(stage, roughness), 3, seed=11, asked=OPEN)
    square = lattice(len(seen.points), len(stage), 3, 11)
    diffuse, specular = direct_light(
        seen.points, seen.normals, seen.views, stage, roughness, square
    )
    errors = relative(terms.diffuse, diffuse), relative(terms.specular, specular)
    print(
        f"roughness {roughness}: float32 against float64, diffuse {errors[0].max():.1e}, "
        f"specular {errors[1].max():.1e}"
    )
    assert errors[0].max() < 1e-4
    # At roughness 0.05 a lobe is 0.0025 wide: a direction's float32 rounding moves it visibly.
    assert np.percentile(errors[1], 99) < (1e-2 if roughness < 0.1 else 1e-3)


def test_area_lights_converge_to_the_integral(tracer_of, scene):
    mesh, seen = scene
    rows = slice(0, None, 9)
    points = tuple(array[rows] for array in (seen.points, seen.normals, seen.facing, seen.views))
    stage = fibonacci_stage(4, radius=0.5, side=0.3)
    square = grid(len(points[0]), len(stage), 24)
    wanted = direct_light(points[0], points[1], points[3], stage, ROUGHNESS, square)
    tracer = tracer_of(mesh)
    print("samples, error of the mean light over the mean (diffuse, specular)")
    errors = []
    for samples in (4, 32, 512):
        terms = tracer.light_terms(
            lit_points(points, stage, ROUGHNESS), samples, seed=2, asked=OPEN
        )
        pair = [
            float(np.sqrt(((found - want) ** 2).mean()) / want.mean())
            for found, want in zip((terms.diffuse, terms.specular), wanted, strict=True)
        ]
        errors.append(pair)
        print(f"{samples:4d}: {pair[0]:.1e} {pair[1]:.1e}")
    assert errors[2][0] < 2e-3 and errors[2][1] < 2e-2
    assert errors[2][0] < errors[0][0] / 4 and errors[2][1] < errors[0][1] / 4


def test_a_far_small_light_gives_the_inverse_square_law(tracer_of):
    mesh = plane(height=0.0)
    count = 5
    points = np.zeros((count, 3))
    up = np.tile([0.0, 0, 1], (count, 1))
    views = np.tile([0.6, 0.0, 0.8], (count, 1))
    for distance in (0.5, 1.0, 4.0):
        stage = stage_at([[0, 0, distance]], side=0.02)
        terms = tracer_of(mesh).light_terms(
            lit_points((points, up, up, views), stage, ROUGHNESS), 1, seed=0
        )
        np.testing.assert_allclose(terms.diffuse, 0.02**2 / distance**2, rtol=1e-3)


def test_a_closed_form_a_square_light_over_its_centre(tracer_of):
    """Irradiance of a parallel square at unit radiance: pi times its form factor (Siegel & Howell,
    C-3).
    """
    stage = stage_at([[0, 0, 0.5]], side=0.6)
    up = np.array([[0.0, 0, 1]])
    terms = tracer_of(plane(0.0)).light_terms(
        lit_points((np.zeros((1, 3)), up, up, up), stage, ROUGHNESS), 4096, seed=0
    )
    a = 0.3 / 0.5
    wanted = 4 * a / np.sqrt(1 + a**2) * np.arctan(a / np.sqrt(1 + a**2))
    assert terms.diffuse[0, 0] == pytest.approx(wanted, rel=1e-3)


def test_lights_are_one_sided_and_light_only_what_faces_them(tracer_of):
    front = stage_at([[0, 0, 0.5]], side=0.2)
    turned = replace(front, direction=-front.direction)
    behind = stage_at([[0, 0, -0.5]], side=0.2)
    up = np.array([[0.0, 0, 1]])
    tracer = tracer_of(plane(0.0))
    for stage, lit in ((front, True), (turned, False), (behind, False)):
        point = lit_points((np.zeros((1, 3)), up, up, up), stage, ROUGHNESS)
        terms = tracer.light_terms(point, 4, seed=0, asked=replace(DERIVED, shadows=False))
        for name, value in vars(terms).items():
            assert np.isfinite(value).all(), name
            if not lit:
                assert not np.any(value), f"{name} must be exactly zero"
        assert (terms.diffuse[0, 0] > 0) == lit


def test_no_points_and_no_derivatives(tracer_of):
    empty = np.zeros((0, 3))
    stage = fibonacci_stage(3)
    tracer = tracer_of(plane())
    dark = lit_points((empty,) * 4, stage, ROUGHNESS)
    terms = tracer.light_terms(dark, 2, seed=0)
    assert (
        terms.diffuse.shape == terms.specular.shape == (0, 3) and terms.diffuse_by_normal.size == 0
    )
    terms = tracer.light_terms(dark, 2, seed=0, asked=DERIVED)
    assert terms.diffuse_by_normal.shape == (0, 3, 3) and terms.specular_by_roughness.shape == (
        0,
        3,
    )
    hits = tracer.first_hits(np.zeros(3), empty)
    assert hits.triangle.shape == (0,) and hits.barycentric.shape == (0, 3)


def test_a_light_is_the_same_alone_and_among_others(tracer_of, scene):
    """Each light's column depends on that light only, up to which random shift it gets."""
    mesh, seen = scene
    stage = fibonacci_stage(5, radius=0.8, side=0.2)
    tracer = tracer_of(mesh)
    rows = (seen.points, seen.normals, seen.facing, seen.views)
    together = tracer.light_terms(lit_points(rows, stage, ROUGHNESS), 256, seed=3)
    for light in range(5):
        one = replace(
            stage,
            **{
                name: getattr(stage, name)[light : light + 1] for name in stage.__dataclass_fields__
            },
        )
        alone = tracer.light_terms(lit_points(rows, one, ROUGHNESS), 256, seed=3)
        scale = together.diffuse.max()
        assert np.abs(alone.diffuse[:, 0] - together.diffuse[:, light]).max() < 0.03 * scale


def test_the_seed_alone_decides_the_samples(tracer_of, scene):
    mesh, seen = scene
    stage = fibonacci_stage(4, radius=0.6, side=0.3)
    tracer = tracer_of(mesh)
    rows = (seen.points, seen.normals, seen.facing, seen.views)
    first, again, other = (
        tracer.light_terms(lit_points(rows, stage, ROUGHNESS), 2, seed=seed) for seed in (5, 5, 6)
    )
    np.testing.assert_array_equal(first.diffuse, again.diffuse)
    np.testing.assert_array_equal(first.specular, again.specular)
    assert np.abs(first.diffuse - other.diffuse).max() > 1e-4


def test_derivatives_do_not_change_the_values(tracer_of, scene):
    mesh, seen = scene
    stage = fibonacci_stage(4, radius=0.6, side=0.3)
    tracer = tracer_of(mesh)
    rows = (seen.points, seen.normals, seen.facing, seen.views)
    plain = tracer.light_terms(lit_points(rows, stage, ROUGHNESS), 2, seed=5)
    derived = tracer.light_terms(lit_points(rows, stage, ROUGHNESS), 2, seed=5, asked=DERIVED)
    np.testing.assert_allclose(plain.diffuse, derived.diffuse, rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(plain.specular, derived.specular, rtol=1e-4, atol=1e-7)
    matte = tracer.light_terms(lit_points(rows, stage, ROUGHNESS), 2, seed=5, asked=MATTE)
    np.testing.assert_allclose(matte.diffuse, plain.diffuse, rtol=1e-5, atol=1e-7)
    assert not matte.specular.any()


def test_far_from_the_origin_nothing_but_rounding_changes(tracer_of, scene):
    mesh, seen = scene
    stage = fibonacci_stage(3, radius=0.8, side=0.2)
    near = tracer_of(mesh).light_terms(seen.lit(stage, ROUGHNESS), 4, seed=1, asked=OPEN)
    shift = np.array([8.0, -16.0, 4.0])
    far = tracer_of(Mesh(mesh.vertices + shift, mesh.triangles)).light_terms(
        replace(seen, points=seen.points + shift).lit(
            replace(stage, position=stage.position + shift), ROUGHNESS
        ),
        4,
        seed=1,
        asked=OPEN,
    )
    assert relative(far.diffuse, near.diffuse).max() < 1e-3


def test_a_point_keeps_its_samples_when_others_go(tracer_of, scene):
    mesh, seen = scene
    stage = fibonacci_stage(4, radius=0.6, side=0.3)
    tracer = tracer_of(mesh)
    rows = (seen.points, seen.normals, seen.facing, seen.views)
    keys = np.arange(len(seen.points)) * 65536 + 17
    every = tracer.light_terms(lit_points(rows, stage, ROUGHNESS, keys), 2, seed=5)
    some = slice(3, None, 2)
    fewer = tracer.light_terms(
        lit_points(tuple(array[some] for array in rows), stage, ROUGHNESS, keys[some]), 2, seed=5
    )
    np.testing.assert_allclose(fewer.diffuse, every.diffuse[some], rtol=1e-6)
    np.testing.assert_allclose(fewer.specular, every.specular[some], rtol=1e-4, atol=1e-7)


def test_lights_that_are_left_out_are_zero_and_change_no_other(tracer_of, scene):
    mesh, seen = scene
    stage = fibonacci_stage(7, radius=0.6, side=0.3)
    tracer = tracer_of(mesh)
    rows = (seen.points, seen.normals, seen.facing, seen.views)
    every = tracer.light_terms(lit_points(rows, stage, ROUGHNESS), 2, seed=5)
    traced = np.array([True, False, True, True, False, False, True])
    some = tracer.light_terms(lit_points(rows, stage, ROUGHNESS), 2, seed=5, traced=traced)
    for name in ("diffuse", "specular"):
        np.testing.assert_array_equal(
            getattr(some, name)[:, traced], getattr(every, name)[:, traced]
        )
        assert not getattr(some, name)[:, ~traced].any()
    none = tracer.light_terms(
        lit_points(rows, stage, ROUGHNESS), 2, seed=5, asked=DERIVED, traced=np.zeros(7, bool)
    )
    assert not none.diffuse.any() and none.diffuse_by_normal.shape == (len(seen.points), 3, 3)


@pytest.mark.parametrize("lanes", [1, 1 << 12, 1 << 20])
def test_how_the_work_is_split_changes_nothing(tracer_of, scene, lanes: int):
    mesh, seen = scene
    stage = fibonacci_stage(7, radius=0.6, side=0.3, radiance=2.0)
    rows = (seen.points, seen.normals, seen.facing, seen.views)
    tracer = tracer_of(mesh)
    usual = tracer.light_terms(lit_points(rows, stage, ROUGHNESS), 2, seed=5, asked=DERIVED)
    other = tracer_of(mesh, lanes=lanes).light_terms(
        lit_points(rows, stage, ROUGHNESS), 2, seed=5, asked=DERIVED
    )
    assert other.pairs == usual.pairs
    np.testing.assert_array_equal(other.diffuse, usual.diffuse)
    for name in (
        "diffuse_by_normal",
        "specular_by_normal",
        "specular_by_depth",
        "specular_by_roughness",
    ):
        wanted = getattr(usual, name)
        np.testing.assert_allclose(
            getattr(other, name), wanted, atol=1e-5 * np.abs(wanted).max(), err_msg=name
        )


def test_a_light_behind_a_point_costs_no_work_and_adds_nothing(tracer_of, scene):
    mesh, seen = scene
    stage = fibonacci_stage(8, radius=0.6, side=0.3)
    tracer = tracer_of(mesh)
    rows = (seen.points, seen.normals, seen.facing, seen.views)
    lean = tracer.light_terms(lit_points(rows, stage, ROUGHNESS), 2, seed=5, asked=DERIVED)
    full = tracer.light_terms(
        lit_points(rows, stage, ROUGHNESS), 2, seed=5, asked=replace(DERIVED, behind=True)
    )
    # A square reaches over the horizon with a corner at least.
    corner = np.einsum(
        "px,plcx->plc", seen.normals, stage.corners[None] - seen.points[:, None, None]
    )
    before = np.einsum("lx,plx->pl", stage.direction, seen.points[:, None] - stage.position) > 0
    assert full.pairs == lean.diffuse.size
    assert lean.pairs == int((before & (corner.max(axis=2) > 0)).sum()) < full.pairs
    np.testing.assert_array_equal(lean.diffuse, full.diffuse)
    np.testing.assert_array_equal(lean.specular, full.specular)
    np.testing.assert_allclose(lean.diffuse_by_normal, full.diffuse_by_normal, rtol=1e-5, atol=1e-7)


def test_chosen_pairs_of_point_and_light_have_the_terms_of_a_whole_trace(tracer_of, scene):
    """The same numbers for each pair, and derivatives that add up to the sums over the lights."""
    mesh, seen = scene
    stage = fibonacci_stage(5, radius=0.8, side=0.25).with_radiance(
        np.arange(15.0).reshape(5, 3) + 1
    )
    tracer, count = tracer_of(mesh), len(seen.points)
    keys, numbers = np.arange(count)[::-1] + 5, np.array([4, 9, 1, 0, 7])
    lit = replace(seen.lit(stage, ROUGHNESS), keys=keys, numbers=numbers)
    whole = tracer.light_terms(lit, 3, 11, DERIVED)
    pairs = np.divmod(np.arange(count * len(stage)), len(stage))
    each = tracer.light_terms(lit, 3, 11, DERIVED, pairs=pairs)
    for name in ("diffuse", "specular"):
        np.testing.assert_array_equal(getattr(each, name)[:, 0], getattr(whole, name)[pairs])
    for name in (
        "diffuse_by_normal",
        "specular_by_normal",
        "diffuse_by_depth",
        "specular_by_depth",
        "specular_by_roughness",
    ):
        wanted = getattr(whole, name)
        found = getattr(each, name).reshape(count, len(stage), *wanted.shape[1:]).sum(axis=1)
        np.testing.assert_allclose(found, wanted, rtol=1e-4, atol=1e-5 * np.abs(wanted).max())
    none = tracer.light_terms(lit, 3, 11, DERIVED, pairs=(np.zeros(0, int), np.zeros(0, int)))
    assert none.diffuse.shape == (0, 1) and none.diffuse_by_normal.shape == (0, 3, 3)


def test_parts_of_points_joined_again_are_the_whole() -> None:
    random = np.random.default_rng(0)
    whole = LightTerms(
        random.uniform(size=(7, 2)),
        random.uniform(size=(7, 2)),
        diffuse_by_normal=random.uniform(size=(7, 3, 3)),
        specular_by_roughness=random.uniform(size=(7, 3)),
        indirect=random.uniform(size=(3, 7, 2)),
    )
    first = np.arange(7) < 3
    joined = LightTerms.joined([whole.part(first), whole.part(np.flatnonzero(~first))])
    for name, each in vars(whole).items():
        np.testing.assert_array_equal(getattr(joined, name), each, name)
    assert len(whole.part(first).diffuse) == 3 and whole.part(first).indirect.shape == (3, 3, 2)

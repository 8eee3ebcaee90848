"""The per-texel stage over a problem read from files: what is held stays, and the coverage says
what is what.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from facestage.contract.camera import Camera
from facestage.contract.job import Job
from facestage.contract.landmarks import Landmarks
from facestage.contract.light_stage import LightStage
from facestage.contract.result import BY_SYMMETRY, SEEN
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.state import State
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.beard import Beard
from facestage.fit.given.face_areas import lips_share, mouth_share, opening_share
from facestage.fit.given.fineness import USUAL
from facestage.fit.given.problem import Problem, read_problem
from facestage.fit.given.skin_mask import border_width
from facestage.fit.result.finer_photo import finer_photo
from facestage.fit.textures.atlas import Atlas
from facestage.fit.textures.cast_shadow import DARKER
from facestage.fit.textures.eyes.part_color import Look, part_colors
from facestage.fit.textures.lids_beside import LidsBeside
from facestage.fit.textures.refine import Refined, refine, texture_size
from facestage.fit.textures.shown import BROW_DEPARTURE, LASH_DEPARTURE, what_is_shown
from facestage.fit.textures.unseen_tone import FEATURE_MAX
from facestage.fit.trust.certainty import Certainty
from facestage.fit.trust.fitted import Fitted
from facestage.models.anatomy.landmark_schemes import scheme_of
from reference.small_fit import SMALL
from reference.synthetic_case import Case
from reference.synthetic_scene import Scene


@pytest.fixture(scope="module")
def problem(case: Case) -> Problem:
    return read_problem(
        Job(
            case.photo, case.model_option, Landmarks.read(case.landmarks), Camera.read(case.camera)
        ),
        fineness=SMALL,
    )


def refined(scene: Scene, problem: Problem, *freeze: str) -> Refined:
    """The truth, refined against the photo."""
    given = replace(problem, job=replace(problem.job, freeze=freeze))
    return refine(given, scene.forward, at_truth(scene, problem))


def at_truth(scene: Scene, problem: Problem) -> Fitted:
    brightest = scene.render(samples=16)[0].max()
    return Fitted(
        state=scene.state,
        start=scene.state,
        camera_to_stage=np.eye(4),
        stage=scene.stage.with_radiance(scene.stage.radiance * 0.75 / brightest),
        trace=[],
        energy={},
        condition=1.0,
        seconds=0.0,
        check_seconds=0.0,
        in_time=True,
        certainty=Certainty({}, {}),
        shading_doubt=None,
        hidden=np.zeros(problem.photograph.mask.shape, bool),
        dark=np.zeros(problem.photograph.mask.shape, bool),
        shadowed=np.zeros(problem.photograph.mask.shape, bool),
        doubt="",
        settled=True,
        lens=None,
        landmark_statistic=0.0,
    )


def test_what_is_frozen_stays_as_it_was(scene: Scene, problem: Problem):
    held = refined(scene, problem, "albedo", "specular", "roughness")
    assert not held.coverage.any()
    assert held.textures.roughness is not None
    np.testing.assert_allclose(held.textures.roughness, scene.state.roughness, rtol=1e-6)
    atlas = Atlas.build(scene.geometry, 64)
    basis = np.exp(atlas.bake(scene.forward.log_albedo(scene.state)))
    np.testing.assert_allclose(held.textures.albedo, np.minimum(basis, 0.999), rtol=1e-5)
    free = refined(scene, problem)
    for name, channel in (("albedo", 0), ("specular", 1), ("roughness", 2)):
        some = refined(scene, problem, name)
        np.testing.assert_array_equal(getattr(some.textures, name), getattr(held.textures, name))
        assert not some.coverage[..., channel].any()
        assert np.abs(getattr(free.textures, name) - getattr(held.textures, name)).max() > 1e-5


def upper(scene: Scene, least: float) -> np.ndarray:
    """(vertices,) bool, above ``least`` of -1..1 from the face's bottom to its top."""
    return np.asarray(2 * (scene.model.uvs[:, 1] - 0.02) / 0.96 - 1 > least)


def with_scalp(scene: Scene, problem: Problem, hairy: np.ndarray, shade: float) -> Problem:
    """A face model that paints a ``shade`` of hair on ``hairy`` vertices."""
    model = replace(
        scene.model,
        regions={**scene.model.regions, "scalp": np.flatnonzero(hairy).astype(np.int32)},
        albedo_mean=np.where(hairy[:, None], shade, 1).astype(np.float32) * scene.model.albedo_mean,
    )
    return replace(problem, geometry=FaceGeometry(model))


def test_gloss_goes_where_a_model_paints_hair_unless_it_is_held(scene: Scene, problem: Problem):
    shaded = with_scalp(scene, problem, upper(scene, 0.8), 0.4)
    with_hair, without = refined(scene, shaded), refined(scene, problem)
    ratio = with_hair.textures.specular / without.textures.specular
    middle = ratio.shape[1] // 2
    print("of the gloss stays, from top to bottom:", ratio[::8, middle])
    assert ratio[1, middle] < 0.6
    np.testing.assert_allclose(ratio[len(ratio) // 2 :], 1.0, atol=0.01)
    held = refined(scene, shaded, "specular")
    np.testing.assert_array_equal(
        held.textures.specular, refined(scene, problem, "specular").textures.specular
    )


def test_flesh_in_the_corners_of_the_eyes_keeps_the_models_color(scene: Scene, problem: Problem):
    flesh = ~upper(scene, 0.3) & upper(scene, -0.3)
    model = replace(
        scene.model,
        regions={**scene.model.regions, "eye_corners": np.flatnonzero(flesh).astype(np.int32)},
    )
    with_flesh = refined(scene, replace(problem, geometry=FaceGeometry(model))).textures.albedo
    plain = refined(scene, problem).textures.albedo
    atlas = Atlas.build(scene.geometry, len(plain))
    basis = np.exp(atlas.bake(scene.forward.log_albedo(scene.state)))
    share = atlas.bake(flesh[:, None].astype(float))[..., 0]
    inside, outside = atlas.covered & (share > 0.999), atlas.covered & (share < 0.001)
    assert np.abs(np.log(plain / basis))[inside].max() > 0.03
    np.testing.assert_allclose(with_flesh[inside], basis[inside], rtol=1e-3)
    np.testing.assert_allclose(with_flesh[outside], plain[outside], rtol=1e-3)


def test_hair_has_the_color_of_the_photo_s(scene: Scene, problem: Problem):
    """A photo with black hair where the model paints a thin shade, which no other pixel shows."""
    hairy = upper(scene, 0.6)
    y, x = np.mgrid[:96, :96]
    surface = scene.forward.surface(scene.state, np.stack([x.ravel(), y.ravel()], 1) + 0.5)
    column, row = np.floor(surface.pixels).astype(int).T
    there = np.zeros((96, 96), bool)
    there[row, column] = surface.of_vertices(hairy[:, None] + 0.0)[:, 0] > 0.1
    color = np.where(there[..., None], 0.02, problem.photograph.color).astype(np.float32)
    black = replace(problem.photograph, color=color)
    shaded = with_scalp(scene, problem, hairy, 0.7)
    own = refined(scene, shaded)
    found = refined(scene, replace(shaded, photograph=black))
    assert own.hair is not None and found.hair is not None
    print("shade of hair, the model's and the photo's:", own.hair.min(0), found.hair.min(0))
    assert found.hair.mean(axis=1).min() < -1.5 < -0.4 < own.hair.mean(axis=1).min()


def test_the_coverage_tells_seen_from_unseen(scene: Scene, problem: Problem):
    found = refined(scene, problem)
    atlas = Atlas.build(scene.geometry, 64)
    assert found.coverage.shape == (64, 64, 3) and found.coverage.dtype == np.uint8
    assert set(np.unique(found.coverage[..., 0])) <= {0, BY_SYMMETRY, SEEN}
    assert not found.coverage[~atlas.skin].any()
    y, x = np.mgrid[:96, :96]
    surface = scene.forward.surface(
        scene.state, np.stack([x.ravel(), y.ravel()], 1) + 0.5, only_fitted=True
    )
    uvs = scene.forward.uvs(surface)
    shown = np.zeros((64, 64), int)
    np.add.at(
        shown,
        ((64 * (1 - uvs[:, 1])).astype(int).clip(0, 63), (64 * uvs[:, 0]).astype(int).clip(0, 63)),
        1,
    )
    seen = found.coverage[..., 0] == SEEN
    print(f"{seen[shown >= 3].mean():.2f} of the texels with three pixels or more are seen")
    assert seen[shown >= 3].mean() > 0.5 and seen[atlas.skin].mean() < 1
    basis = np.exp(atlas.bake(scene.forward.log_albedo(scene.state)))
    prior = (found.coverage[..., 0] == 0) & atlas.skin & (shown == 0)
    assert np.abs(np.log(found.textures.albedo[prior] / basis[prior])).max(initial=0.0) < 0.1


def test_teeth_that_the_photo_shows_on_fitted_lips_are_not_painted(scene: Scene, problem: Problem):
    """Lips that part where the fitted ones are shut: what is white between them is no skin."""
    landmarks, photo = problem.landmarks, problem.photograph
    ring = list(scheme_of(landmarks.scheme).openings[0])
    points = landmarks.points.copy()
    middle = points[ring].mean(axis=0)
    points[ring] = middle + (points[ring] - middle) * [0.8, 0.0]
    half = len(ring) // 2
    points[ring[1:half], 1] -= 5.0
    points[ring[half + 1 :], 1] += 5.0
    opened = replace(landmarks, points=points)
    between = opening_share((photo.mask.shape[0], photo.mask.shape[1]), opened)
    color = np.where(between[..., None] > 0, photo.color.max(), photo.color)
    given = replace(problem, landmarks=opened, photograph=replace(photo, color=color))
    shown = what_is_shown(given, scene.forward, at_truth(scene, problem))
    assert shown is not None
    column, row = shown.image.surface.pixels.astype(int).T
    inside, outside = between[row, column] == 1, between[row, column] == 0
    lips = lips_share((between.shape[0], between.shape[1]), opened)[row, column]
    np.testing.assert_array_equal(shown.lips, lips)
    mouth = mouth_share((between.shape[0], between.shape[1]), opened)[row, column] == 1
    assert lips.max() == 1.0 and mouth.sum() > 20 and not lips[mouth].any()
    print(f"{inside.sum()} pixels between the lips, weights up to {shown.clear[inside].max()}")
    assert inside.sum() > 20
    assert not shown.clear[inside].any() and shown.clear[outside].mean() > 0.5


def test_a_shadow_that_the_fit_lacks_is_lifted_from_skin_and_eyes(
    scene: Scene, problem: Problem, monkeypatch: pytest.MonkeyPatch
):
    photo, plain = problem.photograph, at_truth(scene, problem)
    monkeypatch.setattr(Problem, "paintable", problem.paintable)  # dark skin is skin
    shadowed = np.zeros(photo.mask.shape, bool)
    shadowed[:, :48] = True
    color = photo.color * np.where(shadowed, np.exp(-0.9), 1.0)[..., None]
    dark = replace(problem, photograph=replace(photo, color=color.astype(np.float32)))
    fitted = replace(plain, shadowed=shadowed)
    lit = what_is_shown(problem, scene.forward, plain)
    shown = what_is_shown(dark, scene.forward, fitted)
    assert lit is not None and shown is not None and not lit.lifted.any()
    column, row = shown.image.surface.pixels.astype(int).T
    change = np.log(shown.photo.mean(axis=1) / lit.photo.mean(axis=1))
    inside, outside = column < 40, column > 56
    print(f"{inside.sum()} pixels of 0.9 in shadow have {change[inside].mean():.3f} of it left")
    np.testing.assert_allclose(change[inside], -DARKER, atol=0.03)
    np.testing.assert_allclose(change[outside], 0.0, atol=1e-6)
    edge = np.abs(column - 47.5) < 1
    assert shown.doubt[edge].mean() > lit.doubt[edge].mean() + 0.3
    assert shown.doubt[inside].mean() > lit.doubt[inside].mean() + 0.1
    np.testing.assert_allclose(shown.clear[inside], lit.clear[inside], atol=0.02)
    black = replace(photo, color=np.where(shadowed[..., None], 0.1 * photo.color, photo.color))
    nothing = what_is_shown(replace(problem, photograph=black), scene.forward, fitted)
    assert nothing is not None and not nothing.clear[inside].any()
    looks: list[Look] = []

    def noted(forward: ForwardModel, state: State, stage: LightStage, look: Look, seed: int) -> Any:
        looks.append(look)
        return part_colors(forward, state, stage, look, seed)

    monkeypatch.setattr("facestage.fit.textures.refine.part_colors", noted)
    refine(dark, scene.forward, fitted)
    seen = np.log(looks[0].color[row, column] / photo.color[row, column]).mean(axis=1)
    np.testing.assert_allclose(seen[inside], -DARKER, atol=0.03)
    np.testing.assert_allclose(seen[outside], 0.0, atol=1e-6)


def test_a_beard_may_be_as_dark_as_a_brow(
    scene: Scene, problem: Problem, monkeypatch: pytest.MonkeyPatch
):
    photo = problem.photograph
    dark = replace(problem, photograph=replace(photo, color=0.2 * photo.color))
    fitted = at_truth(scene, problem)
    bare = what_is_shown(dark, scene.forward, fitted)
    share = np.tile(np.where(np.arange(96) < 48, 1.0, 0.0), (96, 1))
    monkeypatch.setattr(Problem, "beard", Beard(share, np.zeros(share.shape, bool)))
    shown = what_is_shown(replace(dark), scene.forward, fitted)  # which has looked for none yet
    assert bare is not None and shown is not None
    there = (shown.image.surface.pixels[:, 0] < 48) & (bare.feature < FEATURE_MAX)
    np.testing.assert_allclose(shown.feature[there], BROW_DEPARTURE, atol=0.1)
    np.testing.assert_array_equal(shown.feature[~there], bare.feature[~there])


def test_the_texture_s_size_follows_the_face():
    assert [texture_size(px) for px in (50, 170, 171, 342, 5000)] == [512, 512, 1024, 2048, 2048]


def test_textures_have_the_texels_that_were_asked_for_where_the_photo_has_them():
    assert texture_size(3000.0) == 2048
    photo = Job(Path("photo.png"))
    large, small = (USUAL.of(replace(photo, texture_size=size)) for size in (4096, 512))
    assert texture_size(3000.0, large) == 4096
    assert texture_size(300.0, large) == 1024
    assert texture_size(3000.0, small) == 512
    assert USUAL.of(photo) == USUAL
    assert USUAL.painted_face_px == pytest.approx(2048 / 3)
    assert large.painted_face_px == pytest.approx(4096 / 3)


def test_a_photo_is_painted_finer_than_it_was_fitted(scene: Scene, problem: Problem):
    wide = replace(SMALL, photo_pixels=100, face_px=24.0, texture_max=144)
    small = read_problem(problem.job, geometry=problem.geometry, fineness=wide)
    state = replace(scene.state, camera=small.camera)
    everywhere = np.ones(small.photograph.mask.shape, bool)
    fitted = replace(at_truth(scene, small), state=state, hidden=everywhere, shadowed=everywhere)
    finer, finely = finer_photo(small, fitted)
    ratio = finer.window.factor / small.window.factor
    assert ratio == pytest.approx(2.0, rel=0.05)
    assert finer.face_size_px == pytest.approx(ratio * small.face_size_px)
    assert finely.state.camera.focal_px == pytest.approx(ratio * state.camera.focal_px)
    assert finely.state.camera.width == finer.photograph.size[0]
    assert finely.hidden.shape == finer.photograph.mask.shape
    assert finely.hidden.all() and finely.shadowed.all() and not finely.dark.any()
    assert finer_photo(problem, fitted) == (problem, fitted)  # as large as the photo is


@pytest.mark.parametrize("lashes", [0.0, 0.5, 1.0])
def test_lids_are_read_beside_where_the_photo_shows_lashes(
    scene: Scene, problem: Problem, monkeypatch: pytest.MonkeyPatch, lashes: float
):
    """All of this face is lid, seen up to four pixels to the right, and all of that is dark."""
    photo = problem.photograph
    clipped = np.random.default_rng(0).uniform(size=photo.color.shape) < 0.5
    problem = replace(problem, photograph=replace(photo, color=0.2 * photo.color, clipped=clipped))
    fitted = at_truth(scene, problem)
    fitted.hidden[:, 50:] = True
    plain = what_is_shown(problem, scene.forward, fitted)
    monkeypatch.setattr(
        "facestage.fit.textures.shown.lids_beside",
        lambda pixels, *_: LidsBeside(
            np.full(pixels.shape, [4 * lashes, 0.0]), np.full(len(pixels), lashes)
        ),
    )
    shown = what_is_shown(problem, scene.forward, fitted)
    assert plain is not None and shown is not None
    column, row = shown.image.surface.pixels.astype(int).T
    beside = np.minimum(column + round(4 * lashes), problem.photograph.size[0] - 1)
    np.testing.assert_allclose(shown.photo, problem.photograph.color[row, beside], rtol=1e-6)
    np.testing.assert_array_equal(shown.clipped, clipped[row, beside])
    assert not shown.clear[beside >= 50].any() and shown.clear[beside == 49].any()
    dark = shown.photo.mean(axis=1) < 0.4 * shown.image.color.mean(axis=1)
    assert dark.any()
    assert (shown.feature[dark] >= LASH_DEPARTURE * lashes).all()
    assert lashes or np.array_equal(shown.feature, plain.feature)


def test_hair_where_the_fitted_part_ends_has_a_border(
    scene: Scene, problem: Problem, monkeypatch: pytest.MonkeyPatch
):
    """Hair that begins exactly where the face is no longer compared with the photo hides the rest
    of the head; a wall beside the head hides nothing.
    """
    low = np.flatnonzero(scene.model.uvs[:, 1] < 0.6).astype(np.int32)
    regions = {**scene.model.regions, "face": low}
    geometry = FaceGeometry(replace(scene.model, regions=regions), scene.geometry.relief_basis)
    forward = ForwardModel(geometry, scene.lights)
    row, column = np.mgrid[:96, :96]
    pixels = np.stack([column.ravel(), row.ravel()], axis=1) + 0.5

    def there(only_fitted: bool) -> np.ndarray:
        result = np.zeros((96, 96), bool)
        x, y = forward.surface(scene.state, pixels, only_fitted).pixels.astype(int).T
        result[y, x] = True
        return result

    part, head = there(True), there(False)
    hair, wall = head & ~part, ~head
    assert hair.sum() > 500 and wall.sum() > 500
    fitted = at_truth(scene, problem)

    def clear(hiding: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        monkeypatch.setattr(Problem, "paintable", np.where(hiding, 0.0, 1.0))
        shown = what_is_shown(replace(problem, geometry=geometry), forward, fitted)
        assert shown is not None
        x, y = shown.image.surface.pixels.astype(int).T
        return shown.clear, distance_transform_edt(~hair)[y, x]

    (plain, _), (beside_wall, _), (beside_hair, away) = (
        clear(each) for each in (np.zeros_like(wall), wall, hair)
    )
    np.testing.assert_array_equal(beside_wall, plain)
    width = border_width(problem.face_size_px)
    near, far = away <= width, away > 2 * width + 1
    assert plain[near].max() > 0.5
    assert not beside_hair[near].any()
    np.testing.assert_array_equal(beside_hair[far], plain[far])


def test_hair_that_only_the_light_tells_from_skin_is_not_painted(
    scene: Scene, problem: Problem, monkeypatch: pytest.MonkeyPatch
):
    """A dark strip beside hair is none of the face's."""
    photo, fitted = problem.photograph, at_truth(scene, problem)
    plain = what_is_shown(problem, scene.forward, fitted)
    assert plain is not None
    column, row = plain.image.surface.pixels.astype(int).T
    left = int(np.percentile(column, 10))
    inside = np.zeros(photo.mask.shape, bool)
    # Beside cheek and jaw, away from eyes and brows.
    inside[int(np.percentile(row, 55)) : int(np.percentile(row, 90)), left : left + 8] = True
    paint = problem.paintable.copy()
    paint[:, :left] = 0.0
    monkeypatch.setattr(Problem, "paintable", paint)
    color = np.where(inside[..., None], 0.3 * photo.color, photo.color)
    dark = replace(problem, photograph=replace(photo, color=color))
    bare, shown = (what_is_shown(each, scene.forward, fitted) for each in (problem, dark))
    assert bare is not None and shown is not None and not bare.hanging.any()
    strip = inside[row, column] & (column < left + 7)
    print(f"{strip.sum()} pixels of hair, clear before {bare.clear[strip].max():.2f}")
    assert strip.sum() > 50 and bare.clear[strip].max() > 0.9
    assert not shown.clear[strip].any() and shown.hanging[row, column][strip].all()
    far = column > left + 20
    np.testing.assert_array_equal(shown.clear[far], bare.clear[far])
    found = refine(dark, scene.forward, fitted).hanging
    assert found is not None
    np.testing.assert_array_equal(found, shown.hanging)

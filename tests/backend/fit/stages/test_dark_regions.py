"""Regions that are darker than light can leave them: found where there are some, and only there."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from facestage.contract.landmarks import Landmarks
from facestage.fit.given.beard import Beard
from facestage.fit.given.photo import Photo
from facestage.fit.given.problem import Problem
from facestage.fit.result.run import fit_job
from facestage.fit.stages.dark_regions import dark_regions, still_dark
from facestage.fit.stages.visible import VisiblePhoto
from facestage.fit.trust.checks import conclude
from facestage.fit.trust.fitted import Fitted
from reference.small_fit import QUICK
from reference.synthetic_case import Case, upper_third, write_case
from reference.synthetic_scene import Scene, moved


@pytest.fixture(scope="module")
def picture(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """What the scene shows, and where its face is."""
    return scene.render(samples=16)


def found_in(scene: Scene, photo: np.ndarray, **changes: Any) -> np.ndarray:
    """The dark regions of ``photo`` at the true face of mean skin, as a fit first looks at it."""
    state = moved(scene.state, albedo=-scene.state.albedo)
    term = scene.photo_term(photo, 4, **changes)
    return dark_regions(term, term.evaluate(state, 0), scene.lights)


def test_a_face_in_its_own_shadows_has_none(scene: Scene, picture: tuple[np.ndarray, np.ndarray]):
    photo, _ = picture
    assert not found_in(scene, photo).any()
    from_the_side = np.zeros((6, 3))
    from_the_side[3] = 9.0
    lit = replace(
        scene, state=replace(scene.state, lights=scene.lights.from_radiance(from_the_side))
    )
    assert not found_in(scene, lit.render(samples=16)[0]).any()


@pytest.mark.parametrize("level", [0.25, 0.4])
def test_the_shadow_of_something_is_found(
    scene: Scene, picture: tuple[np.ndarray, np.ndarray], level: float
):
    photo, seen = picture
    shadow = upper_third(seen)
    found = found_in(scene, np.where(shadow[..., None], level * photo, photo))
    share = {"found": found[shadow].mean(), "beside": found[seen & ~shadow].mean()}
    print(share)
    assert share["found"] > 0.7 and share["beside"] < 0.1


@pytest.mark.parametrize(
    "wrong",
    [
        pytest.param(lambda photo, shadow: 2.5 * photo, id="bright"),
        pytest.param(lambda photo, shadow: 0.85 * photo, id="a little darker"),
    ],
)
def test_what_is_bright_or_hardly_darker_stays(
    scene: Scene,
    picture: tuple[np.ndarray, np.ndarray],
    wrong: Callable[[np.ndarray, np.ndarray], np.ndarray],
):
    photo, seen = picture
    shadow = upper_third(seen)
    found = found_in(scene, np.where(shadow[..., None], wrong(photo, shadow), photo))
    assert not found[shadow].any()


def test_small_spots_are_left_to_the_weights(scene: Scene, picture: tuple[np.ndarray, np.ndarray]):
    photo, seen = picture
    y, x = np.mgrid[:96, :96]
    spot = np.hypot(y - 30, x - 48) < 3
    assert spot[seen].mean() < 0.02
    assert not found_in(scene, np.where(spot[..., None], 0.02 * photo, photo)).any()


@pytest.mark.parametrize(("contrast", "some"), [(0.1, True), (0.6, False)])
def test_where_all_of_the_face_is_off_a_region_has_to_be_off_by_more(
    scene: Scene, picture: tuple[np.ndarray, np.ndarray], contrast: float, some: bool
):
    photo, seen = picture
    y, x = np.mgrid[:96, :96]
    uneven = photo * np.exp(np.where((y // 3 + x // 3) % 2, contrast, -contrast))[..., None]
    shadow = upper_third(seen)
    found = found_in(scene, np.where(shadow[..., None], 0.35 * uneven, uneven))
    print(found[shadow].mean())
    assert found[shadow].any() == some


def test_what_is_nearly_all_of_a_face_is_no_region(
    scene: Scene, picture: tuple[np.ndarray, np.ndarray]
):
    """But light that is held, and that the photo contradicts."""
    photo, seen = picture
    term = scene.photo_term(np.where(upper_third(seen)[..., None], 0.2 * photo, photo), 4)
    evaluation = term.evaluate(scene.state, 0)
    bright = scene.lights.radiance(scene.state.lights)
    first = np.arange(6) == 3
    for factor, some in ((1.0, True), (8.0, False)):
        held = np.where(first[:, None], 0.0, factor * bright)
        found = dark_regions(
            term, evaluation, replace(scene.lights, fitted=first, fixed_radiance=held)
        )
        print(found.sum() / seen.sum())
        assert found.any() == some


def test_clipped_pixels_say_nothing(scene: Scene, picture: tuple[np.ndarray, np.ndarray]):
    photo, seen = picture
    shadow = upper_third(seen)
    dark = np.where(shadow[..., None], 0.3 * photo, photo)
    found = found_in(scene, dark, clipped=np.repeat(shadow[..., None], 3, axis=2))
    assert not found.any()


def test_lights_that_are_held_light_the_face_too(
    scene: Scene, picture: tuple[np.ndarray, np.ndarray]
):
    """With all of the light held, nothing can be said; with half of it, the same as before."""
    photo, seen = picture
    shadow = upper_third(seen)
    dark = np.where(shadow[..., None], 0.3 * photo, photo)
    state = moved(scene.state, albedo=-scene.state.albedo)
    term = scene.photo_term(dark, 4)
    evaluation = term.evaluate(state, 0)
    radiance = scene.lights.radiance(scene.state.lights)
    fitted = np.arange(6) % 2 == 0
    half = replace(
        scene.lights, fitted=fitted, fixed_radiance=np.where(fitted[:, None], 0.0, radiance)
    )
    found = dark_regions(term, evaluation, half)
    assert found[shadow].mean() > 0.7 and found[seen & ~shadow].mean() < 0.1
    held = replace(scene.lights, fitted=np.zeros(6, bool), fixed_radiance=radiance)
    assert not dark_regions(term, evaluation, held).any()


def darkened(scene: Scene, skin: np.ndarray) -> Any:
    """A problem of the scene's landmarks whose photo shows ``skin`` (96, 96)."""
    return SimpleNamespace(landmarks=scene.landmarks(), camera=scene.state.camera, skin=skin)


def test_dark_skin_below_the_middle_is_painted_as_a_beard_is(scene: Scene):
    problem = darkened(scene, np.zeros((96, 96)))
    landmarks = problem.landmarks
    visible = VisiblePhoto(problem)
    middle = landmarks.points.mean(axis=0)
    visible.dark = np.zeros((96, 96), bool)
    above, below = (int(middle[1] - 15), int(middle[0])), (int(middle[1] + 15), int(middle[0]))
    for row, column in (above, below):
        visible.dark[row - 3 : row + 4, column - 5 : column + 6] = True
    unpainted = visible.unpainted_at(96, 96, scene.state)
    assert unpainted[above] and not unpainted[below]
    assert visible.dark_at(96, 96)[below]
    half = visible.unpainted_at(48, 48, scene.state)
    assert half[above[0] // 2, above[1] // 2] and not half[below[0] // 2, below[1] // 2]
    # A head that lies on its side has its chin beside it.
    turned = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    points = landmarks.points[:, ::-1] * [1, -1] + [0, 96]
    problem.landmarks = Landmarks("ibug68", points, landmarks.visible)
    lying = replace(scene.state, rotation=turned @ scene.state.rotation)
    visible.dark = visible.dark.T[::-1]
    unpainted = visible.unpainted_at(96, 96, lying)
    assert unpainted[95 - above[1], above[0]] and not unpainted[95 - below[1], below[0]]


def test_a_beard_that_covers_the_skin_is_not_fitted(scene: Scene):
    """Nor is what hides the face, nor a shadow; and all three are painted, or not, as ever."""
    size = 48
    skin = Photo(np.ones((size, size, 3)), *np.ones((3, size, size), bool))
    problem = darkened(scene, np.ones((96, 96)))
    problem.photo_of = lambda width, height: skin
    problem.beard = Beard(np.zeros((96, 96)), np.zeros((96, 96), bool))
    visible = VisiblePhoto(problem)
    assert visible.of(size, size) is skin
    problem.beard.covers[60:80, 40:60] = True
    left = visible.of(size, size).skin
    assert not left[30:40, 20:30].any() and left.sum() == size**2 - 100
    visible.hidden = np.zeros((96, 96), bool)
    visible.hidden[:10] = True
    assert visible.of(size, size).skin.sum() == size**2 - 100 - 5 * size


def test_a_beard_that_meets_a_shadow_is_painted(scene: Scene):
    """Glasses, the shadow of the nose and a mustache, dark all the way."""
    problem = darkened(scene, np.zeros((96, 96)))
    visible = VisiblePhoto(problem)
    middle = problem.landmarks.points.mean(axis=0)
    row, column = int(middle[1]), int(middle[0])
    visible.dark = np.zeros((96, 96), bool)
    visible.dark[row - 20 : row + 13, column - 4 : column + 5] = True
    unpainted = visible.unpainted_at(96, 96, scene.state)
    assert unpainted[row - 15, column] and not unpainted[row + 10, column]


@pytest.mark.parametrize(("bare", "painted"), [(0.9, True), (0.6, False)])
def test_bare_skin_in_a_shadow_is_painted_and_what_lies_below_hair_is_not(
    scene: Scene, bare: float, painted: bool
):
    problem = darkened(scene, np.ones((96, 96)))
    visible = VisiblePhoto(problem)
    middle = problem.landmarks.points.mean(axis=0)
    row, column = int(middle[1]), int(middle[0])
    visible.dark = np.zeros((96, 96), bool)
    visible.dark[row - 25 : row - 5, column - 10 : column + 10] = True
    problem.skin[row - 25 : row - 5, column - 10 + round(20 * bare) : column + 10] = 0.0
    # Bare all over, below the middle.
    visible.dark[row + 10 : row + 15, column - 5 : column + 5] = True
    for size in (96, 48):
        above = visible.dark_at(size, size) & (np.arange(size)[:, None] < row * size // 96)
        nothing = np.zeros((size, size), bool)
        unpainted = visible.unpainted_at(size, size, scene.state)
        shadowed = visible.shadowed_at(size, size, scene.state)
        np.testing.assert_array_equal(shadowed, above if painted else nothing)
        np.testing.assert_array_equal(unpainted, nothing if painted else above)


@pytest.mark.parametrize("skin", [0.0, 1.0])
def test_a_beard_that_reaches_above_the_middle_is_one(scene: Scene, skin: float):
    problem = darkened(scene, np.full((96, 96), skin))
    visible = VisiblePhoto(problem)
    middle = problem.landmarks.points.mean(axis=0)
    row, column = int(middle[1]), int(middle[0])
    visible.dark = np.zeros((96, 96), bool)
    visible.dark[row - 6 : row + 15, column - 20 : column - 10] = True
    assert not visible.unpainted_at(96, 96, scene.state).any()
    assert not visible.shadowed_at(96, 96, scene.state).any()


def test_a_region_that_is_explained_by_now_counts_again(
    scene: Scene, picture: tuple[np.ndarray, np.ndarray]
):
    photo, seen = picture
    x = np.arange(96)[None]
    right, left = (upper_third(seen) & side & (abs(x - 48) > 3) for side in (x > 48, x <= 48))
    half = np.where(left[..., None], 0.4 * photo, photo)
    term = scene.photo_term(half, 4)
    found = still_dark(left | right, term, term.evaluate(scene.state, 0))
    assert found[left].all() and not found[right].any()


def test_a_fit_leaves_the_shadow_out_and_says_so(case: Case, scene: Scene, tmp_path: Path):
    shadowed = write_case(tmp_path, scene, shadow=0.5)
    plain, found = (
        fit_job(given.job(lights=6), tmp_path / name, fineness=QUICK)
        for name, given in (("plain", case), ("shadowed", shadowed))
    )
    words = [[entry["what"] for entry in result.left_out] for result in (plain, found)]
    assert [any("dark pixels" in what for what in entries) for entries in words] == [False, True]
    assert "in its shadow" in found.advice


def test_bare_skin_in_a_shadow_is_left_out_of_the_fit_too_and_said_so(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    shadowed = write_case(tmp_path, scene, shadow=0.5)
    monkeypatch.setattr(Problem, "skin", np.ones((96, 96)))
    ended: list[Fitted] = []

    def noted(*args: Any) -> Fitted:
        ended.append(conclude(*args))
        return ended[0]

    monkeypatch.setattr("facestage.fit.runs.driver.conclude", noted)
    found = fit_job(shadowed.job(lights=6), tmp_path / "out", fineness=QUICK)
    assert ended[0].shadowed.any() and not ended[0].hidden.any()
    share = re.search(r"(\d+)% of the face is behind something or in its shadow", found.advice)
    assert share is not None and 5 < int(share[1]) < 60

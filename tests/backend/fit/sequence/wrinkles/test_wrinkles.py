"""Folds that come with a slider are found in frames that are a little off; none where there is
none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from facestage.contract.landmarks import Landmarks
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.forward.surface_frame import FrameField, turned
from facestage.fit.sequence.actor import Actor
from facestage.fit.sequence.frames import Cut
from facestage.fit.sequence.wrinkles.alignment import aligned, at_rest, blurred, moved
from facestage.fit.sequence.wrinkles.folds import Folds, folds_of
from facestage.fit.sequence.wrinkles.groups import groups_of, telling_frames
from facestage.fit.sequence.wrinkles.sheets import Lattice, Sheet, sheet_of
from facestage.fit.sequence.wrinkles.solving import Fields, Moments, solved
from facestage.fit.sequence.wrinkles.wrinkles import Asked
from facestage.fit.textures.relief_maps.relief_evidence import difference
from facestage.images.image_io import Photograph
from facestage.render.variant import start_renderer
from reference.synthetic_scene import Scene, synthetic_scene

SIDE, SPACING, FRAMES = 120, 0.75, 16  # texels, mm
STRENGTH = 0.45 - 0.45 * np.cos(np.linspace(0, 4 * np.pi, FRAMES))


def trench() -> np.ndarray:
    """(SIDE, SIDE) mm: a fold of 1 mm, 24 mm long, at a slant."""
    y, x = SPACING * (np.indices((SIDE, SIDE)) - SIDE / 2)
    u, v = 0.6 * x + 0.8 * y, 0.8 * x - 0.6 * y
    return np.asarray(-np.exp(-0.5 * v**2 - (u / 12) ** 4))


def film(height: np.ndarray, off_mm: float, seed: int = 0) -> list[Sheet]:
    """Mottled skin under light that turns; frames are ``off_mm`` at full strength, and wrong by
    shading that comes with it.
    """
    rng = np.random.default_rng(seed)
    skin = 0.05 * gaussian_filter(rng.normal(size=(SIDE, SIDE)), 1.5) / 0.19
    shading = 0.04 * gaussian_filter(rng.normal(size=(SIDE, SIDE)), 3.0) / 0.094
    off = np.stack([gaussian_filter(rng.normal(size=(SIDE, SIDE)), 12) for _ in range(2)])
    off *= off_mm / SPACING / off.std()
    sheets = []
    for strength in STRENGTH:
        angle = 0.5 * rng.normal()
        slope = np.ones((2, SIDE, SIDE)) * np.array([np.cos(angle), np.sin(angle)])[:, None, None]
        slope = (slope / SPACING).astype(np.float32)
        shown = skin + strength * shading + 0.01 * rng.normal(size=(SIDE, SIDE))
        shown += strength * (slope[0] * difference(height, 1) + slope[1] * difference(height, 0))
        weight = np.full((SIDE, SIDE), 300.0, np.float32)
        sheet = Sheet(shown.astype(np.float32), weight, slope)
        sheets.append(moved(sheet, (strength * off).astype(np.float32)))
    return sheets


@pytest.mark.parametrize("width", [3.0, 13.0, 31.0, 50.0])
def test_a_wide_blur_is_that_of_all_texels(width: float) -> None:
    values = np.random.default_rng(1).random((157, 203)) ** 3
    values[:, 120:] = 0
    found, true = blurred(values, width), gaussian_filter(values, width, mode="mirror", truncate=5)
    assert found.shape == values.shape and found.dtype == np.float32
    assert np.abs(found - true).max() < 0.007
    assert np.sqrt(np.square(found - true).mean()) < 0.002


def found_in(sheets: list[Sheet]) -> tuple[Fields, Folds]:
    strength, everywhere = STRENGTH[None], np.ones((1, SIDE, SIDE))
    laid = aligned(sheets, strength, SPACING)
    fields = solved(Moments.of(laid, strength), everywhere, SPACING)
    return fields, folds_of(fields.height[0], everywhere[0] > 0, SPACING)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_fold_is_found_where_it_is_and_none_where_there_is_none(seed: int) -> None:
    true = trench()
    folds = found_in(film(true, 1.0, seed))[1]
    assert folds.are_clear and 0.3 < folds.depth < 1.2
    near = gaussian_filter((true < -0.1).astype(float), 4.0) > 0.05
    assert np.corrcoef(folds.height[near], true[near])[0, 1] > 0.5
    assert np.abs(folds.height[near]).sum() > 4 * np.abs(folds.height[~near]).sum()
    none = found_in(film(0 * true, 1.0, seed))[1]
    assert not none.are_clear and none.depth < 2 * none.noise


def test_a_bulge_is_no_fold() -> None:
    assert not found_in(film(-trench(), 0.0))[1].are_clear


def test_frames_are_laid_onto_those_at_rest() -> None:
    sheets = film(trench(), 1.0)
    before, after = sheets, aligned(sheets, STRENGTH[None], SPACING)
    off = []
    for each in (before, after):
        rest = at_rest(each, STRENGTH[None])
        strongest = each[int(STRENGTH.argmax())]
        away = (strongest.value - rest)[10:-10, 10:-10]
        off.append(float(away.std()))
    assert off[1] < 0.85 * off[0]


def test_the_depth_is_that_of_a_valley_of_any_direction() -> None:
    y, x = SPACING * (np.indices((SIDE, SIDE)) - SIDE / 2)
    for turn in (0.0, 0.4, 1.2, 2.0):
        across = np.cos(turn) * x + np.sin(turn) * y
        valley = -0.8 * np.exp(-0.5 * across**2)
        folds = folds_of(valley, np.ones_like(valley) > 0, SPACING)
        assert folds.depth == pytest.approx(0.8, rel=0.2)
        ridge = folds_of(-valley, np.ones_like(valley) > 0, SPACING)
        assert ridge.noise == pytest.approx(folds.depth) and not ridge.are_clear


@pytest.fixture(scope="module")
def scene() -> Scene:
    start_renderer("cpu")
    return synthetic_scene(side=240)


Photographed = Callable[[np.ndarray], Cut]


@pytest.fixture
def photographed(scene: Scene) -> Photographed:
    """Makes a photo of the scene with a ``height`` (size, size) in mm over the texture."""

    def make(height: np.ndarray) -> Cut:
        state, size = scene.state, len(height)
        y, x = np.mgrid[: state.camera.height, : state.camera.width]
        surface = scene.forward.surface(state, np.stack([x.ravel(), y.ravel()], 1) + 0.5)
        frames = FrameField.of(scene.geometry, surface.model_vertices)
        at = frames.at(surface.triangle, surface.weights)
        u, v = scene.forward.uvs(surface).T
        column, row = (size * u).astype(int) % size, (size * (1 - v)).astype(int) % size
        by_u = 1e-3 * size * difference(height, 1)[row, column]
        by_v = -1e-3 * size * difference(height, 0)[row, column]
        bent = turned(at.normals, at.slopes(by_u, by_v)) @ state.rotation.T
        surface = replace(surface, normals=bent)
        terms = scene.forward.light_terms(state, surface, scene.stage, 32, 7)
        color = np.zeros((*y.shape, 3), np.float32)
        column, row = surface.pixels.astype(int).T
        color[row, column] = scene.forward.shade(state, surface, terms).color
        mask, clipped = np.ones(y.shape, bool), np.zeros(color.shape, bool)
        return Cut.of(Photograph(color, mask, clipped), scene.landmarks(), 512.0)

    return make


def test_a_sheet_shows_what_a_height_does_to_the_light(
    scene: Scene, photographed: Photographed
) -> None:
    actor = Actor(scene.geometry, scene.forward, scene.stage, np.eye(4), scene.state)
    lattice = Lattice.of(scene.geometry, 256)
    rows, columns = np.indices((256, 256))
    wave = 7.0 / lattice.spacing  # texels
    height = 0.08 * np.sin(2 * np.pi * (columns + 0.5 * rows) / wave)
    flat, bent = (
        sheet_of(lattice, actor, photographed(each), scene.state) for each in (0 * height, height)
    )
    counts = np.minimum(flat.weight, bent.weight) > 50
    assert counts.sum() > 2000 and not (flat.weight > 0)[~lattice.skin].any()
    part = height[lattice.rows, lattice.columns]
    told = flat.slope[0] * difference(part, 1) + flat.slope[1] * difference(part, 0)
    change = (bent.value - flat.value)[counts]
    assert np.abs(flat.value[counts]).mean() < 0.02
    assert np.corrcoef(change, told[counts])[0, 1] > 0.85
    assert np.polyfit(told[counts], change, 1)[0] == pytest.approx(0.9, abs=0.25)


def test_groups_are_those_that_move_and_their_frames_the_strong_and_the_weak(scene: Scene) -> None:
    names = ("mouthSmile_L", "browInnerUp_L", "browInnerUp_R")
    model = replace(scene.model, expression_names=names)
    geometry = FaceGeometry(model, scene.geometry.relief_basis)
    course, seen = np.zeros((200, 3)), np.arange(0, 200, 2)
    course[:, 0] = 0.05
    course[60:90, 1:] = 0.8
    (group,) = groups_of(geometry, course, seen)
    assert group.name == "raise" and group.sliders == names[1:]
    np.testing.assert_allclose(group.strength, course[:, 1])
    assert group.place.max() == 1.0 and group.place.min() < 1e-6
    frames = telling_frames([group], seen, 10)
    assert len(frames) == 10 and set(frames) <= set(seen)
    assert ((frames >= 60) & (frames < 90)).sum() == 5
    np.testing.assert_array_equal(telling_frames([group], seen[:9], 10), seen[:9])
    own = _larger(scene.landmarks(), 4.0)
    landmarks = [own if place in seen else None for place in range(200)]
    asked = Asked.of(geometry, course, landmarks)
    assert asked.groups and set(asked.frames) <= set(seen)
    small = [None if one is None else _larger(one, 0.1) for one in landmarks]
    assert "pixels long" in Asked.of(geometry, course, small).words
    assert "far enough" in Asked.of(geometry, 0 * course, landmarks).words


def _larger(landmarks: Landmarks, times: float) -> Landmarks:
    return replace(landmarks, points=times * landmarks.points)

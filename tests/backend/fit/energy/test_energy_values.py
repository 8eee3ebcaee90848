"""What a pixel counts for and what the photo costs, in numbers done by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_erosion

from facestage.fit.energy.noise import NoiseModel
from facestage.fit.energy.photo_term import PhotoTerm, common_energy
from facestage.fit.energy.plan import Ledger, Work
from reference.synthetic_scene import Scene, plain_photo


@pytest.fixture(scope="module")
def term(scene: Scene) -> PhotoTerm:
    photo = plain_photo(scene.render(samples=4)[0])
    skin = np.random.default_rng(0).uniform(0.2, 1, photo.usable.shape)
    return PhotoTerm(scene.forward, replace(photo, skin=skin), scene.stage, 2)


def test_a_pixel_counts_by_its_skin_and_by_how_the_surface_faces(scene: Scene, term: PhotoTerm):
    found = term.evaluate(scene.state, 1)
    y, x = np.mgrid[:96, :96]
    surface = scene.forward.surface(
        scene.state, np.stack([x.ravel(), y.ravel()], 1) + 0.5, only_fitted=True
    )
    column, row = surface.pixels.astype(int).T
    seen, cosine = np.zeros((96, 96), bool), np.zeros((96, 96))
    seen[row, column], cosine[row, column] = True, -(surface.normals * surface.rays).sum(axis=1)
    wanted = np.clip((cosine - 0.15) / 0.3, 0, 1) * term.photo.skin * binary_erosion(seen)
    np.testing.assert_allclose(found.base_weight, wanted, atol=1e-9)
    assert 0 < (wanted > 0).sum() < seen.sum()


def test_a_clipped_channel_is_at_least_as_bright_and_a_highlight_is_its_specular_part(
    scene: Scene, term: PhotoTerm
):
    plain = term.evaluate(scene.state, 1)
    clipped = np.zeros((96, 96, 3), bool)
    clipped[:, 40:, 1] = True
    half = replace(term, photo=replace(term.photo, clipped=clipped)).evaluate(scene.state, 1)
    wanted = np.where(clipped & (plain.residual > 0), 0.0, plain.residual)
    np.testing.assert_array_equal(half.residual, wanted)
    assert (wanted != plain.residual).any()
    row, column = term.index(plain.image.surface)
    gloss = plain.image.c_spec * plain.image.specular.mean(axis=1)
    np.testing.assert_allclose(plain.highlight[row, column, 0], gloss)


def test_a_fit_is_judged_by_what_is_the_face_s_own(scene: Scene, term: PhotoTerm):
    """A white hat that counts a fifth as much as skin says nothing of how well it is explained."""
    plain = term.evaluate(scene.state, 1)
    hat = np.broadcast_to(np.arange(96)[:, None] < 40, (96, 96))
    skin = np.where(hat, 0.2, 1.0)
    photo = replace(term.photo, skin=skin, color=np.where(hat[..., None], 5.0, term.photo.color))
    found = replace(term, photo=photo).evaluate(scene.state, 1)
    face = replace(term, photo=replace(term.photo, skin=np.where(hat, 0.0, 1.0)))
    assert found.rms == face.evaluate(scene.state, 1).rms
    assert not found.counted[hat].any() and (found.base_weight[hat] > 0).any()
    np.testing.assert_array_equal(plain.counted, plain.base_weight > 0.5)


def test_weights_are_inverse_variances_times_what_each_pixel_says(scene: Scene, term: PhotoTerm):
    found = term.evaluate(scene.state, 1)
    noise = NoiseModel(0.1, 10.0, 0.05, np.full((96, 96), 2.0))
    row, column = (int(each[len(each) // 2]) for each in term.index(found.image.surface))
    residual, photo = found.residual[row, column], term.photo.color[row, column]
    level = (photo + 0.5 * residual).mean() + 0.05
    scale = 2.0 * (0.1 * level + 0.1 * found.highlight[row, column, 0])
    robust = 1 / (1 + ((residual / scale) ** 2).mean() / 2.5**2)
    wanted = 0.7 / 30 * found.base_weight[row, column] * robust / scale**2
    assert replace(term, weight=0.7).weights(found, noise)[row, column] == pytest.approx(wanted)


def test_two_evaluations_are_compared_where_both_see_the_face(scene: Scene, term: PhotoTerm):
    old = term.evaluate(scene.state, 1)
    new = replace(
        old, residual=old.residual + 0.1, base_weight=old.base_weight * (np.arange(96) > 40)
    )
    weights = np.full((96, 96), 3.0)
    both = (old.base_weight > 0) & (np.arange(96) > 40)
    found = common_energy(old, new, weights)
    assert found[0] == pytest.approx(1.5 * (old.residual[both] ** 2).sum())
    assert found[1] == pytest.approx(1.5 * ((old.residual[both] + 0.1) ** 2).sum())


def test_the_noise_is_that_of_pixels_that_count_for_half(scene: Scene, term: PhotoTerm):
    found = term.evaluate(scene.state, 1)
    wild = np.where(found.base_weight[..., None] > 0.5, found.residual, 9.0)
    assert term.noise(replace(found, residual=wild)).sigma == term.noise(found).sigma
    wild = np.where(found.base_weight[..., None] > 0.4, 9.0, found.residual)
    assert term.noise(replace(found, residual=wild)).sigma > term.noise(found).sigma


def test_the_ledger_times_what_was_done_and_says_nothing_of_what_was_not():
    ledger = Ledger({"rays": Work(2.0, 0.0), "cells": Work(0.0, 5.0)})
    assert (
        ledger.rate("rays") is None
        and ledger.rate("cells") is None
        and ledger.rate("lines") is None
    )
    with ledger.timed(lit=1):
        pass
    with ledger.timed(lit=2):
        pass
    assert ledger.work["lit"].units == 3 and 0 < ledger.work["lit"].seconds < 60
    ledger.skip("pixels", lit=2)
    ledger.skip("pixels", lit=3)
    assert ledger.skipped == {("pixels", "lit"): 5.0}
    assert ledger.saved("lights") == {}
    ledger.skip("pixels", rays=7)
    assert ledger.saved("pixels")["rays"] == (7.0, None)

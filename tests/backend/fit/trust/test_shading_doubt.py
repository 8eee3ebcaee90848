"""The doubt of the shading, against parameters drawn from the covariance and rendered."""

from __future__ import annotations

import numpy as np

from facestage.contract import brdf
from facestage.fit.energy.noise import HIGHLIGHT_SHARE
from facestage.fit.energy.photo_term import PhotoTerm
from facestage.fit.face.layout import Layout
from facestage.fit.trust.shading_doubt import DOUBT_MAX, shading_doubt
from reference.synthetic_scene import Scene, plain_photo

DRAWS = 150


def test_the_deviation_of_drawn_shapes_is_the_doubt(scene: Scene):
    photo = plain_photo(scene.render(samples=4)[0])
    term, layout = PhotoTerm(scene.forward, photo, scene.stage, 8), Layout(scene.state)
    evaluation = term.evaluate(scene.state, 3)
    covariance = np.zeros((layout.size, layout.size))
    where = layout.slices["identity"]
    covariance[where, where] = 0.02**2 * np.eye(where.stop - where.start)
    doubt = shading_doubt(scene.forward, evaluation, layout, covariance)
    assert (doubt[evaluation.base_weight == 0] == DOUBT_MAX).any()

    random = np.random.default_rng(5)
    first = evaluation.image
    x, y = first.surface.pixels.astype(int).T
    colors = []
    for _ in range(DRAWS):
        step = np.zeros(layout.size)
        step[where] = 0.02 * random.normal(size=where.stop - where.start)
        trial = term.evaluate(layout.apply(scene.state, step), 3)
        color = np.full((*photo.usable.shape, 3), np.nan)
        column, row = trial.image.surface.pixels.astype(int).T
        color[row, column] = trial.image.color
        colors.append(color[y, x])
    spread = np.sqrt(np.nanvar(np.array(colors), axis=0).mean(axis=1))
    diffuse = brdf.K_DIFFUSE / np.pi * (first.albedo * first.diffuse).mean(axis=1)
    gloss = HIGHLIGHT_SHARE * brdf.K_SPECULAR * first.c_spec * first.specular.mean(axis=1)
    wanted = np.sqrt(spread**2 + gloss**2) / diffuse
    # Where a shadow's edge moves the derivative does not see it: the middle half must agree.
    ratio = doubt[y, x] / wanted
    print(
        f"doubt over drawn spread, quartiles {np.percentile(ratio, [25, 50, 75]).round(2)} (1 "
        "is right)"
    )
    assert np.percentile(ratio, 25) > 0.85 and np.percentile(ratio, 75) < 1.15


def test_without_a_free_shape_only_highlights_are_in_doubt(scene: Scene):
    photo = plain_photo(scene.render(samples=4)[0])
    layout = Layout(scene.state)
    evaluation = PhotoTerm(scene.forward, photo, scene.stage, 4).evaluate(scene.state, 3)
    image = evaluation.image
    doubt = shading_doubt(scene.forward, evaluation, layout, np.zeros((layout.size, layout.size)))
    x, y = image.surface.pixels.astype(int).T
    diffuse = brdf.K_DIFFUSE / np.pi * (image.albedo * image.diffuse).mean(axis=1)
    gloss = HIGHLIGHT_SHARE * brdf.K_SPECULAR * image.c_spec * image.specular.mean(axis=1)
    np.testing.assert_allclose(
        doubt[y, x], np.minimum(gloss / diffuse, DOUBT_MAX), rtol=1e-5, atol=1e-9
    )

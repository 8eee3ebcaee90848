from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from backend.report.example import report_data
from facestage.contract.certainty import nice_limit
from facestage.contract.errors import InputError
from facestage.contract.result import BY_SYMMETRY, SEEN
from facestage.report.pictures import (
    View,
    difference_limit,
    draw_colors,
    draw_coverage,
    draw_faces,
    landmark_distances,
)


def test_identical_images_differ_by_nothing() -> None:
    data = report_data()
    difference = View.of(report_data(render=data.photo)).difference()
    assert difference.count() == data.coverage.sum()
    assert np.abs(difference.compressed()).max() == 0.0
    assert difference_limit(difference) == 0.01


def test_the_difference_is_signed_and_covers_only_fitted_finite_pixels() -> None:
    data = report_data()
    photo = data.photo.copy()
    row, column = np.argwhere(data.coverage)[0]
    photo[row, column, 1] = np.nan
    difference = View.of(report_data(photo=photo, render=np.zeros_like(photo))).difference()
    assert difference.mask[row, column]
    assert difference.count() == data.coverage.sum() - 1
    assert difference.max() < 0.0


def test_the_fit_replaces_the_photo_where_it_was_rendered(tmp_path: Path) -> None:
    render = np.zeros((48, 40, 3))
    coverage = np.zeros((48, 40), bool)
    coverage[20:30, 15:25] = True
    render[coverage] = 0.5
    alpha = coverage.astype(np.float32)
    view = View.of(report_data(render=render, coverage=coverage, alpha=alpha))
    draw_faces(tmp_path, view)
    rows, columns = view.crop()
    with Image.open(tmp_path / "face.png") as image:
        face = np.asarray(image)
    with Image.open(tmp_path / "face_photo.png") as image:
        photo = np.asarray(image)
    inside = coverage[rows, columns]
    assert face.shape == photo.shape == (*inside.shape, 3)
    assert inside.sum() == 100 and not inside.all()
    assert (face[inside] == 188).all()
    np.testing.assert_array_equal(face[~inside], photo[~inside])


def test_at_the_heads_outline_a_pixel_is_fit_and_photo_by_what_each_covers() -> None:
    head, white = np.array([0.4, 0.2, 0.1]), np.ones((48, 40, 3))
    alpha = np.zeros((48, 40))
    alpha[:, 10:], alpha[:, 10] = 1.0, 0.25  # of a quarter of column 10 the head is all that shows
    data = report_data(photo=white, render=alpha[..., None] * head, alpha=alpha)
    shown = View.of(data).composite()
    np.testing.assert_allclose(shown[:, :10], 1.0)
    np.testing.assert_allclose(shown[:, 10], np.tile(0.25 * head + 0.75, (48, 1)), rtol=1e-6)
    np.testing.assert_allclose(shown[:, 11:], np.tile(head, (48, 29, 1)), rtol=1e-6)


def test_texels_of_which_the_photo_says_nothing_are_faded(tmp_path: Path) -> None:
    coverage = np.zeros((16, 16, 3), np.uint8)
    coverage[:4, :, 0], coverage[4:8, :, 0] = SEEN, BY_SYMMETRY
    draw_colors(tmp_path / "albedo.png", np.full((16, 16, 3), 0.5), coverage)
    with Image.open(tmp_path / "albedo.png") as image:
        pixels = np.asarray(image)
    assert (pixels[:8] == 188).all()
    assert (pixels[8:] == 108).all()  # sRGB of 0.15


def test_landmark_distances_are_of_visible_finite_points() -> None:
    data = report_data()
    assert data.projected.dtype == float
    data.projected[1] = np.nan
    distances = landmark_distances(data)
    assert len(distances) == data.visible.sum() - 1
    np.testing.assert_allclose(distances, 5.0)


@pytest.mark.parametrize(
    ("value", "limit"), [(0.0, 0.01), (0.01, 0.01), (0.011, 0.02), (0.03, 0.05), (0.7, 1.0), (3, 5)]
)
def test_limits_are_round_numbers(value: float, limit: float) -> None:
    assert nice_limit(value, 0.01) == pytest.approx(limit)


def test_arrays_that_do_not_belong_together_are_refused() -> None:
    with pytest.raises(InputError, match=r"coverage has shape \(3, 3\), expected \(48, 40\)"):
        report_data(coverage=np.ones((3, 3), bool))


@pytest.mark.parametrize("times", [1, 100])
def test_each_origin_of_a_texel_has_its_color(tmp_path: Path, times: int) -> None:
    coverage = np.zeros((16 * times, 16 * times, 3), np.uint8)
    coverage[:, : 5 * times, 0], coverage[:, 5 * times : 10 * times, 0] = SEEN, BY_SYMMETRY
    draw_coverage(tmp_path / "coverage.png", coverage)
    with Image.open(tmp_path / "coverage.png") as image:
        pixels = np.asarray(image.convert("RGB")).astype(int)
    height, width = pixels.shape[:2]
    row = pixels[height // 2]
    seen, mirrored, model = (row[int(share * width)] for share in (0.15, 0.45, 0.85))
    assert seen[0] > seen[2] + 50 and mirrored[2] > mirrored[0] + 50 and model.max() < 70

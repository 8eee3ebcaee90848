"""The flesh in the corners of the eye fills what was a pit, and lids close over it."""

from functools import cache

import numpy as np
import pytest

from facestage.contract.face_model import EYES, SKIN, FaceModel
from facestage.models.head.assemble import HeadMesh, assemble
from facestage.models.head.default_head import build_default_model
from facestage.models.head.eyes import MARGIN
from facestage.models.head.features import EYE_CENTER
from reference.rendering.intersect import first_hits

MM = 1e-3


@cache
def model() -> FaceModel:
    return build_default_model()


@cache
def mesh() -> HeadMesh:
    return assemble()


def shape(**weights: float) -> np.ndarray:
    """(n, 3) mm of the head with an expression of both eyes."""
    both = {f"{name}{side}": w for name, w in weights.items() for side in ("Left", "Right")}
    expression = np.zeros(len(model().expression_names))
    for name, weight in both.items():
        expression[model().expression_names.index(name)] = weight
    return model().shape(None, expression) / MM


def lid_columns(side: str, corner: str) -> list[tuple[int, int]]:
    """Columns of upper and lower lid across from each other, from the inner or outer corner on."""
    n = mesh().loops[f"eye_{side}"].shape[1]
    start = 0 if (side == "left") == (corner == "inner") else n // 2
    step = -1 if start == 0 else 1
    return [((start + step * k) % n, (start - step * k) % n) for k in range(n // 2)]


def seen_from_front(
    vertices: np.ndarray, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What a ray straight from the front through each of the points (m, 3) meets first: its part,
    how far behind the point, mm, and how white its mean albedo is (green over red).
    """
    triangles, part = model().triangles, model().triangle_part
    near = np.abs(vertices[triangles].mean(axis=1) - points.mean(axis=0)).max(axis=1) < 16.0
    triangles, part = triangles[near], part[near]
    start = points + np.array([0.0, 0.0, 30.0])
    towards = np.tile([0.0, 0.0, -1.0], (len(points), 1))
    hit, weights, distance = first_hits(start, towards, vertices, triangles)
    color = np.einsum("pi,pic->pc", weights, model().albedo_mean[triangles[hit]])
    return np.where(hit >= 0, part[hit], 255), distance - 30.0, color[:, 1] / color[:, 0]


def opening(vertices: np.ndarray, side: str, corner: str, reach: float) -> np.ndarray:
    """(m, 3) points between the margins of the lids, up to ``reach`` mm from the corner."""
    loop = mesh().loops[f"eye_{side}"][MARGIN]
    columns = lid_columns(side, corner)
    above = vertices[loop[[upper for upper, _ in columns]]]
    below = vertices[loop[[lower for _, lower in columns]]]
    away = np.abs(0.5 * (above + below) - vertices[loop[columns[0][0]]])[:, 0]
    at = np.linspace(0.3, reach, 12)
    ends = [
        np.stack([np.interp(at, away, end[:, axis]) for axis in range(3)], axis=-1)
        for end in (above, below)
    ]
    ways = np.array([0.15, 0.3, 0.5, 0.7, 0.85])[:, None, None]
    return (ends[0] + ways * (ends[1] - ends[0])).reshape(-1, 3)


@pytest.mark.parametrize("expression", [{}, {"eyeWide": 1.0}])
@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize(("corner", "reach", "deep"), [("inner", 6.0, 2.2), ("outer", 2.0, 2.0)])
def test_no_pit_lies_in_the_corners_of_the_eyes(corner, reach, deep, side, expression):
    """Where the lids' margins part, up to where the eyeball comes forward."""
    vertices = shape(**expression)
    part, depth, _ = seen_from_front(vertices, opening(vertices, side, corner, reach))
    assert set(part) <= {SKIN, EYES}
    assert depth.max() < deep


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_caruncle_is_red_and_goes_over_into_the_white(side):
    """Within 3 to 5 mm, of an opening of 28.7."""
    vertices = shape()
    loops = mesh().loops[f"eye_{side}"]
    corner = vertices[loops[MARGIN, lid_columns(side, "inner")[0][0]]]
    points = opening(vertices, side, "inner", 8.0)
    part, _, white = seen_from_front(vertices, points)
    middle = slice(2 * 12, 3 * 12)  # half-way between the lids
    away, white, part = np.abs(points[:, 0] - corner[0])[middle], white[middle], part[middle]
    assert white[(away > 0.5) & (away < 2.5)].max() < 0.6
    assert white[away > 5.0].min() > 0.75
    assert (part[away > 5.6] == EYES).all()


@pytest.mark.parametrize("expression", [{"eyeBlink": 1.0}, {"eyeBlink": 0.5}, {"eyeWide": 1.0}])
def test_lids_slide_over_the_flesh_that_stays(expression):
    moved = shape(**expression) - shape()
    for side in ("left", "right"):
        loops = mesh().loops[f"eye_{side}"]
        upper = [column for column, _ in lid_columns(side, "inner")[1:4]]
        flesh, margin = loops[MARGIN + 1 :][:, upper], loops[MARGIN, upper]
        assert np.abs(moved[flesh]).max() < 0.1
        assert np.linalg.norm(moved[margin], axis=1).max() > 0.4


def test_shut_lids_hide_the_flesh():
    vertices = shape(eyeBlink=1.0)
    triangles = model().triangles[model().triangle_part == SKIN]
    for side in ("left", "right"):
        loops = mesh().loops[f"eye_{side}"]
        upper = [column for column, _ in lid_columns(side, "inner")[1:6]]
        flesh = vertices[loops[MARGIN + 1 :][:, upper]].reshape(-1, 3)
        bare = triangles[~np.isin(triangles, loops[MARGIN + 1 :]).any(axis=1)]
        bare = bare[np.abs(vertices[bare].mean(axis=1) - flesh.mean(axis=0)).max(axis=1) < 20.0]
        start = flesh + np.array([0.0, 0.0, 30.0])
        towards = np.tile([0.0, 0.0, -1.0], (len(flesh), 1))
        hit, _, distance = first_hits(start, towards, vertices, bare)
        assert (hit >= 0).all()
        assert (distance < 30.0).all()


@pytest.mark.parametrize("blink", [0.0, 0.4, 0.5, 0.8])
def test_the_eyeball_never_comes_through_the_fold_of_the_lid(blink):
    vertices = shape(eyeBlink=blink)
    for side in ("left", "right"):
        loop = mesh().loops[f"eye_{side}"][MARGIN]
        n = len(loop)
        upper = vertices[loop[n // 2 + 2 : n - 1]]
        at = np.linspace(0, len(upper) - 1, 70)
        upper = np.stack([np.interp(at, np.arange(len(upper)), each) for each in upper.T], axis=-1)
        above = np.arange(1.0, 6.0, 0.25)[:, None, None] * np.array([0.0, 1.0, 0.0])
        part, _, _ = seen_from_front(vertices, (upper + above).reshape(-1, 3))
        assert (part == SKIN).all()


def test_both_eyes_are_mirror_images():
    vertices = model().vertices.astype(float) / MM
    left, right = mesh().loops["eye_left"], mesh().loops["eye_right"]
    n = left.shape[1]
    order = (n // 2 - np.arange(n)) % n
    np.testing.assert_allclose(vertices[right], vertices[left[:, order]] * [-1, 1, 1], atol=0.01)
    assert EYE_CENTER[0] > 0

"""A reflectance field: nothing of a map's light is lost, and it comes from where it came from."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from facestage.contract.environment import directions
from facestage.contract.errors import InputError
from facestage.contract.events import Event
from facestage.contract.reflectance import FILE, ReflectanceField
from facestage.fit.result.reflectance import (
    RADIUS,
    distant_lights,
    make_field,
    relit_by_map,
    resampled,
    shares,
    solid_angles,
)

COUNT = 60
SPACING = np.sqrt(4 * np.pi / COUNT)  # radians from direction to direction, about


def test_solid_angles_are_the_whole_sphere():
    for count in (12, COUNT, 400):
        angles = solid_angles(-distant_lights(count).direction)
        assert angles.sum() == pytest.approx(4 * np.pi)
        assert np.abs(angles * count / (4 * np.pi) - 1).max() < 0.35


def test_lights_cover_their_solid_angles():
    stage = distant_lights(COUNT)
    # Of a small square, side^2 / R^2; of these, to a few per cent.
    seen = (stage.side / RADIUS) ** 2
    assert np.allclose(seen, solid_angles(-stage.direction), rtol=0.1)
    np.testing.assert_allclose(np.linalg.norm(stage.position, axis=1), RADIUS)


@pytest.mark.parametrize(("row", "column", "degrees"), [(20, 9, 0.0), (3, 100, 75.0), (63, 0, -9)])
def test_one_bright_spot_keeps_its_strength_and_its_place(row: int, column: int, degrees: float):
    towards = -distant_lights(COUNT).direction
    picture = np.zeros((64, 128, 3))
    picture[row, column] = (1.0, 2.0, 3.0)
    found = shares(towards, picture, degrees)
    edges = np.sin(np.pi * (0.5 - np.arange(65) / 64))
    angle = (edges[row] - edges[row + 1]) * 2 * np.pi / 128
    np.testing.assert_allclose(found.sum(axis=0), angle * np.array([1.0, 2.0, 3.0]))
    assert (found >= 0).all() and np.count_nonzero(found[:, 0]) <= 3
    middle = found[:, 0] @ towards
    place = directions(64, 128, degrees)[row, column]
    assert middle @ place / np.linalg.norm(middle) > np.cos(1e-3)
    assert np.linalg.norm(middle) / angle > np.cos(SPACING)


def test_a_large_map_is_reduced_without_loss():
    rng = np.random.default_rng(0)
    picture = rng.random((512, 1024, 3)).astype(np.float32) - 0.1
    small = resampled(picture)
    assert small.shape == (256, 512, 3) and (small >= 0).all()
    towards = -distant_lights(COUNT).direction
    whole = shares(towards, np.maximum(picture, 0), 0.0)
    np.testing.assert_allclose(shares(towards, small, 0.0), whole, rtol=0.01)


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The result of a quick fit."""
    from facestage.fit.result.run import fit_job
    from facestage.render.variant import start_renderer
    from reference.small_fit import QUICK
    from reference.synthetic_case import write_case
    from reference.synthetic_scene import synthetic_scene

    start_renderer("cpu")
    folder = tmp_path_factory.mktemp("reflectance")
    case = write_case(folder, synthetic_scene())
    fit_job(case.job(), folder / "result", fineness=QUICK)
    return folder / "result"


@pytest.fixture(scope="module")
def field(result: Path) -> ReflectanceField:
    events: list[Event] = []
    make_field(result, result.parent / "field", COUNT, 4, events.append)
    assert [events[0].kind, events[-1].kind] == ["started", "done"]
    assert len(events) == COUNT + 2
    return ReflectanceField.load(result.parent / "field")


def sky(height: int = 64) -> np.ndarray:
    """Blue from above, red from one side."""
    towards = directions(height, 2 * height)
    above, side = np.maximum(towards[..., 1], 0), np.maximum(towards[..., 0], 0) ** 4
    return np.stack([0.2 + 4 * side, 0.2 + above, 0.2 + 2 * above], axis=-1)


def test_the_sum_of_all_pictures_is_the_picture_under_light_from_everywhere(
    field: ReflectanceField,
):
    from facestage.images.image_io import read_exr

    assert field.folder is not None
    images = [read_exr(field.folder / name) for name in field.images]
    assert min(image.max() for image in images) >= 0 and max(map(np.max, images)) > 0
    white = relit_by_map(field, np.ones((16, 32, 3)))
    np.testing.assert_allclose(white, np.sum(images, axis=0), rtol=1e-4, atol=1e-6)


def test_relit_by_the_field_is_as_traced_under_the_map(field: ReflectanceField, result: Path):
    from facestage.contract.result import Result
    from facestage.fit.result.surroundings import under_map

    for degrees in (0.0, 130.0):
        relit = relit_by_map(field, sky(), degrees)
        traced = under_map(Result.load(result), sky(), degrees, 16)
        face = (traced > 0).all(axis=2)
        assert np.array_equal((relit > 0).any(axis=2), (traced > 0).any(axis=2))
        off = np.sqrt(((relit - traced)[face] ** 2).mean()) / traced[face].mean()
        print(f"the field against traced, turned by {degrees}: {100 * off:.1f} % of the mean")
        assert off < 0.06
    assert np.abs(relit_by_map(field, sky(), 0.0) - relit).max() > 0.1  # the turn counts


def test_a_field_replaces_a_field_and_nothing_else(result: Path, tmp_path: Path):
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "notes.txt").touch()
    with pytest.raises(InputError, match="is not a reflectance field"):
        make_field(result, mine, COUNT, 4)
    for count in (11, 13, 4096):
        with pytest.raises(InputError, match=f"--directions is {count}"):
            make_field(result, tmp_path / "new", count, 4)
    with pytest.raises(InputError, match="--spp is 0"):
        make_field(result, tmp_path / "new", COUNT, 0)
    assert not (tmp_path / "new").exists()
    make_field(result, tmp_path / "new", 24, 1)
    (tmp_path / "new" / "notes.txt").touch()
    make_field(result, tmp_path / "new", 12, 1)
    assert {path.name for path in (tmp_path / "new").iterdir()} == {
        FILE,
        "notes.txt",
        *(f"light-{number:04d}.exr" for number in range(1, 13)),
    }

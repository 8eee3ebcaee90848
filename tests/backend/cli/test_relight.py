"""Relighting from the cache: the same picture as tracing, and never one of another face or
stage.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from facestage import cli
from facestage.contract.folds import PLACES, Folds
from facestage.contract.light_stage import OFF
from facestage.contract.relight_cache import RELIGHT_CACHE, RelightCache
from facestage.contract.result import Result
from facestage.contract.texture_maps import FOLD_MAP
from facestage.fit.result import relight
from facestage.images.image_io import read_exr, write_exr
from reference.command_line import Finished, refuse, write

HALF = 1.2e-3  # two roundings to half floats: the cache's and the EXR's


@pytest.fixture
def folder(finished: Finished, tmp_path: Path) -> Path:
    """A copy of the finished result that a test may change."""
    return Path(shutil.copytree(finished[0], tmp_path / "result"))


@pytest.fixture
def radiance(folder: Path) -> np.ndarray:
    return np.random.default_rng(2).uniform(0.5, 9, (len(Result.load(folder).stage), 3))


@pytest.fixture
def render(tmp_path: Path) -> Callable[..., np.ndarray]:
    """Run ``facestage render`` under a radiance and read its picture."""

    def run(folder: Path, radiance: np.ndarray, *extra: str) -> np.ndarray:
        lights = write(tmp_path / "lights.json", json.dumps({"radiance": radiance.tolist()}))
        out = tmp_path / "relit.exr"
        arguments = ["render", folder, "--lights", lights, "--out", out, *extra]
        assert cli.main([str(argument) for argument in arguments]) == 0
        return read_exr(out)

    return run


def traced(folder: Path, radiance: np.ndarray, samples: int) -> np.ndarray:
    result = Result.load(folder)
    return relight.render(replace(result, stage=replace(result.stage, radiance=radiance)), samples)


def worst(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.abs(one - other).max() / other.max())


def test_a_fit_leaves_a_cache_of_its_own_picture(folder: Path):
    result = Result.load(folder)
    cache = RelightCache.load(result)
    off = worst(cache.relight(result.stage.radiance), read_exr(folder / "render.exr"))
    print(
        f"cache under the fitted lights against render.exr: {off:.1e} of the brightest, "
        f"allowed {HALF:.1e}"
    )
    assert off < HALF


def test_relit_from_the_cache_equals_traced(
    folder: Path,
    radiance: np.ndarray,
    render: Callable[..., np.ndarray],
    monkeypatch: pytest.MonkeyPatch,
):
    samples = RelightCache.load(Result.load(folder)).samples
    expected = traced(folder, radiance, samples)
    monkeypatch.setattr(
        relight, "render_picture", lambda *_, **__: pytest.fail("traced in spite of the cache")
    )
    picture = render(folder, radiance)
    print(
        f"cached against traced: {worst(picture, expected):.1e} of the brightest, allowed "
        f"{HALF:.1e}"
    )
    assert worst(picture, expected) < HALF
    np.testing.assert_allclose(render(folder, 2 * radiance), 2 * picture, rtol=2e-3, atol=1e-6)
    assert not render(folder, 0 * radiance).any()
    # Where there is no cache, what must not be called is.
    (folder / RELIGHT_CACHE).unlink()
    with pytest.raises(pytest.fail.Exception, match="in spite of"):
        render(folder, radiance)


def test_the_first_relit_picture_makes_the_cache(
    folder: Path, radiance: np.ndarray, render: Callable[..., np.ndarray]
):
    (folder / RELIGHT_CACHE).unlink()
    picture = render(folder, radiance, "--spp", "2")
    cache = RelightCache.load(Result.load(folder))
    assert cache.samples == 2
    assert worst(picture, traced(folder, radiance, 2)) < HALF
    assert worst(render(folder, radiance), picture) < HALF


def test_more_samples_than_the_cache_has_are_traced(
    folder: Path, radiance: np.ndarray, render: Callable[..., np.ndarray]
):
    samples = RelightCache.load(Result.load(folder)).samples
    picture = render(folder, radiance, "--spp", str(samples + 3))
    assert RelightCache.load(Result.load(folder)).samples == samples + 3
    assert worst(picture, traced(folder, radiance, samples + 3)) < HALF


@pytest.mark.parametrize(
    "fault",
    [
        "half a file",
        "no npz",
        "texture painted",
        "rougher",
        "map lost",
        "light moved",
        "other arrays",
    ],
)
def test_a_cache_that_does_not_fit_is_made_again(
    folder: Path, radiance: np.ndarray, render: Callable[..., np.ndarray], fault: str
):
    path = folder / RELIGHT_CACHE
    if fault == "half a file":
        path.write_bytes(path.read_bytes()[:1000])
    elif fault == "no npz":
        path.write_text("nothing")
    elif fault == "other arrays":
        np.savez(path, images=np.zeros((3, 4, 5)))
    elif fault == "texture painted":
        from facestage.images.image_io import write_exr

        write_exr(folder / "albedo.exr", 0.5 * read_exr(folder / "albedo.exr"))
    elif fault == "rougher":
        from facestage.images.image_io import write_exr

        write_exr(folder / "roughness.exr", 1.5 * read_exr(folder / "roughness.exr")[..., 0])
    elif fault == "map lost":
        (folder / "roughness.exr").unlink()
    else:
        result = Result.load(folder)
        replace(
            result, stage=replace(result.stage, position=result.stage.position + 0.3)
        ).write_into(folder)
    picture = render(folder, radiance, "--spp", "2")
    assert worst(picture, traced(folder, radiance, 2)) < HALF
    assert RelightCache.load(Result.load(folder)).samples == 2


def test_a_light_that_was_off_can_be_turned_on(
    folder: Path, radiance: np.ndarray, render: Callable[..., np.ndarray]
):
    result = Result.load(folder)
    stage = replace(result.stage, state=np.array([0, OFF, 0, OFF])).with_radiance(radiance)
    replace(result, stage=stage).write_into(folder)
    assert worst(render(folder, radiance), traced(folder, radiance, 4)) < 0.05
    lit = np.where((np.arange(4) == 1)[:, None], radiance, 0)
    assert render(folder, lit).max() > 0


def test_a_folder_that_cannot_be_written_is_relit_all_the_same(
    folder: Path,
    radiance: np.ndarray,
    render: Callable[..., np.ndarray],
    monkeypatch: pytest.MonkeyPatch,
):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    (folder / RELIGHT_CACHE).unlink()
    monkeypatch.setattr(RelightCache, "save", full)
    assert worst(render(folder, radiance, "--spp", "2"), traced(folder, radiance, 2)) < HALF


def test_other_weights_are_traced_and_leave_the_cache(
    folder: Path, radiance: np.ndarray, render: Callable[..., np.ndarray], tmp_path: Path
):
    before = (folder / RELIGHT_CACHE).read_bytes()
    smile = write(tmp_path / "smile.json", json.dumps({"expression": {"smile": 1.0}}))
    assert (
        worst(
            render(folder, radiance, "--weights", str(smile), "--spp", "2"),
            render(folder, radiance),
        )
        > 0.02
    )
    assert (folder / RELIGHT_CACHE).read_bytes() == before


def with_folds(folder: Path, ratio: np.ndarray) -> Result:
    """The result with a fold all over the face that its first expression makes."""
    result = Result.load(folder)
    expression = np.array([0.5, *result.expression[1:]])
    pull = np.zeros((len(PLACES), len(expression)))
    pull[0, 0] = 1 / expression[0]
    folds = Folds(np.tile([1.0, 0.0, 0.0], (len(result.vertices), 1)), pull)
    arrays = result.arrays | folds.arrays
    result = replace(result, expression=expression, arrays=arrays)
    result.write_into(folder)
    write_exr(folder / FOLD_MAP.file, ratio)
    return result


def test_folds_go_with_the_expression_that_made_them(folder: Path, tmp_path: Path):
    result = with_folds(folder, np.full((16, 16, 3), [0.8, 0.6, 0.4]))
    name = result.expression_names[0]
    lit = np.ones(len(result.stage), bool)
    painted = read_exr(folder / "albedo.exr")
    for weight, power in ((0.5, 0.0), (0.25, 0.5), (0.0, 1.0)):
        other = relight.with_weights(result, {"expression": {name: weight}})
        other = replace(other, folder=folder)
        albedo = relight.prepared(other, lit)[3].albedo
        wanted = painted / np.array([0.8, 0.6, 0.4]) ** power
        np.testing.assert_allclose(albedo, wanted, rtol=2e-3)


def test_a_map_of_folds_that_is_no_square_is_refused(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    with_folds(folder, np.full((16, 8, 3), 0.5))
    sentence = refuse(capsys, "render", folder, "--out", tmp_path / "a.png")
    assert "has 8 x 16 pixels" in sentence and "run the fit again" in sentence


def test_large_photos_get_a_smaller_cache_and_full_size_pictures(
    folder: Path, radiance: np.ndarray, render: Callable[..., np.ndarray]
):
    before = (folder / RELIGHT_CACHE).read_bytes()
    (folder / RELIGHT_CACHE).unlink()
    assert relight.relit(Result.load(folder), 2, make=True, numbers_max=2e4).shape == (96, 96, 3)
    assert not (folder / RELIGHT_CACHE).exists()
    relight.make_cache(folder, 2, numbers_max=2e4)
    cache = RelightCache.load(Result.load(folder))
    assert 10 < cache.width < 80 and len((folder / RELIGHT_CACHE).read_bytes()) < len(before)
    picture = render(folder, radiance, "--spp", "2")
    assert picture.shape == (96, 96, 3)
    small = cache.relight(radiance)
    assert small.sum() / small.shape[0] ** 2 == pytest.approx(picture.sum() / 96**2, rel=0.05)


def test_nothing_to_write_is_refused(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert "--out FILE, or --cache" in refuse(capsys, "render", folder)
    assert "--spp is 0" in refuse(capsys, "render", folder, "--cache", "--spp", "0")
    assert "does not exist" in refuse(capsys, "render", tmp_path / "none", "--cache")
    (folder / "albedo.exr").unlink()
    assert "albedo.exr" in refuse(capsys, "render", folder, "--cache")

"""The relight cache: the sum over lights, its file, and the states of a result that it does not
fit.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.files.storage import read_arrays, write_arrays
from facestage.contract.light_stage import OFF
from facestage.contract.relight_cache import RELIGHT_CACHE, RelightCache, relight_fingerprint
from facestage.contract.result import Result
from facestage.contract.texture_maps import TEXTURE_MAPS
from reference.known import known

TEXTURES = tuple(each.file for each in TEXTURE_MAPS)

PIXELS = np.array([3, 4, 97, 200, 96 * 80 - 1])
# The second light is a thousand times weaker than half floats reach; the third does not reach the
# face.
LEVELS = np.array([0.01, 1e-10, 0.0])


@pytest.fixture
def saved(tmp_path: Path, result: Result) -> Result:
    """A result folder with textures."""
    result.write_into(tmp_path)
    for name in TEXTURES:
        (tmp_path / name).write_bytes(name.encode())
    return Result.load(tmp_path)


@pytest.fixture
def images() -> np.ndarray:
    """(3, N, P) at radiance 1."""
    return np.random.default_rng(7).uniform(0.2, 1, (3, 3, len(PIXELS))) * LEVELS[:, None]


@pytest.fixture
def cache(saved: Result, images: np.ndarray) -> RelightCache:
    coverage = np.array([1, 0.5, 0.25, 1, 1])
    made = RelightCache.of_images(96, 80, PIXELS, coverage, images, 4, relight_fingerprint(saved))
    made.save(known(saved.folder))
    return made


def test_relighting_is_the_sum_over_the_lights(
    saved: Result, cache: RelightCache, images: np.ndarray
):
    loaded = RelightCache.load(saved)
    for number in range(3):
        only = np.zeros((3, 3))
        only[number] = [2.0, 3.0, 5.0]
        for each in (cache, loaded):
            picture = each.relight(only)
            assert picture.shape == (80, 96, 3) and picture.dtype == np.float32
            expected = images[:, number].T * only[number]
            np.testing.assert_allclose(picture.reshape(-1, 3)[PIXELS], expected, rtol=6e-4, atol=0)
            assert np.count_nonzero(picture) <= 3 * len(PIXELS)
    radiance = np.random.default_rng(1).uniform(0, 9, (3, 3))
    expected = np.einsum("jc,cjp->pc", radiance, images)
    np.testing.assert_allclose(loaded.colors(radiance), expected, rtol=6e-4)
    assert not loaded.relight(np.zeros((3, 3))).any()


def test_the_file_holds_what_was_made(saved: Result, cache: RelightCache):
    loaded = RelightCache.load(saved)
    assert (loaded.width, loaded.height, loaded.samples, len(loaded)) == (96, 80, 4, 3)
    for name in ("pixels", "coverage", "images", "scale"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(cache, name), err_msg=name)
    assert read_arrays(known(saved.folder) / RELIGHT_CACHE, "cache")["images"].dtype == np.float16


def test_a_head_outside_the_picture_is_an_empty_cache(saved: Result):
    pixels, nothing = np.zeros(0, np.int32), np.zeros(0)
    RelightCache.of_images(
        96, 80, pixels, nothing, np.zeros((3, 3, 0)), 4, relight_fingerprint(saved)
    ).save(known(saved.folder))
    assert not RelightCache.load(saved).relight(np.ones((3, 3))).any()


@pytest.mark.parametrize(
    "radiance", [np.ones((2, 3)), np.ones(3), -np.ones((3, 3)), np.full((3, 3), np.nan)], ids=str
)
def test_radiance_of_another_stage_is_refused(cache: RelightCache, radiance: np.ndarray):
    with pytest.raises(InputError, match=r"expected \(3, 3\) finite"):
        cache.relight(radiance)


def test_the_lights_radiance_and_state_leave_the_cache_valid(saved: Result, cache: RelightCache):
    dark = replace(saved.stage, radiance=np.zeros((3, 3)), state=np.full(3, OFF))
    assert RelightCache.load(replace(saved, stage=dark)).fingerprint == cache.fingerprint


@pytest.mark.parametrize(
    "name",
    [
        "model",
        "camera",
        "camera_to_stage",
        "model_to_camera",
        "identity",
        "expression",
        "vertices",
        "roughness",
        "seed",
        "position",
        "direction",
        "axis_x",
        "side",
        *TEXTURES,
    ],
)
def test_a_cache_of_another_state_is_refused(saved: Result, cache: RelightCache, name: str):
    if name in TEXTURES:
        (known(saved.folder) / name).write_bytes(b"painted over")
        changed = saved
    elif name in ("position", "direction", "axis_x", "side"):
        changed = replace(
            saved, stage=replace(saved.stage, **{name: getattr(saved.stage, name) + 0.25})
        )
    elif name == "model":
        changed = replace(saved, model="npz:other.npz")
    elif name == "camera":
        changed = replace(saved, camera=replace(saved.camera, focal_px=100.0))
    else:
        changed = replace(saved, **{name: getattr(saved, name) + 1})
    with pytest.raises(InputError, match="another state of the result"):
        RelightCache.load(changed)


def test_a_missing_cache_says_how_to_make_it(saved: Result):
    with pytest.raises(
        InputError, match=r"no relight cache; make it .* facestage render .* --cache"
    ):
        RelightCache.load(saved)


@pytest.mark.parametrize("share", [0.0, 0.5, 0.99])
def test_half_a_file_is_refused(saved: Result, cache: RelightCache, share: float):
    path = known(saved.folder) / RELIGHT_CACHE
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(InputError, match="relight cache"):
        RelightCache.load(saved)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("pixels", np.arange(4, dtype=np.int32)),
        ("pixels", np.full(5, 96 * 80, np.int32)),
        ("pixels", np.full(5, -1, np.int32)),
        ("images", np.zeros((3, 2, 5), np.float16)),
        ("images", np.full((3, 3, 5), np.inf, np.float16)),
        ("scale", np.full(3, np.nan, np.float32)),
        ("size", np.array([96, 80, 3])),
        ("size", np.array(["wide", "high"])),
    ],
    ids=str,
)
def test_arrays_that_do_not_belong_together_are_refused(
    saved: Result, cache: RelightCache, name: str, value
):
    path = known(saved.folder) / RELIGHT_CACHE
    write_arrays(path, {**read_arrays(path, "cache"), name: value}, compress=False)
    with pytest.raises(InputError, match="damaged"):
        RelightCache.load(saved)


def test_the_scale_of_a_light_is_its_brightest_value_and_rounding_is_that_of_half_floats():
    images = np.zeros((3, 2, 2))
    images[:, 0] = [[0.5, 4.0], [1.0, 2.0], [0.125, 4.0 / 3]]
    made = RelightCache.of_images(2, 1, np.array([0, 1]), np.ones(2), images, 4, "x")
    np.testing.assert_array_equal(made.scale, np.array([4, 1], np.float32))
    # 1/3 keeps 11 bits: 1365 / 4096.
    np.testing.assert_array_equal(
        made.images[:, 0], [[0.125, 1], [0.25, 0.5], [0.03125, 1365 / 4096]]
    )
    assert made.images.dtype == np.float32 and not made.images[:, 1].any() and len(made) == 2
    np.testing.assert_allclose(made.colors(np.array([[1.0, 2, 3], [9, 9, 9]]))[0], [0.5, 2, 0.375])


def test_a_pixel_is_row_times_width_plus_column():
    made = RelightCache.of_images(3, 2, np.array([1, 5]), np.ones(2), np.ones((3, 1, 2)), 4, "x")
    picture = made.relight(np.array([[1.0, 2.0, 4.0]]))
    assert picture.shape == (2, 3, 3)
    np.testing.assert_array_equal(picture[..., 1], [[0, 2, 0], [0, 0, 2]])


@pytest.mark.parametrize(
    ("name", "right", "wrong"),
    [
        ("pixels", [[0, 1, 2, 3, 7679]], [[0, 1, 2, 3, 7680], [0, 1, 2, 2, 3], [0, 2, 1, 3, 4]]),
        ("size", [[96, 80]], [[97, 80], [96, 81], [0, 80], [16385, 80]]),
        ("coverage", [[0, 1.01, 0, 1, 1]], [[0, -0.01, 0, 1, 1], [0, 1.02, 0, 1, 1]]),
        ("scale", [[0, 1e15, 1]], [[0, -1.0, 1], [0, 1.1e15, 1]]),
        ("samples", [1, 10**6], [0, 10**6 + 1]),
        ("extra", [], [0]),
    ],
)
def test_limits(saved: Result, cache: RelightCache, name: str, right: list, wrong: list):
    """Of a photo of 96 x 80 pixels, five of which see the head, and three lights."""
    path = known(saved.folder) / RELIGHT_CACHE
    arrays = read_arrays(path, "cache")
    for value in (*right, *wrong):
        write_arrays(path, arrays | {name: np.array(value)}, compress=False)
        if value in right:
            np.testing.assert_allclose(
                RelightCache.load(saved).samples, value if name == "samples" else 4
            )
            continue
        with pytest.raises(InputError, match=r"damaged|another state"):
            RelightCache.load(saved)


def test_a_cache_of_a_smaller_picture_serves(saved: Result, cache: RelightCache):
    path = known(saved.folder) / RELIGHT_CACHE
    write_arrays(
        path,
        read_arrays(path, "cache")
        | {"size": np.array([48, 40]), "pixels": np.array([0, 1, 2, 3, 1919])},
        compress=False,
    )
    assert RelightCache.load(saved).relight(np.ones((3, 3))).shape == (40, 48, 3)


def test_a_map_of_roughness_counts_where_there_is_one(saved: Result, cache: RelightCache):
    before = relight_fingerprint(saved)
    assert before == cache.fingerprint == relight_fingerprint(saved)
    (known(saved.folder) / "roughness.exr").write_bytes(b"a map")
    assert relight_fingerprint(saved) != before

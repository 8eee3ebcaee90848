"""JSON and arrays come back as they were, and nothing in an array file can execute."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from facestage.contract.errors import InputError
from facestage.contract.files.storage import (
    finite,
    read_arrays,
    read_json,
    write_arrays,
    write_json,
)


def test_objects_are_never_unpickled(tmp_path: Path):
    trap = tmp_path / "trap.npz"
    np.savez(trap, a=np.array([{"would": "execute"}], dtype=object))
    with pytest.raises(InputError, match=r"trap\.npz.*plain arrays"):
        read_arrays(trap, "job's arrays")


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 cut", b"plain text"])
def test_damaged_arrays_are_named(tmp_path: Path, content: bytes):
    path = tmp_path / "bad.npz"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"The truth file '.*bad\.npz'"):
        read_arrays(path, "truth file")


def test_a_flipped_byte_in_the_arrays_is_an_input_error(tmp_path: Path):
    path = tmp_path / "bad.npz"
    write_arrays(path, {"a": np.random.default_rng(0).normal(size=400)})
    data = bytearray(path.read_bytes())
    for position in range(60, len(data) - 100, 97):
        damaged = bytearray(data)
        damaged[position] ^= 0xFF
        path.write_bytes(damaged)
        with pytest.raises(InputError, match=r"bad\.npz"):
            read_arrays(path, "truth file")


def test_a_single_array_is_no_archive(tmp_path: Path):
    np.save(tmp_path / "one.npy", np.zeros(3))
    with pytest.raises(InputError, match="single array"):
        read_arrays(tmp_path / "one.npy", "truth file")


@pytest.mark.parametrize("compress", [True, False])
def test_arrays_round_trip(tmp_path: Path, compress: bool):
    arrays = {
        "a/b": np.arange(6, dtype=np.int32).reshape(2, 3),
        "text": np.array("ä"),
        "none": np.zeros((0, 3)),
    }
    write_arrays(tmp_path / "x.npz", arrays, compress)
    loaded = read_arrays(tmp_path / "x.npz", "arrays")
    assert set(loaded) == set(arrays)
    for name, array in arrays.items():
        assert loaded[name].dtype == array.dtype
        np.testing.assert_array_equal(loaded[name], array)


json_values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=12,
)


# Each example waits for the disk.
@settings(deadline=None)
@given(st.dictionaries(st.text(), json_values))
def test_json_round_trip(tmp_path_factory: pytest.TempPathFactory, data: dict):
    path = tmp_path_factory.getbasetemp() / "data.json"
    write_json(path, data)
    assert read_json(path, "file") == data


def test_numpy_and_non_finite_values_become_plain_json():
    data = {
        "a": np.float32(0.5),
        "b": np.array([1.0, np.nan]),
        "c": (np.int64(3), np.inf),
        4: Path("x") / "y",
    }
    wanted = {"a": 0.5, "b": [1.0, None], "c": [3, None], "4": str(Path("x") / "y")}
    assert json.loads(json.dumps(finite(data))) == wanted


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "not valid JSON"),
        (b"{", "not valid JSON"),
        (b"\xff\xfe", "not valid JSON"),
        (b"[1]", "list of 1"),
    ],
)
def test_damaged_json_is_named(tmp_path: Path, content: bytes, words: str):
    path = tmp_path / "bad.json"
    path.write_bytes(content)
    with pytest.raises(InputError, match=rf"The camera file '.*bad\.json'.*{words}"):
        read_json(path, "camera file")


def test_missing_files_are_named(tmp_path: Path):
    with pytest.raises(InputError, match=r"camera file '.*none\.json' does not exist"):
        read_json(tmp_path / "none.json", "camera file")
    with pytest.raises(InputError, match=r"truth file '.*none\.npz' does not exist"):
        read_arrays(tmp_path / "none.npz", "truth file")
    with pytest.raises(InputError, match="is a folder, expected a file"):
        read_json(tmp_path, "camera file")


def test_arrays_are_packed_unless_they_are_read_often(tmp_path: Path):
    for name, options in (("packed", {}), ("plain", {"compress": False})):
        write_arrays(tmp_path / f"{name}.npz", {"a": np.zeros(10_000)}, **options)
    sizes = [(tmp_path / f"{name}.npz").stat().st_size for name in ("packed", "plain")]
    assert sizes[0] < 1000 and 80_000 < sizes[1] < 81_000


def test_a_file_is_no_larger_than_its_arrays_and_what_packs_them(tmp_path: Path):
    path = tmp_path / "x.npz"
    # With their headers of 128 bytes.
    small, large = 928, 400_128
    write_arrays(path, {"a": np.zeros(100), "b": np.zeros(50_000)}, compress=False)
    assert set(read_arrays(path, "file", small + large)) == {"a", "b"}
    assert set(read_arrays(path, "file", small, names=["a"])) == {"a"}
    for limit, names in ((small + large - 1, None), (small - 1, ["a"])):
        with pytest.raises(InputError, match="unpacked, expected at most"):
            read_arrays(path, "file", limit, names)
    with pytest.raises(InputError, match=r"expected at most 390\.6 KiB; is it the right file"):
        read_arrays(path, "file", small, names=["a"], file_limit=400_000)
    # Of a file of which nobody says how large it may be: the arrays, and 16 MiB.
    with path.open("ab") as stream:
        stream.truncate(16 * 2**20 + small + 1)
    with pytest.raises(InputError, match="expected at most 16 MiB; is it the right file"):
        read_arrays(path, "file", small)


def test_what_is_written_ends_with_a_line_and_is_made_for_reading(tmp_path: Path):
    write_json(tmp_path / "a.json", {"a": [np.bool_(True), np.float64(np.nan)], "b": np.int8(3)})
    assert (tmp_path / "a.json").read_text() == '{\n "a": [\n  true,\n  null\n ],\n "b": 3\n}\n'

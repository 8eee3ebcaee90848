"""Small pickles that would take all memory or time, or crash an ordinary reader, are refused in a
sentence.
"""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from scipy import sparse

from facestage.contract.errors import InputError
from facestage.models.files.pickle_machine import OPCODE_LIMIT
from facestage.models.files.restricted_pickle import ARRAY_BYTES, read_pickle
from reference.memory import memory


def refusal(folder: Path, content: bytes) -> str:
    (folder / "x.pkl").write_bytes(content)
    with pytest.raises(
        InputError, match=r"x\.pkl' is refused: .*nothing in it was executed\.$"
    ) as caught:
        read_pickle(folder / "x.pkl", "model")
    assert "\n" not in str(caught.value)
    return str(caught.value)


def shared(kind: type, levels: int) -> object:
    """2^levels leaves, of which only ``levels`` are written."""
    value: object = kind((1, 2))
    for _ in range(levels):
        value = kind((value, value))
    return value


@pytest.mark.parametrize("kind", [list, tuple])
@pytest.mark.parametrize("protocol", [2, 4])
def test_shared_lists_are_resolved_once(tmp_path: Path, kind: type, protocol: int):
    content = pickle.dumps({"v": shared(kind, 60)}, protocol)
    assert len(content) < 700
    assert "unpacks to more than 64 million numbers" in refusal(tmp_path, content)


def test_shared_lists_that_are_not_many_are_read(tmp_path: Path):
    (tmp_path / "x.pkl").write_bytes(pickle.dumps({"v": shared(list, 10)}))
    found = read_pickle(tmp_path / "x.pkl", "model")["v"]
    assert np.array(found).size == 2**11 and found[0] is found[1]


def test_an_array_used_a_million_times_is_counted_each_time(tmp_path: Path):
    array = np.zeros(10_000)
    assert "unpacks to more than" in refusal(tmp_path, pickle.dumps({"v": [array] * 10_000}))


def test_bytes_shared_by_many_arrays_are_counted_each_time(tmp_path: Path):
    raw = b"\0" * 2**24
    one = b"cnumpy.core.multiarray\n_reconstruct\n"
    one += b"(cnumpy\nndarray\nK\0\x85K\0tR(K\x01J\0\0\0\x01\x85h\1\x89h\0tb"
    dtype = b"cnumpy\ndtype\n(X\2\0\0\0u1K\0K\1tRq\1"
    content = (
        b"\x80\2B"
        + len(raw).to_bytes(4, "little")
        + raw
        + b"q\0"
        + dtype
        + b"}X\1\0\0\0v]("
        + one * 60
        + b"es."
    )
    with memory(ARRAY_BYTES + 100e6):
        assert f"its arrays have more than {ARRAY_BYTES // 2**20} MiB" in refusal(tmp_path, content)


@pytest.mark.parametrize("index", [2**20, 2**28, 2**31 - 1, 2**32 - 1])
def test_an_index_of_the_memo_costs_nothing(tmp_path: Path, index: int):
    with memory(1e6):
        assert f"its memo has the index {index}" in refusal(
            tmp_path, b"\x80\2}r" + index.to_bytes(4, "little") + b"."
        )


@pytest.mark.parametrize(
    "content",
    [
        b"\x80\x04\x8d" + b"\xff" * 7 + b"\x0f.",
        b"\x80\x04\x8e" + b"\xff" * 7 + b"\x0f.",
        b"\x80\x05\x96" + b"\xff" * 7 + b"\x0f.",
        b"\x80\x04\x95" + b"\xff" * 8,
        b"\x8b\xff\xff\xff\x7f.",
        b"I" + b"9" * 100_000 + b"\n.",
        b"L" + b"9" * 100_000 + b"L\n.",
        b"\x80\2p-1\n.",
        b"\x80\2Np-1\n.",
    ],
)
def test_lengths_and_numbers_are_not_believed(tmp_path: Path, content: bytes):
    refusal(tmp_path, content)


def test_deep_keys_do_not_overflow_the_stack(tmp_path: Path):
    assert "has a tuple as a key" in refusal(tmp_path, b"\x80\2})" + b"\x85" * 200_000 + b"Ns.")
    assert "has a tuple as a key" in refusal(
        tmp_path, b"\x80\4\x8f()" + b"\x85" * 200_000 + b"\x90."
    )


def test_shared_keys_are_not_hashed(tmp_path: Path):
    twice = b"".join(b"q" + bytes([k]) + b"h" + bytes([k]) + b"\x86" for k in range(60))
    assert "has a tuple as a key" in refusal(tmp_path, b"\x80\2})" + twice + b"Ns.")


def test_what_is_deep_or_contains_itself_is_named(tmp_path: Path):
    nested: list[object] = []
    for _ in range(200):
        nested = [nested]
    assert "nested more than 100 deep" in refusal(tmp_path, pickle.dumps({"v": nested}))
    circle: dict[str, object] = {}
    circle["v"] = [circle]
    assert "contains itself" in refusal(tmp_path, pickle.dumps(circle))
    assert "deep" in refusal(tmp_path, b"\x80\2)" + b"\x85" * 100_000 + b".")


def test_steps_are_limited(tmp_path: Path):
    assert f"more than {OPCODE_LIMIT} steps" in refusal(
        tmp_path, b"\x80\2" + b"N0" * OPCODE_LIMIT + b"."
    )


def matrix(kind: str, shape: tuple[int, int], **change: np.ndarray) -> bytes:
    honest = sparse.random(4, 5, 0.5, kind, random_state=1)
    honest._shape = shape
    honest.__dict__.update(change)
    return pickle.dumps({"J": honest})


@pytest.mark.parametrize("kind", ["csc", "csr", "coo"])
@pytest.mark.parametrize("shape", [(10**9, 10**9), (0, 10**12), (-4, -5), (10**6, 10**3)])
def test_a_sparse_matrix_is_not_written_out_whatever_its_shape(
    tmp_path: Path, kind: str, shape: tuple[int, int]
):
    assert "sparse matrix of shape" in refusal(tmp_path, matrix(kind, shape))


@pytest.mark.parametrize(
    ("kind", "change"),
    [
        ("csc", {"indices": np.full(10, 99, np.int32)}),
        ("csc", {"indices": np.full(10, -1, np.int32)}),
        ("csr", {"indptr": np.array([0, 2**31 - 1, 0, 3, 10], np.int32)}),
        ("csc", {"data": np.zeros((10, 2))}),
        ("csr", {"indices": np.full(10, 0.5)}),
        ("coo", {"data": np.zeros(3)}),
        ("csc", {"indptr": np.zeros(2, "i4")}),
    ],
)
def test_a_damaged_sparse_matrix_is_refused(
    tmp_path: Path, kind: str, change: dict[str, np.ndarray]
):
    refusal(tmp_path, matrix(kind, (4, 5), **change))


@pytest.mark.parametrize(
    "names", [b"cnumpy.ndarray\nx\n.", b"cnumpy.core.multiarray\n_reconstruct\n.", b"\x80\2N(Nb."]
)
def test_names_and_states_in_odd_places_are_refused(tmp_path: Path, names: bytes):
    (tmp_path / "x.pkl").write_bytes(names)
    with pytest.raises(InputError, match=r"x\.pkl'"):
        read_pickle(tmp_path / "x.pkl", "model")

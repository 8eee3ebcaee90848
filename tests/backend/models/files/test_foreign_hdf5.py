"""An .h5 or .mat file of somebody else: it opens no other file, takes no more than it may, and
crashes nobody.
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

from facestage.contract.errors import InputError
from facestage.models.files.hdf5_file import read_hdf5
from reference.published.bfm import write_statismo
from reference.published.heads import Head, head
from reference.published.loaded import load_bfm

MEAN = "shape/model/mean"
SECRET = 1234.5


@pytest.fixture(scope="module")
def face() -> Head:
    return head(1500)


@pytest.fixture
def model(tmp_path: Path, face: Head) -> Path:
    path = tmp_path / "model2019_bfm.h5"
    write_statismo(path, face)
    return path


def replace(path: Path, put: Callable[[h5py.File], None], name: str = MEAN) -> None:
    with h5py.File(path, "a") as file:
        del file[name]
        put(file)


def refusal(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        load_bfm(path)
    text = str(caught.value)
    assert path.name in text and "\n" not in text and str(SECRET) not in text
    return text


@pytest.fixture
def secret(tmp_path: Path) -> Path:
    """A file of somebody else's, with numbers of the right shape."""
    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["mean"] = np.full(4500, SECRET, np.float32)
    return tmp_path / "secret.h5"


def test_a_link_to_another_file_is_refused(model: Path, secret: Path):
    replace(model, lambda file: file.__setitem__(MEAN, h5py.ExternalLink(str(secret), "/mean")))
    assert f"{MEAN} is a link to another file" in refusal(model)


def test_the_other_file_is_not_even_opened(model: Path, tmp_path: Path):
    # Whoever opened it would wait for somebody who writes into it.
    os.mkfifo(tmp_path / "pipe")
    replace(
        model,
        lambda file: file.__setitem__(MEAN, h5py.ExternalLink(str(tmp_path / "pipe"), "/mean")),
    )
    assert "link to another file" in refusal(model)


def test_a_link_on_the_way_is_refused(model: Path, secret: Path):
    replace(
        model, lambda file: file.__setitem__("shape", h5py.ExternalLink(str(secret), "/")), "shape"
    )
    assert "link to another file" in refusal(model)


def test_a_soft_link_to_such_a_link_is_refused(model: Path, secret: Path):
    def put(file: h5py.File) -> None:
        file["elsewhere"] = h5py.ExternalLink(str(secret), "/mean")
        file[MEAN] = h5py.SoftLink("/elsewhere")

    replace(model, put)
    assert "link to another file" in refusal(model)


def test_soft_links_within_the_file_are_followed_but_not_for_ever(model: Path):
    with h5py.File(model, "a") as file:
        file.move(MEAN, "shape/kept")
        file[MEAN] = h5py.SoftLink("../kept")
    assert read_hdf5(model, [MEAN])[MEAN].shape == (4500,)
    replace(model, lambda file: file.__setitem__(MEAN, h5py.SoftLink(f"/{MEAN}")))
    assert "a chain of links that does not end" in refusal(model)


def test_storage_in_another_file_is_refused(model: Path, tmp_path: Path):
    np.full(4500, SECRET, np.float32).tofile(tmp_path / "secret.raw")
    outside = [(str(tmp_path / "secret.raw"), 0, h5py.h5f.UNLIMITED)]
    replace(model, lambda file: file.create_dataset(MEAN, (4500,), np.float32, external=outside))
    assert f"{MEAN} is kept in another file" in refusal(model)


def test_a_virtual_dataset_is_refused(model: Path, secret: Path):
    layout = h5py.VirtualLayout((4500,), np.float32)
    layout[:] = h5py.VirtualSource(str(secret), "mean", (4500,))
    replace(model, lambda file: file.create_virtual_dataset(MEAN, layout))
    assert f"{MEAN} is kept in another file" in refusal(model)


def test_a_filter_that_may_be_a_plugin_is_refused(model: Path):
    replace(
        model,
        lambda file: file.create_dataset(MEAN, data=np.zeros(4500, np.float32), compression="lzf"),
    )
    assert f"{MEAN} is packed by the filter lzf" in refusal(model)


def test_gzip_is_read(model: Path):
    with h5py.File(model, "a") as file:
        values = file[MEAN][()]
        del file[MEAN]
        file.create_dataset(MEAN, data=values, compression="gzip", shuffle=True, fletcher32=True)
    np.testing.assert_array_equal(read_hdf5(model, [MEAN])[MEAN], values)


@pytest.mark.parametrize(
    ("shape", "chunks", "words"),
    [
        ((2**40,), (2**20,), "its arrays have 4194304 MiB, expected at most 1024 MiB"),
        ((2**28,), (2**27,), "has chunks of more than 256 MiB"),
        ((2**50,), None, "expected at most 1024 MiB"),
    ],
)
def test_a_size_is_not_believed(
    model: Path, shape: tuple[int, ...], chunks: tuple[int, ...] | None, words: str
):
    replace(model, lambda file: file.create_dataset(MEAN, shape, np.float32, chunks=chunks))
    assert model.stat().st_size < 2**20 and words in refusal(model)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (np.array([b"x"] * 4500), "is of type |S1, expected plain numbers"),
        (np.zeros(4500, [("x", "f4")]), "expected plain numbers"),
        (h5py.Empty("f4"), "holds nothing"),
        (np.array([np.bool_(True)] * 4500), "is of type bool, expected plain numbers"),
        (np.full(4500, 1e200), "mean holds numbers beyond 1e+10"),
    ],
)
def test_what_is_no_number_is_named(model: Path, value: object, words: str):
    replace(model, lambda file: file.__setitem__(MEAN, value))
    assert words in refusal(model)


@pytest.mark.parametrize(
    "text", ["[" * 100_000, "[1, 2]", '[{"id": "a", "coordinates": [1, 2, NaN]}]', '{"a": 1}']
)
def test_damaged_landmarks_are_named(model: Path, text: str):
    name = "metadata/landmarks/json"
    replace(model, lambda file: file.__setitem__(name, text), name)
    assert "damaged landmarks" in refusal(model)


def crashing_mat(path: Path, code: int = 0x7FFF) -> None:
    """A .mat whose data have a type that is not there: scipy takes it for an index of its table,
    far beyond the end.
    """
    scipy.io.savemat(path, {"shapeMU": np.zeros((30, 1), np.float32)})
    content = bytearray(path.read_bytes())
    at = content.index((7).to_bytes(4, "little") + (120).to_bytes(4, "little"))
    content[at : at + 4] = code.to_bytes(4, "little")
    path.write_bytes(content)


@pytest.mark.parametrize("code", [20, 0x100, 0x600, 0x2000, 0x4007, 0x7FFF, 0xFFFF])
def test_a_mat_file_that_crashes_its_reader_is_a_sentence(tmp_path: Path, code: int):
    """What lies beyond the table differs from run to run; most of these end the reader by a
    signal.
    """
    crashing_mat(tmp_path / "01_MorphableModel.mat", code)
    assert "cannot be read as a MATLAB file (" in refusal(tmp_path / "01_MorphableModel.mat")


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("text", "shapeMU is of type <U4, expected plain numbers"),
        (np.array([1 + 2j]), "shapeMU is of type complex128, expected plain numbers"),
        ({"x": 1}, "expected plain numbers"),
    ],
)
def test_a_mat_file_of_something_else_is_named(tmp_path: Path, value: object, words: str):
    scipy.io.savemat(tmp_path / "a.mat", {"shapeMU": value})
    assert words in refusal(tmp_path / "a.mat")


def test_a_mat_file_that_asks_for_all_memory_is_named(tmp_path: Path):
    scipy.io.savemat(tmp_path / "a.mat", {"shapeMU": np.zeros((30, 1))}, do_compression=True)
    content = (tmp_path / "a.mat").read_bytes()
    element = bytearray(zlib.decompress(content[136:]))
    at = element.index((30).to_bytes(4, "little"))
    element[at : at + 4] = (2**30).to_bytes(4, "little")
    packed = zlib.compress(bytes(element) + bytes(2**20))
    (tmp_path / "a.mat").write_bytes(content[:132] + len(packed).to_bytes(4, "little") + packed)
    assert "cannot be read as a MATLAB file" in refusal(tmp_path / "a.mat")


@pytest.mark.parametrize("name", ["a.mat", "a.h5"])
def test_a_pipe_is_refused_unread(tmp_path: Path, name: str):
    os.mkfifo(tmp_path / name)
    assert "is a pipe or a device" in refusal(tmp_path / name)

"""Pickles of arrays are read; pickles that want anything else run nothing and are refused in a
sentence.
"""

from __future__ import annotations

import builtins
import collections
import io
import os
import pickle
import subprocess
import sys
import types
from pathlib import Path

import numpy as np
import pytest
from scipy import sparse

from facestage.contract.errors import InputError
from facestage.models.files.restricted_pickle import read_pickle


class Ch:
    """Pickled as chumpy's arrays are: by name and ``__dict__``."""

    def __init__(self, x: np.ndarray) -> None:
        self.x = x
        self.dirty_vars = {1, 2}


@pytest.fixture
def chumpy(monkeypatch: pytest.MonkeyPatch) -> type:
    module = types.ModuleType("chumpy.ch")
    module.Ch = Ch  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "chumpy", types.ModuleType("chumpy"))
    monkeypatch.setitem(sys.modules, "chumpy.ch", module)
    monkeypatch.setattr(Ch, "__module__", "chumpy.ch")
    return Ch


@pytest.mark.parametrize("protocol", range(6))
def test_arrays_of_every_protocol(tmp_path: Path, chumpy: type, protocol: int):
    data = {
        "doubles": np.arange(12.0).reshape(3, 4),
        "fortran": np.asfortranarray(np.eye(2, 3, dtype=np.float32)),
        "big_endian": np.arange(4, dtype=">i4"),
        "scalar": np.float64(2.5),
        "empty": np.zeros((0, 3)),
        "bool": np.array([True, False]),
        "text": "smpl",
        "list": [1, np.arange(2)],
        "none": None,
        "chumpy": chumpy(np.eye(2)),
        b"bytes": b"\xff\x00",
    } | {kind: sparse.random(5, 40, 0.2, kind, random_state=1) for kind in ("csc", "csr", "coo")}
    path = tmp_path / "model.pkl"
    path.write_bytes(pickle.dumps(data, protocol))
    found = read_pickle(path, "model")
    for name in ("doubles", "fortran", "big_endian", "empty", "bool"):
        np.testing.assert_array_equal(found[name], data[name])
        assert found[name].dtype == data[name].dtype.newbyteorder("=")
    assert found["scalar"] == 2.5 and found["text"] == "smpl" and found["none"] is None
    np.testing.assert_array_equal(found["list"][1], [0, 1])
    np.testing.assert_array_equal(found["chumpy"], np.eye(2))
    for name in ("csc", "csr", "coo"):
        np.testing.assert_array_equal(found[name].toarray(), data[name].toarray())


def test_names_that_python_2_wrote(tmp_path: Path):
    stream = pickle.dumps({"v": np.arange(3.0)}, 2)
    stream = stream.replace(b"cnumpy._core.multiarray", b"cnumpy.core.multiarray")
    old = (
        b"(dp0\nS'f'\np1\ncnumpy.core.multiarray\n_reconstruct\np2\n(cnumpy\nndarray\np3\n(I0\ntp4\nS'b'\np5\ntp6\nRp7\n"
        b"(I1\n(I2\ntp8\ncnumpy\ndtype\np9\n(S'u4'\np10\nI0\nI1\ntp11\nRp12\n(I3\nS'<'\np13\nNNNI-1\nI-1\nI0\ntp14\n"
        b"bI00\nS'\\xff\\xff\\xff\\xff\\x01\\x00\\x00\\x00'\np15\ntp16\nbs."
    )
    (tmp_path / "a.pkl").write_bytes(stream)
    (tmp_path / "b.pkl").write_bytes(old)
    np.testing.assert_array_equal(read_pickle(tmp_path / "a.pkl", "model")["v"], [0, 1, 2])
    np.testing.assert_array_equal(read_pickle(tmp_path / "b.pkl", "model")["f"], [2**32 - 1, 1])


def test_an_npy_of_one_dictionary(tmp_path: Path):
    np.save(tmp_path / "embedding.npy", np.array({"full": np.arange(3)}, dtype=object))
    np.testing.assert_array_equal(
        read_pickle(tmp_path / "embedding.npy", "embedding")["full"], [0, 1, 2]
    )
    np.save(tmp_path / "plain.npy", np.arange(3))
    with pytest.raises(InputError, match="it holds a single array"):
        read_pickle(tmp_path / "plain.npy", "embedding")


def test_tensors_beside_the_arrays_are_not_looked_into(tmp_path: Path):
    ran = tmp_path / "ran"
    inner = pickle.dumps(_Reduce(os.system, (f"touch {ran}",)))
    stream = (
        b"\x80\x03}(X\x04\x00\x00\x00faceK\x01X\x01\x00\x00\x00t"
        b"ctorch._utils\n_rebuild_tensor_v2\n(ctorch.storage\n_load_from_bytes\n(B"
        + len(inner).to_bytes(4, "little")
        + inner
        + b"tRK\x00))\x89ccollections\nOrderedDict\n)RtRu."
    )
    (tmp_path / "t.pkl").write_bytes(stream)
    assert read_pickle(tmp_path / "t.pkl", "embedding")["face"] == 1
    assert not ran.exists()


class _Reduce:
    def __init__(self, function, args: tuple) -> None:
        self.function, self.args = function, args

    def __reduce__(self):
        return self.function, self.args


def _raw(text: str) -> bytes:
    return text.encode("latin1")


def attacks(marker: Path) -> dict[str, bytes]:
    """Pickles that create ``marker`` when their program runs."""
    touch = f"touch {marker}"
    write = f"open({str(marker)!r}, 'w').close()"
    return {
        "os.system": pickle.dumps(_Reduce(os.system, (touch,))),
        "inside a dictionary": pickle.dumps({"v_template": _Reduce(os.system, (touch,))}),
        "builtins.eval": pickle.dumps(_Reduce(builtins.eval, (write,))),
        "builtins.exec": pickle.dumps(_Reduce(builtins.exec, (write,))),
        "Python 2's __builtin__": _raw(f"c__builtin__\neval\n(S{write!r}\ntR."),
        "subprocess": pickle.dumps(_Reduce(subprocess.Popen, (["touch", str(marker)],))),
        "getattr chain": _raw(
            f"cbuiltins\ngetattr\n(cbuiltins\n__import__\n(S'os'\ntRS'system'\ntR(S{touch!r}\ntR."
        ),
        "posix by the INST opcode": _raw(f"(S{touch!r}\niposix\nsystem\n."),
        "OBJ opcode": _raw("(cos\nsystem\nS") + repr(touch).encode() + b"\no.",
        "dotted name": b"\x80\x04\x8c\x05numpy\x8c\x14os.system.__call__\x93\x94.",
        "dotted name behind an allowed module": (
            b"\x80\x04\x8c\x15numpy.core.multiarray\x8c\x18_reconstruct.__globals__\x93."
        ),
        "numpy.save": pickle.dumps(_Reduce(np.save, (str(marker), np.zeros(2)))),
        "ndarray.tofile": pickle.dumps(_Reduce(getattr, (np.ndarray, "tofile"))),
        "numpy.load": pickle.dumps(_Reduce(np.load, (str(marker), None, True))),
        "numpy's runstring": _raw(f"cnumpy.testing._private.utils\nrunstring\n(S{write!r}\n}}tR."),
        "open": pickle.dumps(_Reduce(open, (str(marker), "w"))),
        "pickle in a pickle": pickle.dumps(
            _Reduce(pickle.loads, (pickle.dumps(_Reduce(os.system, (touch,))),))
        ),
        "scipy function": b"cscipy.io\nsavemat\n(S'x'\n}tR.",
        "other chumpy name": b"cchumpy.utils\nos\n.",
        "extension registry": b"\x80\x02\x82\x01.",
        "persistent id": b"\x80\x02U\x02os" + b"Q.",
        "partial": pickle.dumps(_Reduce(__import__("functools").partial, (os.system, touch))),
        "weak deque": pickle.dumps(collections.deque([_Reduce(os.system, (touch,))])),
    }


@pytest.mark.parametrize("name", attacks(Path("marker")))
def test_nothing_runs(tmp_path: Path, name: str):
    marker = tmp_path / "ran"
    path = tmp_path / "evil.pkl"
    path.write_bytes(attacks(marker)[name])
    with pytest.raises(
        InputError, match=r"evil\.pkl' is refused: .* nothing in it was executed\.$"
    ) as caught:
        read_pickle(path, "FLAME model")
    assert "\n" not in str(caught.value)
    assert not marker.exists() and not marker.with_suffix(".npy").exists()


def test_the_attacks_would_work_on_an_ordinary_reader(tmp_path: Path):
    marker = tmp_path / "ran"
    pickle.loads(attacks(marker)["builtins.exec"])
    assert marker.exists()


def test_a_pickle_cannot_change_what_reads_the_next_one(tmp_path: Path):
    # BUILD on the class itself, then an honest file.
    (tmp_path / "a.pkl").write_bytes(b"cnumpy\ndtype\n(dS'name'\nS'os.system'\nsb.")
    with pytest.raises(InputError):
        read_pickle(tmp_path / "a.pkl", "model")
    (tmp_path / "b.pkl").write_bytes(pickle.dumps({"v": np.arange(2)}))
    np.testing.assert_array_equal(read_pickle(tmp_path / "b.pkl", "model")["v"], [0, 1])


def _with_state(shape: tuple, code: str, raw: bytes) -> bytes:
    """A pickled array whose parts need not agree."""
    honest = pickle.dumps({"v": np.arange(2, dtype=np.int8)}, 2)
    stream = io.BytesIO()
    pickler = pickle._Pickler(stream, 2)  # type: ignore[attr-defined]
    array = _Reduce(np.zeros(1).__reduce__()[0], (np.ndarray, (0,), b"b"))
    dtype = _Reduce(np.dtype, (code, False, True))
    array.__class__ = type(
        "Stated",
        (_Reduce,),
        {"__reduce__": lambda self: (self.function, self.args, (1, shape, dtype, False, raw))},
    )
    pickler.dump({"v": array})
    assert len(honest)
    return stream.getvalue()


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\x80",
        b"not a pickle",
        b"\x80\x04N.",
        b"\x80\x02]q\x00.",
        b"<!DOCTYPE html><html></html>",
        pickle.dumps({"v": np.arange(1000.0)})[:600],
        np.random.default_rng(0).bytes(4000),
        b"\x80\x02}r\xff\xff\xff\x7f.",
        pickle.dumps({"v": np.array([print, 1], dtype=object)}),
        pickle.dumps({"v": np.array(["text"])}),
        _with_state((1000, 1000), "f8", b"12345678"),
        _with_state((-1,), "f8", b"12345678"),
        _with_state((1,), "V8", b"12345678"),
        _with_state((2**62, 4), "f8", b""),
        pickle.dumps({"J": sparse.csc_matrix((np.ones(1), [0], [0, 1, 1]), (2, 2))}).replace(
            np.array([0, 1, 1], np.int32).tobytes(), np.array([0, 9, 9], np.int32).tobytes()
        ),
    ],
)
def test_damaged_files_are_refused(tmp_path: Path, content: bytes):
    (tmp_path / "x.pkl").write_bytes(content)
    with pytest.raises(InputError, match=r"x\.pkl") as caught:
        read_pickle(tmp_path / "x.pkl", "model")
    assert "\n" not in str(caught.value)


def test_a_web_page_is_named_as_one(tmp_path: Path):
    (tmp_path / "flame.pkl").write_bytes(b"\n <html><body>Please log in</body></html>")
    with pytest.raises(
        InputError, match="is a web page, not the file; log in there and download it again"
    ):
        read_pickle(tmp_path / "flame.pkl", "FLAME model")


def test_a_missing_file_is_named(tmp_path: Path):
    with pytest.raises(InputError, match=r"none\.pkl' does not exist"):
        read_pickle(tmp_path / "none.pkl", "FLAME model")
    with pytest.raises(InputError, match="is a folder, expected a file"):
        read_pickle(tmp_path, "FLAME model")

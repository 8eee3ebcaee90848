"""Arrays out of pickles that others published, without letting the pickle call anything.

A pickle is a program: every name in it is looked up and called. Here the lookup gives, for the few names that array
containers need, a fresh class that only keeps what it was called with, and refuses every other name. Nothing of
numpy, scipy, chumpy or torch runs while the pickle is read; the arrays are put together afterwards from their
checked type, shape and bytes.

Formats: pickle protocols 0 to 5 (PEP 307, PEP 574); numpy's ``ndarray.__reduce__`` and .npy version 1 to 3
(numpy.lib.format); scipy.sparse matrices by their ``__dict__``; chumpy's Ch keeps its array under "x".
"""

from __future__ import annotations

import io
import math
import pickle
import re
from pathlib import Path
from typing import Any

import numpy as np
from scipy import sparse

from facestage.contract.errors import InputError

_NUMPY = ("numpy.core.multiarray", "numpy._core.multiarray", "numpy.core.numeric", "numpy._core.numeric")
_SPARSE = re.compile(r"scipy\.sparse(\._?(csc|csr|coo))?\.(csc|csr|coo)_(matrix|array)")
# Python 2 wrote copy_reg and __builtin__; torch's tensors lie in some landmark files and are never looked into.
_ALLOWED = {
    *(f"{module}.{name}" for module in _NUMPY for name in ("_reconstruct", "scalar", "_frombuffer")),
    "numpy.ndarray", "numpy.dtype", "chumpy.ch.Ch", "chumpy.Ch", "_codecs.encode", "collections.OrderedDict",
    "copy_reg._reconstructor", "copyreg._reconstructor", "__builtin__.object", "builtins.object",
    "__builtin__.bytes", "builtins.bytes", "__builtin__.set", "builtins.set",
    "torch._utils._rebuild_tensor_v2", "torch.storage._load_from_bytes",
}  # fmt: skip
_PLAIN_TYPE = re.compile(r"[iufb][1248]")


class _Record:
    """What a pickle wanted called or built, kept as data."""

    __slots__ = ("args", "state")
    name = ""
    args: tuple[Any, ...]
    state: Any

    def __new__(cls, *args: Any, **_options: Any) -> _Record:
        record = super().__new__(cls)
        record.args, record.state = args, None
        return record

    def __init__(self, *_args: Any, **_options: Any) -> None:
        """Everything is kept by ``__new__``, which a pickle may call alone."""

    def __setstate__(self, state: Any) -> None:
        self.state = state


class _Unpickler(pickle.Unpickler):
    """Gives a fresh record class for every allowed name, so that a pickle cannot change one that is used again."""

    def find_class(self, module: str, name: str) -> type[_Record]:
        full = f"{module}.{name}"
        if full not in _ALLOWED and not _SPARSE.fullmatch(full):
            raise pickle.UnpicklingError(f"it asks for '{full[:80]}', which holds no array")
        return type("Record", (_Record,), {"__slots__": (), "name": full})


def read_pickle(path: Path, what: str) -> dict[str, Any]:
    """The dictionary in a pickle or in an .npy of one object: arrays, sparse matrices, numbers, text, lists.

    Raises InputError, having executed nothing, when the file is no pickle, asks for anything but arrays, or does not
    hold a dictionary. ``what`` names the file in messages.
    """
    try:
        content = Path(path).read_bytes()
    except FileNotFoundError as error:
        raise InputError(f"The {what} '{path}' does not exist; check the path.") from error
    except OSError as error:
        raise InputError(f"The {what} '{path}' cannot be read: {error.strerror or error}.") from error
    if content[:200].lstrip().lower().startswith((b"<!doctype", b"<html", b"<?xml")):
        raise InputError(f"The {what} '{path}' is a web page, not the file; log in there and download it again.")
    try:
        data = _resolve(_Unpickler(_pickled(content), encoding="latin1").load())
    # Whatever a damaged or hostile stream makes the reader raise, its answer is the same sentence.
    except Exception as error:
        reason = " ".join(str(error).split()).rstrip(".") or type(error).__name__
        raise InputError(
            f"The {what} '{path}' is refused: expected a pickle of plain arrays, but {reason}; "
            "nothing in it was executed."
        ) from error
    if not isinstance(data, dict):
        raise InputError(f"The {what} '{path}' holds a {type(data).__name__}, expected a dictionary of arrays.")
    return {str(key): value for key, value in data.items()}


def _pickled(content: bytes) -> io.BytesIO:
    """The pickle stream itself: an .npy of objects has a header before it."""
    stream = io.BytesIO(content)
    if content.startswith(np.lib.format.MAGIC_PREFIX):
        version = np.lib.format.read_magic(stream)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        _, _, dtype = read(stream)
        if not dtype.hasobject:
            raise ValueError("it holds a single array")
    return stream


def _resolve(value: Any) -> Any:
    """The value with records turned into arrays, recursively; a record that stands for none stays one."""
    if isinstance(value, dict):
        return {_resolve(key): _resolve(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return type(value)(_resolve(item) for item in value)
    if not isinstance(value, _Record):
        return value
    name, state = value.name, value.state
    if name.endswith("._reconstructor"):
        name = value.args[0].name
    if name.endswith("._reconstruct"):
        # Old numpy wrote no version number before the shape.
        shape, dtype, fortran, raw = state[-4:]
        return _array(raw, dtype, shape, "F" if fortran else "C")
    if name.endswith("._frombuffer"):
        raw, dtype, shape, order = value.args
        return _array(raw, dtype, shape, order)
    if name.endswith(".scalar"):
        return _array(value.args[1], value.args[0], (), "C")[()]
    if name.startswith("chumpy."):
        return np.asarray(_resolve(state["x"]))
    if _SPARSE.fullmatch(name):
        return _sparse(name, _resolve(state))
    if name == "_codecs.encode":
        return str(value.args[0]).encode("latin1")
    if name.endswith(".bytes"):
        return b""
    return value


def _array(raw: Any, record: _Record, shape: Any, order: str) -> Any:
    """An array from its bytes; a list for one of objects."""
    raw = _resolve(raw)
    code = str(_resolve(record.args[0])) if record.name == "numpy.dtype" else ""
    shape = tuple(int(extent) for extent in shape)
    if code.startswith("O"):
        items = [_resolve(item) for item in raw]
        return items[0] if shape == () else items
    if not _PLAIN_TYPE.fullmatch(code):
        raise ValueError(f"it holds an array of type '{code[:20]}'")
    byte_order = str(record.state[1]) if record.state else "<"
    dtype = np.dtype(code).newbyteorder(">" if byte_order == ">" else "<")
    content = raw.encode("latin1") if isinstance(raw, str) else bytes(raw)
    if min(shape, default=0) < 0 or math.prod(shape) * dtype.itemsize != len(content):
        raise ValueError(f"an array of shape {shape} has {len(content)} bytes; it is damaged")
    return np.frombuffer(content, dtype).reshape(shape, order=order).astype(dtype.newbyteorder("="))  # type: ignore[call-overload]


def _sparse(name: str, state: dict[str, Any]) -> sparse.csc_matrix:
    kind = name.rpartition(".")[2][:3]
    shape = tuple(int(extent) for extent in state.get("_shape", state.get("shape", ())))
    if kind == "coo":
        coordinates = state["coords"] if "coords" in state else (state["row"], state["col"])
        return sparse.coo_matrix((state["data"], tuple(coordinates)), shape).tocsc()
    build = sparse.csc_matrix if kind == "csc" else sparse.csr_matrix
    matrix = build((state["data"], state["indices"], state["indptr"]), shape)
    # The compiled loops trust the indices.
    matrix.check_format(full_check=True)
    return matrix.tocsc()

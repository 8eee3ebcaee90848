"""Arrays out of pickles that others published, without letting the pickle call anything.

The machine of models.files.pickle_machine keeps what the pickle says as records; the few names
that containers of arrays need may occur in them. Nothing of numpy, scipy, chumpy or torch runs
while the pickle is read; the arrays are put together afterwards from their checked type, shape and
bytes.

Formats: pickle protocols 0 to 5 (PEP 307, PEP 574); numpy's ``ndarray.__reduce__`` and .npy version
1 to 3 (numpy.lib.format); scipy.sparse matrices by their ``__dict__``; chumpy's Ch keeps its array
under "x".
"""

from __future__ import annotations

import io
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
from scipy import sparse

from facestage.contract.errors import InputError
from facestage.contract.files.reading import MIB, read_bytes
from facestage.models.files.pickle_machine import ENCODE, Name, Record, run
from facestage.models.files.published_file import PICKLE_LIMIT

# A record can be used many times, so that what is made of it is limited too: bytes of all arrays,
# and numbers and objects of all that the dictionary holds when what is shared is counted each time.
# FLAME has 60 MB and 7 million.
ARRAY_BYTES, ITEM_LIMIT = 512 * MIB, 64_000_000
_DEPTH = 100
_NUMPY = (
    "numpy.core.multiarray",
    "numpy._core.multiarray",
    "numpy.core.numeric",
    "numpy._core.numeric",
)
_SPARSE = re.compile(r"scipy\.sparse(\._?(csc|csr|coo))?\.(csc|csr|coo)_(matrix|array)")
# Python 2 wrote copy_reg and __builtin__; torch's tensors lie in some landmark files and are never
# looked into.
_ALLOWED = {
    *(
        f"{module}.{name}"
        for module in _NUMPY
        for name in ("_reconstruct", "scalar", "_frombuffer")
    ),
    "numpy.ndarray",
    "numpy.dtype",
    "chumpy.ch.Ch",
    "chumpy.Ch",
    ENCODE,
    "collections.OrderedDict",
    "copy_reg._reconstructor",
    "copyreg._reconstructor",
    "__builtin__.object",
    "builtins.object",
    "__builtin__.bytes",
    "builtins.bytes",
    "__builtin__.set",
    "builtins.set",
    "torch._utils._rebuild_tensor_v2",
    "torch.storage._load_from_bytes",
}
_PLAIN_TYPE = re.compile(r"[iufb][1248]")


def read_pickle(path: Path, what: str) -> dict[str, Any]:
    """The dictionary in a pickle or in an .npy of one object: arrays, sparse matrices, numbers,
    text, lists.

    Raises InputError, having executed nothing, when the file is no pickle, asks for anything but
    arrays, or does not hold a dictionary. ``what`` names the file in messages.
    """
    content = read_bytes(Path(path), what, PICKLE_LIMIT)
    if content[:200].lstrip().lower().startswith((b"<!doctype", b"<html", b"<?xml")):
        raise InputError(
            f"The {what} '{path}' is a web page, not the file; log in there and download it again."
        )
    try:
        data = _Resolver().resolve(run(_pickled(content), _is_allowed))
    # Whatever a damaged or hostile stream makes the reader raise, its answer is the same sentence.
    except Exception as error:
        reason = " ".join(str(error).split()).rstrip(".")[:200] or type(error).__name__
        raise InputError(
            f"The {what} '{path}' is refused: expected a pickle of plain arrays, but {reason}; "
            "nothing in it was executed."
        ) from error
    if not isinstance(data, dict):
        raise InputError(
            f"The {what} '{path}' holds a {type(data).__name__}, expected a dictionary of arrays."
        )
    return {str(key): value for key, value in data.items()}


def _is_allowed(full: str) -> bool:
    return full in _ALLOWED or _SPARSE.fullmatch(full) is not None


def _pickled(content: bytes) -> bytes:
    """The pickle stream itself: an .npy of objects has a header before it."""
    if not content.startswith(np.lib.format.MAGIC_PREFIX):
        return content
    stream = io.BytesIO(content)
    version = np.lib.format.read_magic(stream)
    read = (
        np.lib.format.read_array_header_1_0
        if version == (1, 0)
        else np.lib.format.read_array_header_2_0
    )
    _, _, dtype = read(stream)
    if not dtype.hasobject:
        raise ValueError("it holds a single array")
    return stream.read()


class _Resolver:
    """Turns records into arrays, each once however often it is used; a record that stands for none
    stays one.
    """

    def __init__(self) -> None:
        # By identity: the value, what it became, and how many items that is when everything shared
        # is written out.
        self.done: dict[int, tuple[Any, Any, int]] = {}
        self.open: set[int] = set()
        self.left = ARRAY_BYTES

    def resolve(self, value: Any) -> Any:
        return self._visit(value)[0]

    def _visit(self, value: Any) -> tuple[Any, int]:
        if not isinstance(value, dict | list | tuple | Record):
            return value, 1
        if id(value) in self.done:
            return self.done[id(value)][1:]
        if id(value) in self.open:
            raise ValueError("it contains itself")
        if len(self.open) >= _DEPTH:
            raise ValueError(f"it is nested more than {_DEPTH} deep")
        self.open.add(id(value))
        result, items = self._built(value)
        if items > ITEM_LIMIT:
            raise ValueError(f"it unpacks to more than {ITEM_LIMIT // 10**6} million numbers")
        self.open.discard(id(value))
        self.done[id(value)] = value, result, items
        return result, items

    def _built(self, value: Any) -> tuple[Any, int]:
        if isinstance(value, Record):
            result = self._record(value)
            size = result.size if isinstance(result, np.ndarray) else 1
            return result, math.prod(result.shape) if sparse.issparse(result) else size
        if isinstance(value, dict):
            pairs = [(key, self._visit(item)) for key, item in value.items()]
            return {key: result for key, (result, _) in pairs}, 1 + sum(
                items for _, (_, items) in pairs
            )
        found = [self._visit(item) for item in value]
        return type(value)(result for result, _ in found), 1 + sum(items for _, items in found)

    def _record(self, record: Record) -> Any:
        name, state = record.function.full, record.state
        if name.endswith("._reconstructor") and isinstance(record.args[0], Name):
            name = record.args[0].full
        if name.endswith("._reconstruct"):
            # Old numpy wrote no version number before the shape.
            shape, dtype, fortran, raw = state[-4:]
            return self._array(raw, dtype, shape, "F" if fortran else "C")
        if name.endswith("._frombuffer"):
            raw, dtype, shape, order = record.args
            return self._array(raw, dtype, shape, order)
        if name.endswith(".scalar"):
            return self._array(record.args[1], record.args[0], (), "C")[()]
        if name.startswith("chumpy."):
            array = self.resolve(state["x"])
            if not isinstance(array, np.ndarray):
                raise ValueError("it holds a chumpy object without an array")
            return array
        if _SPARSE.fullmatch(name):
            return _sparse(name, self.resolve(state))
        if name == ENCODE:
            self._take(len(record.args[0]))
            return str(record.args[0]).encode("latin1")
        return b"" if name.endswith(".bytes") else record

    def _array(self, raw: Any, record: Any, shape: Any, order: str) -> Any:
        """An array from its bytes; a list for one of objects."""
        if not isinstance(record, Record) or record.function.full != "numpy.dtype":
            raise ValueError("it holds an array without a type")
        raw, code = self.resolve(raw), str(self.resolve(record.args[0]))
        shape = tuple(int(extent) for extent in shape)
        if code.startswith("O"):
            return raw[0] if shape == () else list(raw)
        if not _PLAIN_TYPE.fullmatch(code):
            raise ValueError(f"it holds an array of type '{code[:20]}'")
        byte_order = str(record.state[1]) if record.state else "<"
        dtype = np.dtype(code).newbyteorder(">" if byte_order == ">" else "<")
        if not isinstance(raw, str | bytes | bytearray):
            raise ValueError(f"it holds an array with a {type(raw).__name__} for its bytes")
        if min(shape, default=0) < 0 or math.prod(shape) * dtype.itemsize != len(raw):
            raise ValueError(f"an array of shape {shape} has {len(raw)} bytes; it is damaged")
        self._take(len(raw))
        content = raw.encode("latin1") if isinstance(raw, str) else raw
        plain = np.frombuffer(content, dtype).reshape(shape, order=order)  # type: ignore[call-overload]
        return plain.astype(dtype.newbyteorder("="))

    def _take(self, count: int) -> None:
        self.left -= count
        if self.left < 0:
            raise ValueError(f"its arrays have more than {ARRAY_BYTES // MIB} MiB")


def _sparse(name: str, state: dict[str, Any]) -> sparse.csc_matrix:
    kind = name.rpartition(".")[2][:3]
    shape = tuple(int(extent) for extent in state.get("_shape", state.get("shape", ())))
    # Written out, as whoever uses it does; an empty matrix has no more rows or columns than any
    # other.
    if len(shape) != 2 or min(shape) < 0 or max(*shape, math.prod(shape)) > ITEM_LIMIT:
        raise ValueError(f"it holds a sparse matrix of shape {str(shape)[:80]}")
    if kind == "coo":
        coordinates = state["coords"] if "coords" in state else (state["row"], state["col"])
        row, column = (_vector(part, "iu") for part in coordinates)
        return sparse.coo_matrix((_vector(state["data"], "iufb"), (row, column)), shape).tocsc()
    parts = (
        _vector(state["data"], "iufb"),
        _vector(state["indices"], "iu"),
        _vector(state["indptr"], "iu"),
    )
    matrix = (sparse.csc_matrix if kind == "csc" else sparse.csr_matrix)(parts, shape)
    # The compiled loops trust the indices.
    matrix.check_format(full_check=True)
    return matrix.tocsc()


def _vector(value: Any, kinds: str) -> np.ndarray:
    if not isinstance(value, np.ndarray) or value.ndim != 1 or value.dtype.kind not in kinds:
        raise ValueError("it holds a sparse matrix whose parts are no lists of numbers")
    return value

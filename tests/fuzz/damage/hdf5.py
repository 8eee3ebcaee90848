"""Damage to HDF5 files behind right checksums: other types and sizes, links that lead out, data
that is elsewhere.
"""

from __future__ import annotations

import io

import h5py
import numpy as np

from fuzz.choice import Choose
from fuzz.damage.arrays import mangle_array
from fuzz.damage.bytes import mangle_bytes

TEXTS = (
    b"",
    b"[]",
    b"{}",
    b"[" * 5000,
    b"null",
    b'[{"id": 5}]',
    b'[{"id": "a", "coordinates": [1e400, 0, 0]}]',
    b"\xff",
)


def mangle_hdf5(choose: Choose, data: bytes) -> bytes:
    if choose.chance(2):
        return mangle_bytes(choose, data)
    stream = io.BytesIO(data)
    try:
        with h5py.File(stream, "r+") as file:
            names: list[str] = []
            file.visit(names.append)
            name = choose.one_of(names)
            old = file[name]
            array = old[()] if isinstance(old, h5py.Dataset) else None
            del file[name]
            _put(choose, file, name, array)
    # A file that was damaged before may make h5py raise anything.
    except Exception:  # noqa: BLE001
        return mangle_bytes(choose, data)
    return stream.getvalue()


def _put(choose: Choose, file: h5py.File, name: str, array: np.ndarray | bytes | None) -> None:
    """Something else under ``name``, or nothing."""
    kind = choose.number(0, 11)
    if kind < 5 and isinstance(array, np.ndarray) and array.dtype.kind in "iuf":
        file[name] = mangle_array(choose, array)
    elif kind == 5:
        file[name] = h5py.ExternalLink("/etc/passwd", "/x")
    elif kind == 6:
        file[name] = h5py.SoftLink(choose.one_of(("/", f"/{name}", "/shape", "/nowhere")))
    elif kind == 7:
        external = [("/etc/passwd", 0, 24), ("/dev/zero", 0, h5py.h5f.UNLIMITED)]
        file.create_dataset(name, (3,), "f8", external=external[:1])
    elif kind == 8:
        layout = h5py.VirtualLayout((9,), "f8")
        layout[:] = h5py.VirtualSource("/etc/passwd", "x", (9,))
        file.create_virtual_dataset(name, layout)
    elif kind == 9:
        shape = choose.one_of(((300_000_000,), (3, 200_000_000), (2**40,), (900, 300_000), ()))
        file.create_dataset(
            name, shape, "f4", chunks=True if shape else None, fillvalue=1.0 if shape else None
        )
    elif kind == 10:
        file[name] = choose.one_of(TEXTS)
    elif kind == 11:
        file.create_group(name)

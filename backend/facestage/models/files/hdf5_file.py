"""Arrays of an HDF5 file that others published; only for a child process (system.in_child).

An HDF5 file can name other files as parts of itself: links to their objects, raw files as a
dataset's storage, and virtual datasets. It can also ask for filters that HDF5 loads as plugins.
Each is refused before anything is read.
"""

from __future__ import annotations

import math
import posixpath
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from facestage.contract.files.reading import MIB

# Of one chunk, which is unpacked as a whole, of all arrays, and of a text.
CHUNK_LIMIT, TOTAL_LIMIT, TEXT_LIMIT = 256 * MIB, 1024 * MIB, 1 * MIB
_FILTERS = {h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32}
_SOFT_LINKS = 8


def read_hdf5(path: Path, names: Sequence[str]) -> dict[str, np.ndarray]:
    """The datasets of ``names`` that the file has: numbers as they are, one text as its UTF-8
    bytes, uint8.

    Raises ValueError for anything that leads out of the file or is larger than is expected, and
    what h5py raises.
    """
    arrays: dict[str, np.ndarray] = {}
    total = 0
    with h5py.File(path, "r") as file:
        for name in names:
            dataset = _dataset(file, name)
            if dataset is None:
                continue
            _check_storage(name, dataset)
            total += dataset.size * dataset.dtype.itemsize
            if total > TOTAL_LIMIT:
                raise ValueError(
                    f"with {name} its arrays have {total / MIB:.0f} MiB, expected at most "
                    f"{TOTAL_LIMIT // MIB} MiB"
                )
            arrays[name] = _numbers(name, dataset)
    return arrays


def _dataset(file: Any, name: str, links: int = _SOFT_LINKS) -> Any:
    """The dataset called ``name``, None where there is none; every link of its path is looked at
    before it is taken.
    """
    parts = [part for part in name.split("/") if part]
    group, place = file, "/"
    for index, part in enumerate(parts):
        link = group.get(part, getlink=True) if isinstance(group, h5py.Group) else None
        if link is None:
            return None
        if isinstance(link, h5py.SoftLink):
            if not links:
                raise ValueError(f"{name} is a chain of links that does not end")
            target = posixpath.normpath(posixpath.join(place, link.path, *parts[index + 1 :]))
            return _dataset(file, target, links - 1)
        if not isinstance(link, h5py.HardLink):
            raise ValueError(f"{name} is a link to another file")
        group, place = group[part], posixpath.join(place, part)
    return group if isinstance(group, h5py.Dataset) else None


def _check_storage(name: str, dataset: Any) -> None:
    if dataset.is_virtual or dataset.external:
        raise ValueError(f"{name} is kept in another file")
    properties = dataset.id.get_create_plist()
    for index in range(properties.get_nfilters()):
        code, _, _, label = properties.get_filter(index)
        if code not in _FILTERS:
            said = label.decode("ascii", "replace")[:20] or "?"
            raise ValueError(
                f"{name} is packed by the filter {said} ({code}), expected none or gzip"
            )
    if dataset.shape is None:
        raise ValueError(f"{name} holds nothing")
    if (
        dataset.chunks is not None
        and math.prod(dataset.chunks) * dataset.dtype.itemsize > CHUNK_LIMIT
    ):
        raise ValueError(f"{name} has chunks of more than {CHUNK_LIMIT // MIB} MiB")


def _numbers(name: str, dataset: Any) -> np.ndarray:
    if h5py.check_string_dtype(dataset.dtype) is not None and dataset.size == 1:
        text = np.asarray(dataset[()]).reshape(-1)[0]
        content = text.encode() if isinstance(text, str) else bytes(text)
        if len(content) > TEXT_LIMIT:
            raise ValueError(
                f"{name} has a text of {len(content)} bytes, expected at most {TEXT_LIMIT}"
            )
        return np.frombuffer(content, np.uint8)
    if dataset.dtype.kind not in "iuf" or dataset.dtype.itemsize > 8:
        raise ValueError(f"{name} is of type {dataset.dtype}, expected plain numbers")
    return np.asarray(dataset[()])

"""Arrays of a MATLAB file; only for a child process (system.in_child), which may crash."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np


def read_mat(path: Path, names: Sequence[str]) -> dict[str, np.ndarray]:
    """The arrays of ``names`` that the file has.

    Raises almost anything for a file that is damaged.
    """
    import scipy.io

    found = scipy.io.loadmat(path, variable_names=tuple(names))
    arrays = {name: found[name] for name in names if name in found}
    for name, array in arrays.items():
        if (
            not isinstance(array, np.ndarray)
            or array.dtype.kind not in "iuf"
            or array.dtype.itemsize > 8
        ):
            kind = array.dtype if isinstance(array, np.ndarray) else type(array).__name__
            raise ValueError(f"{name} is of type {kind}, expected plain numbers")
    return arrays

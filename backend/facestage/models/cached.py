"""Face models that were built once, on disk: the newest of them."""

from __future__ import annotations

import contextlib
import hashlib
import os
import sys
from collections.abc import Callable
from pathlib import Path

from facestage.contract.errors import InputError
from facestage.contract.face_model import FaceModel
from facestage.system.folders import cache_folder

# A model takes 35 to 80 MB, and each version of Facestage, or of an artist's rig, makes one anew.
KEPT = 12


def cached(name: str, key: str, build: Callable[[], FaceModel]) -> FaceModel:
    """The model from the cache, or built and then cached; an unwritable cache only costs time.

    ``key`` changes when the model does. Of all models the ``KEPT`` that were used last stay.
    """
    file = f"{name}-{hashlib.sha256(key.encode()).hexdigest()[:16]}.npz"
    # Without a cache, or with one that is damaged or cannot be read, the model is built anew.
    with contextlib.suppress(InputError, OSError):
        path = cache_folder() / "models" / file
        if path.is_file():
            model = FaceModel.load(path)
            with contextlib.suppress(OSError):
                os.utime(path)
            return model
    model = build()
    try:
        folder = cache_folder() / "models"
        model.save(folder / file)
        _forget(folder)
    except (InputError, OSError) as error:
        print(f"facestage: the converted face model is not cached ({error})", file=sys.stderr)
    return model


def _forget(folder: Path) -> None:
    """Remove the models that were not used for the longest time."""
    used = []
    for path in folder.glob("*-*.npz"):
        # Another process may have removed it.
        with contextlib.suppress(OSError):
            used.append((path.stat().st_mtime_ns, path))
    for _, path in sorted(used)[:-KEPT]:
        # Somebody else's, or being read on Windows.
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True)

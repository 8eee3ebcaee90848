"""From a model's specification (``default``, ``ict:PATH``, ...) to a face model, cached on disk."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable
from pathlib import Path

from facestage import __version__
from facestage.contract.errors import InputError
from facestage.contract.face_model import FaceModel
from facestage.folders import cache_folder

# Raise when a loader's output changes, so that stale conversions are not read.
CACHE_VERSION = 1
KINDS = "default, ict:PATH, npz:PATH or rig:FILE"


def load_model(specification: str) -> FaceModel:
    """The face model a job names. Raises InputError for an unknown kind or an unreadable file."""
    kind, _, argument = specification.partition(":")
    if kind == "default" and not argument:
        return _cached("default", _source_fingerprint(), _build_default)
    if kind == "npz" and argument:
        return FaceModel.load(Path(argument).expanduser())
    if kind == "ict" and argument:
        path = Path(argument).expanduser().resolve()
        return _cached("ict", f"{path}|{_fingerprint(path)}|{_source_fingerprint()}", lambda: _load_ict(path))
    if kind == "rig" and argument:
        path = Path(argument).expanduser().resolve()
        return _cached("rig", f"{path}|{_fingerprint(path)}|{_source_fingerprint()}", lambda: _load_rig(path))
    raise InputError(f"The face model '{specification}' is unknown; expected {KINDS}.")


def _build_default() -> FaceModel:
    from facestage.models.default_head import build_default_model

    return build_default_model()


def _load_ict(path: Path) -> FaceModel:
    from facestage.models.ict import load_ict

    return load_ict(path)


def _load_rig(path: Path) -> FaceModel:
    from facestage.models.rig import load_rig

    return load_rig(path)


def _fingerprint(path: Path) -> str:
    """Changes when the file, or the first level of the folder, changes."""
    try:
        stat = path.stat()
    except OSError:
        return "absent"
    return f"{stat.st_size}-{stat.st_mtime_ns}"


def _source_fingerprint() -> str:
    """Changes when the code or the data that builds models changes."""
    digest = hashlib.sha256(f"{__version__}-{CACHE_VERSION}".encode())
    folder = Path(__file__).parent
    for file in sorted([*folder.rglob("*.py"), *folder.rglob("data/*.npz")]):
        digest.update(file.read_bytes())
    return digest.hexdigest()


def _cached(name: str, key: str, build: Callable[[], FaceModel]) -> FaceModel:
    """The model from the cache, or built and then cached; an unwritable cache only costs time."""
    path = cache_folder() / "models" / f"{name}-{hashlib.sha256(key.encode()).hexdigest()[:16]}.npz"
    if path.is_file():
        try:
            return FaceModel.load(path)
        except InputError:
            path.unlink(missing_ok=True)
    model = build()
    try:
        model.save(path)
    except (InputError, OSError) as error:
        print(f"facestage: the converted face model is not cached ({error})", file=sys.stderr)
    return model

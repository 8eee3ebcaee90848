"""From a model's specification (``default``, ``ict:PATH``, ...) to a face model, cached on disk."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

from facestage import __version__
from facestage.contract.errors import InputError
from facestage.contract.face_model import FaceModel
from facestage.contract.files.paths import user_path
from facestage.contract.job import DEFAULT_MODEL, MODEL_FORMS
from facestage.contract.wording import quoted
from facestage.models.cached import cached

# Raise when a loader's output changes, so that stale conversions are not read.
CACHE_VERSION = 1
# What loaders look for beside a model, and what a model's own file is called in a folder.
_BESIDE = (
    "landmark_embedding.npy",
    "flame_static_embedding.pkl",
    "FLAME_texture.npz",
    "flame_texture.npz",
    "albedoModel2020_FLAME_albedoPart.npz",
    "head_sparse_68.txt",
    "../../landmarks/head_sparse_68.txt",
)
_MODEL_SUFFIXES = (".pkl", ".npz", ".mat", ".h5")


def load_model(specification: str) -> FaceModel:
    """The face model a job names. Raises InputError for an unknown kind or an unreadable file."""
    kind, _, argument = specification.partition(":")
    if kind == DEFAULT_MODEL and not argument:
        return cached("default", _source_fingerprint(), _build_default)
    if kind == "npz" and argument:
        return FaceModel.load(_path(argument))
    loaders = {
        "ict": _load_ict,
        "flame": _load_flame,
        "bfm": _load_bfm,
        "gnm": _load_gnm,
        "rig": _load_rig,
    }
    if kind in loaders and argument:
        path = _path(argument)
        key = f"{path}|{_fingerprint(path)}|{_source_fingerprint()}"
        return cached(kind, key, lambda: _converted(loaders[kind], path))
    raise InputError(f"The face model '{specification}' is unknown; expected {MODEL_FORMS}.")


def default_model() -> FaceModel:
    """The default head."""
    return load_model(DEFAULT_MODEL)


def _path(text: str) -> Path:
    """The absolute path that a user gave. Raises InputError for one that cannot be."""
    path = user_path(text, "face model's path")
    try:
        return path.resolve()
    # A loop of links.
    except (RuntimeError, OSError) as error:
        raise InputError(
            f"The path {quoted(text)} of the face model cannot be used: {error}."
        ) from error


def _converted(load: Callable[[Path], FaceModel], path: Path) -> FaceModel:
    """The model of a foreign file.

    Its parts may be as published and its numbers still be no face's.
    """
    try:
        return load(path)
    except (ValueError, ArithmeticError, LookupError, TypeError) as error:
        raise InputError(
            f"The face model '{path}' is damaged, its numbers are no face's ({_short(error)}); "
            "fetch it again."
        ) from error


def _short(error: Exception) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__


def _build_default() -> FaceModel:
    from facestage.models.head.default_head import build_default_model

    return build_default_model()


def _load_ict(path: Path) -> FaceModel:
    from facestage.models.loaders.ict import load_ict

    return load_ict(path)


def _load_rig(path: Path) -> FaceModel:
    from facestage.models.loaders.rig import load_rig

    return load_rig(path, default_model)


def _load_flame(path: Path) -> FaceModel:
    from facestage.models.loaders.flame import load_flame

    return load_flame(path, default_model)


def _load_bfm(path: Path) -> FaceModel:
    from facestage.models.loaders.bfm import load_bfm

    return load_bfm(path, default_model)


def _load_gnm(path: Path) -> FaceModel:
    from facestage.models.loaders.gnm import load_gnm

    return load_gnm(path, default_model)


def _fingerprint(path: Path) -> str:
    """Changes when the file, or a file that its loader looks for beside it, or the folder's first
    level changes.
    """
    # What cannot be looked at is the loader's to name.
    try:
        items = sorted(path.iterdir()) if path.is_dir() else None
    except OSError:
        items = None
    folder = path.parent if items is None else path
    watched = [path, *(folder / name for name in _BESIDE)]
    watched += [item for item in items or () if item.suffix.lower() in _MODEL_SUFFIXES]
    return "|".join(_state(item) for item in watched)


def _state(path: Path) -> str:
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

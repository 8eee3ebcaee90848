"""The landmark model on disk: MediaPipe's Face Landmarker bundle, looked up, checked, or fetched
once.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import zipfile
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

from facestage.contract.errors import InputError
from facestage.contract.files.paths import user_path
from facestage.contract.files.reading import MIB, read_bytes
from facestage.contract.online import OFFLINE_VARIABLE, is_offline
from facestage.system.folders import cache_folder, data_folder

FILE_NAME = "face_landmarker.task"
URL = f"https://storage.googleapis.com/mediapipe-models/face_landmarker/face_landmarker/float16/1/{FILE_NAME}"
SHA256 = "64184e229b263107bc2b804c6625db1341ff2bb731874b0bcc2fe6544e0bc9ff"
VARIABLE = "FACESTAGE_LANDMARK_MODEL"
DETECTOR, MESH = "face_detector.tflite", "face_landmarks_detector.tflite"
GEOMETRY = "geometry_pipeline_metadata_landmarks.binarypb"
SIZE_LIMIT = 16 * MIB  # it has 3.7 MB
TIMEOUT = 15.0  # seconds without a byte from the server


@dataclass(frozen=True)
class Bundle:
    """The members of a checked bundle that are used, as bytes."""

    path: Path
    detector: bytes
    mesh: bytes
    geometry: bytes


def cached_path() -> Path:
    """Where a fetched model is kept, and where one may be put by hand."""
    return cache_folder() / "landmarks" / FILE_NAME


def find_model(chosen: Path | None = None) -> Path | None:
    """The model's file on this machine, or None: ``chosen``, $FACESTAGE_LANDMARK_MODEL, the cache,
    the data folder.

    A file that the user names must be there and be the right one; InputError otherwise.
    """
    path = _found(chosen)
    return None if path is None else path[0]


def open_model(chosen: Path | None = None) -> Bundle:
    """The landmark model, fetched from its public home when it is not on this machine.

    Raises InputError for a file that is not the expected one, or when the model can neither be
    found nor fetched.
    """
    path, data = _found(chosen) or _fetch()
    # Its networks are read by C code that trusts them: only these very bytes are.
    with zipfile.ZipFile(BytesIO(data)) as archive:
        return Bundle(path, archive.read(DETECTOR), archive.read(MESH), archive.read(GEOMETRY))


def _found(chosen: Path | None) -> tuple[Path, bytes] | None:
    """The model on this machine: its path, and its bytes, checked."""
    variable = os.environ.get(VARIABLE)
    for path, name in (
        (chosen, "landmark model"),
        (Path(variable) if variable else None, f"landmark model ${VARIABLE}"),
    ):
        if path is not None:
            return path, _checked(path, name)
    for place in (cached_path, lambda: data_folder() / FILE_NAME):
        # What nobody named is passed over when it is damaged, or when there is no cache.
        with contextlib.suppress(InputError):
            path = place()
            return path, _checked(path, "landmark model")
    return None


def _checked(path: Path, name: str) -> bytes:
    """The bytes of ``path`` if it is the model. Raises InputError."""
    data = read_bytes(user_path(path, name), name, SIZE_LIMIT)
    if _digest(data) != SHA256:
        raise InputError(
            f"The {name} '{path}' ({len(data)} bytes) is not the expected file (SHA-256 "
            f"{SHA256[:16]}...): damaged, or another version; fetch it again from {URL}."
        )
    return data


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _fetch() -> tuple[Path, bytes]:
    """Download into the cache, checked and whole. Raises InputError."""
    if is_offline():
        raise InputError(
            f"Finding the face needs the landmark model {FILE_NAME} (3.7 MB), which is not on this "
            f"machine, and downloads are off (${OFFLINE_VARIABLE}, or Blender's Preferences > "
            f"System > Network); allow them, or {_by_hand(cached_path())}."
        )
    import pooch

    # Whatever goes wrong is said once, by the error.
    pooch.get_logger().setLevel("ERROR")
    target = cached_path()
    try:
        pooch.retrieve(
            URL,
            f"sha256:{SHA256}",
            fname=target.name,
            path=target.parent,
            downloader=pooch.HTTPDownloader(timeout=TIMEOUT),
        )
        return target, _checked(target, "landmark model")
    except OSError as error:
        # requests' errors are of this kind too, with a page of text but no error number.
        reason = error.strerror or f"{type(error).__name__}; is there a network connection?"
    except ValueError:
        # pooch says so of a file with another digest, and leaves nothing behind.
        reason = "what came from there is another file"
    raise InputError(
        f"Finding the face needs the landmark model {FILE_NAME} (3.7 MB), which could not be "
        f"fetched ({reason}); {_by_hand(target)}."
    )


def _by_hand(target: Path) -> str:
    """What to do where nothing can be fetched."""
    return (
        f"download {URL} elsewhere and put it at '{target}' (or name it with --landmark-model), or "
        "give the fit --landmarks FILE.json"
    )

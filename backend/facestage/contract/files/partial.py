"""The folder beside an output in which an unfinished fit keeps what it needs to go on: its names,
and whose it is.
"""

from __future__ import annotations

import shutil
from contextlib import suppress
from pathlib import Path

from facestage.contract.errors import InputError
from facestage.contract.files.storage import write_json
from facestage.contract.files.temporaries import PREFIX

SUFFIX = ".partial"
MARKER = ".facestage-partial.json"
SCHEMA = {"facestage": "partial folder", "schema": 1}
LOCK = ".facestage-lock"
CHECKPOINT, PERSON_CHECKPOINT, PREVIEW = "checkpoint.npz", "person-checkpoint.npz", "preview.png"
# Of a sequence: what was found in its frames, how far their fit is, and the person of its
# keyframes, with the pictures that they were read from where the film is a video.
SEQUENCE_LANDMARKS, SEQUENCE_CHECKPOINT = "sequence-landmarks.npz", "sequence-checkpoint.npz"
KEYFRAMES, KEYFRAME_PICTURES = "keyframes", "keyframe-pictures"
# Of a film that is followed in pieces: a folder with what they share and one for each.
PIECES = "pieces"


def partial_folder(out: Path) -> Path:
    """Where a fit into ``out`` keeps its checkpoint and preview until it is done."""
    return out.with_name(f"{out.name}{SUFFIX}")


def make_partial(out: Path) -> Path:
    """The partial folder of ``out``, made if there is none, for one that will lock and then mark
    it.

    Raises InputError when a folder of that name holds something and is not marked: somebody else's
    is never touched. Raises OSError when it cannot be made.
    """
    partial = partial_folder(out)
    if partial.is_file():
        raise InputError(
            f"The fit keeps its checkpoint in '{partial}', which is a file; move it, or choose "
            "another --out."
        )
    partial.mkdir(parents=True, exist_ok=True)
    others = sorted(path.name for path in partial.iterdir() if not _is_temporary(path))
    if others and MARKER not in others:
        raise InputError(
            f"The folder '{partial}' holds '{others[0]}' and was not made by this version of "
            "Facestage; the fit keeps its checkpoint there: move or delete it, or choose another "
            "--out."
        )
    return partial


def mark_partial(partial: Path) -> None:
    """Say that the folder is Facestage's."""
    if not (partial / MARKER).is_file():
        write_json(partial / MARKER, SCHEMA)


def forget_checkpoint(partial: Path) -> None:
    """Remove from a marked folder what an earlier run wrote to go on."""
    for name in (CHECKPOINT, PERSON_CHECKPOINT, SEQUENCE_LANDMARKS, SEQUENCE_CHECKPOINT, PREVIEW):
        with suppress(OSError):
            (partial / name).unlink()
    for name in (KEYFRAMES, partial_folder(Path(KEYFRAMES)).name, KEYFRAME_PICTURES, PIECES):
        shutil.rmtree(partial / name, ignore_errors=True)


def has_checkpoint(partial: Path) -> bool:
    """Whether a run can go on from there."""
    names = (CHECKPOINT, PERSON_CHECKPOINT, SEQUENCE_LANDMARKS)
    return any((partial / name).is_file() for name in names)


def remove_partial(partial: Path) -> None:
    """Remove a marked folder that the caller has locked; it stays, unmarked, if it holds what is
    not Facestage's.
    """
    if not (partial / MARKER).is_file():
        return
    forget_checkpoint(partial)
    with suppress(OSError):
        for path in partial.iterdir():
            if _is_temporary(path) and path.name != LOCK:
                path.unlink()
        (partial / MARKER).unlink()
        # Last, so that nobody else comes in before.
        (partial / LOCK).unlink(missing_ok=True)
        partial.rmdir()


def _is_temporary(path: Path) -> bool:
    return path.name == LOCK or path.name.startswith(PREFIX)

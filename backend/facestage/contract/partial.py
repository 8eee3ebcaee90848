"""The folder beside an output in which an unfinished fit keeps what it needs to go on: its names, and whose it is."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from facestage.contract.errors import InputError
from facestage.contract.storage import write_json
from facestage.contract.temporaries import PREFIX

SUFFIX = ".partial"
MARKER = ".facestage-partial.json"
SCHEMA = {"facestage": "partial folder", "schema": 1}
LOCK = ".facestage-lock"
CHECKPOINT, PERSON_CHECKPOINT, PREVIEW = "checkpoint.npz", "person-checkpoint.npz", "preview.png"


def partial_folder(out: Path) -> Path:
    """Where a fit into ``out`` keeps its checkpoint and preview until it is done."""
    return out.with_name(f"{out.name}{SUFFIX}")


def take_partial(out: Path) -> Path:
    """The partial folder of ``out``, made and marked.

    Raises InputError when a folder of that name holds something and is not marked: somebody else's is never touched.
    Raises OSError when it cannot be written.
    """
    partial = partial_folder(out)
    if partial.exists() and not partial.is_dir():
        raise InputError(
            f"The file '{partial}' is where the fit keeps its checkpoint; move it, or choose another --out."
        )
    partial.mkdir(parents=True, exist_ok=True)
    if not (partial / MARKER).is_file():
        others = sorted(
            path.name for path in partial.iterdir() if path.name != LOCK and not path.name.startswith(PREFIX)
        )
        if others:
            raise InputError(
                f"The folder '{partial}' holds '{others[0]}' and was not made by this version of Facestage; the fit "
                "keeps its checkpoint there: move or delete it, or choose another --out."
            )
    write_json(partial / MARKER, SCHEMA)
    return partial


def forget_checkpoint(partial: Path) -> None:
    """Remove from a marked folder what an earlier run wrote to go on."""
    for name in (CHECKPOINT, PERSON_CHECKPOINT, PREVIEW):
        with suppress(OSError):
            (partial / name).unlink()


def has_checkpoint(partial: Path) -> bool:
    """Whether a run can go on from there."""
    return any((partial / name).is_file() for name in (CHECKPOINT, PERSON_CHECKPOINT))


def remove_partial(partial: Path) -> None:
    """Remove a marked folder; it stays, without the mark, where it holds what Facestage did not write."""
    if not (partial / MARKER).is_file():
        return
    forget_checkpoint(partial)
    with suppress(OSError):
        for path in partial.iterdir():
            if path.name.startswith(PREFIX):
                path.unlink()
        # In this order, another run that takes the folder at this moment finds nothing that is not ours.
        (partial / LOCK).unlink(missing_ok=True)
        (partial / MARKER).unlink()
        partial.rmdir()

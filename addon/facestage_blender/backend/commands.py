"""Where the backend is and what to ask it. No bpy."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from facestage.contract.errors import BackendUnavailableError

VARIABLE = "FACESTAGE_BACKEND"


def find_backend(preferred: str = "", installed: list[str] | None = None) -> list[str]:
    """The backend's command: the user's, else $FACESTAGE_BACKEND, else the ``installed`` one, else
    beside this Python, else on the PATH.

    Raises BackendUnavailableError when there is none.
    """
    for given, origin in (
        (preferred, "the add-on's preferences"),
        (os.environ.get(VARIABLE, ""), f"${VARIABLE}"),
    ):
        if given.strip():
            return _resolved(given.strip(), origin)
    if installed:
        return installed
    beside = Path(sys.executable).parent / ("facestage.exe" if os.name == "nt" else "facestage")
    if beside.is_file():
        return [str(beside)]
    found = _on_path("facestage")
    if found:
        return [found]
    raise BackendUnavailableError(
        "The Facestage backend is not installed; press Install Backend in the add-on's "
        f"preferences, or set its path there or in ${VARIABLE}."
    )


def fit_command(
    backend: list[str], jobs: Sequence[Path], out: Path, resume: bool = False
) -> list[str]:
    """The command that fits a job folder into a result folder; several, of one person, into a
    person's folder.
    """
    return [
        *backend,
        "fit",
        "--job",
        *map(str, jobs),
        *(["--same-person"] if len(jobs) > 1 else []),
        "--out",
        str(out),
        *(["--resume"] if resume else []),
    ]


def detect_command(backend: list[str], image: Path, out: Path, face: int = 1) -> list[str]:
    """The command that finds the landmarks of a photo's face; 1 is the largest."""
    return [*backend, "detect", str(image), "--out", str(out), "--face", str(face)]


def model_command(backend: list[str], spec: str, out: Path) -> list[str]:
    """The command that writes a face model in the contract's form."""
    return [*backend, "model", spec, "--out", str(out)]


def render_command(backend: list[str], result: Path) -> list[str]:
    """The command that writes the relight cache of a result folder."""
    return [*backend, "render", str(result), "--cache"]


def refit_command(
    backend: list[str],
    film: Path,
    out: Path,
    corrected: Path,
    frames: tuple[int, int] | None = None,
) -> list[str]:
    """The command that fits a sequence's folder again around frames corrected by hand; ``frames``:
    numbers of the first and the last one that may change.
    """
    reach = [] if frames is None else ["--frames", f"{frames[0]}:{frames[1]}"]
    return [*backend, "track", str(film), "--out", str(out), "--corrected", str(corrected), *reach]


def doctor_command(backend: list[str]) -> list[str]:
    """The command that reports what works on this machine."""
    return [*backend, "doctor"]


def _resolved(text: str, origin: str) -> list[str]:
    """A command line or the path of one program, checked to exist."""
    try:
        whole = Path(text).expanduser()
        words = [str(whole)] if whole.is_file() else shlex.split(text, posix=os.name != "nt")
    except (OSError, RuntimeError, ValueError) as error:
        # A home that does not exist, a quotation mark that is not closed, a name that is too long.
        raise BackendUnavailableError(
            f"The backend '{text[:80]}' set in {origin} is no command ({error}); correct it."
        ) from error
    name = words[0] if words else ""
    program = _on_path(name) if name == Path(name).name else shutil.which(name)
    if program is None:
        raise BackendUnavailableError(
            f"The backend '{name}' set in {origin} does not exist; correct the path."
        )
    return [program, *words[1:]]


def _on_path(name: str) -> str | None:
    """The program ``name`` in a folder of $PATH that is named in full: one beside a photo may be
    anybody's.
    """
    for folder in map(Path, os.get_exec_path()):
        for suffix in ("", ".exe", ".bat", ".cmd") if os.name == "nt" else ("",):
            program = folder / f"{name}{suffix}"
            if folder.is_absolute() and program.is_file() and os.access(program, os.X_OK):
                return str(program)
    return None

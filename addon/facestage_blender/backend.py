"""Where the backend is and what to ask it. No bpy."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
from pathlib import Path

from facestage.contract.errors import BackendUnavailableError

VARIABLE = "FACESTAGE_BACKEND"


def find_backend(preferred: str = "") -> list[str]:
    """The backend's command: the user's, else $FACESTAGE_BACKEND, else beside this Python, else on the PATH.

    Raises BackendUnavailableError when there is none.
    """
    for given, origin in ((preferred, "the add-on's preferences"), (os.environ.get(VARIABLE, ""), f"${VARIABLE}")):
        if given.strip():
            return _resolved(given.strip(), origin)
    beside = Path(sys.executable).parent / ("facestage.exe" if os.name == "nt" else "facestage")
    if beside.is_file():
        return [str(beside)]
    found = shutil.which("facestage")
    if found:
        return [found]
    raise BackendUnavailableError(
        "The Facestage backend was not found; install it (pip install facestage) and set its path in the add-on's "
        f"preferences or in ${VARIABLE}."
    )


def fit_command(backend: list[str], job: Path, out: Path, resume: bool = False) -> list[str]:
    """The command that fits a job folder into a result folder."""
    return [*backend, "fit", "--job", str(job), "--out", str(out), *(["--resume"] if resume else [])]


def detect_command(backend: list[str], image: Path, out: Path, face: int = 1) -> list[str]:
    """The command that finds the landmarks of a photo's face; 1 is the largest."""
    return [*backend, "detect", str(image), "--out", str(out), "--face", str(face)]


def model_command(backend: list[str], spec: str, out: Path) -> list[str]:
    """The command that writes a face model in the contract's form."""
    return [*backend, "model", spec, "--out", str(out)]


def render_command(backend: list[str], result: Path) -> list[str]:
    """The command that writes the relight cache of a result folder."""
    return [*backend, "render", str(result), "--cache"]


def doctor_command(backend: list[str]) -> list[str]:
    """The command that reports what works on this machine."""
    return [*backend, "doctor"]


def _resolved(text: str, origin: str) -> list[str]:
    """A command line or the path of one program, checked to exist."""
    whole = Path(text).expanduser()
    words = [str(whole)] if whole.is_file() else shlex.split(text, posix=os.name != "nt")
    if not shutil.which(words[0]):
        raise BackendUnavailableError(f"The backend '{words[0]}' set in {origin} does not exist; correct the path.")
    return words

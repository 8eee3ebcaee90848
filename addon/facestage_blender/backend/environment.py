"""The backend in an environment of its own, made of locked packages by install.py. No bpy."""

from __future__ import annotations

import hashlib
import os
import shutil
import sys
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from facestage.contract.errors import BackendUnavailableError

INSTALLER = Path(__file__).with_name("install.py")
STAMP = "facestage-installed.txt"  # written last: without it the environment is not whole


@dataclass(frozen=True)
class Packages:
    """What an environment is made of: both come with the extension."""

    lock: Path  # the packages' versions and digests
    wheel: Path  # the backend itself

    @classmethod
    def of_extension(cls, addon: Path) -> Packages:
        """Those in the extension's folder for this Python. Raises BackendUnavailableError."""
        python = f"{sys.version_info.major}.{sys.version_info.minor}"
        lock = addon / "requirements" / f"python{python}.txt"
        wheels = sorted((addon / "wheels").glob("facestage-*.whl"))
        if not wheels:
            raise BackendUnavailableError(
                "This copy of the add-on carries no backend to install; install the extension's "
                ".zip, or set the backend's path."
            )
        if not lock.is_file():
            raise BackendUnavailableError(
                f"The backend's packages are not known for Python {python}; install it outside "
                "Blender and set its path."
            )
        return cls(lock, wheels[-1])

    def fingerprint(self) -> str:
        """A digest that changes with any of them."""
        return _fingerprint(self.lock, self.wheel)


@lru_cache(maxsize=4)
def _fingerprint(lock: Path, wheel: Path) -> str:
    """Read once: the preferences are drawn all the time."""
    return hashlib.sha256(lock.read_bytes() + wheel.read_bytes()).hexdigest()


def environment_python(folder: Path) -> Path:
    """The environment's interpreter."""
    return folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def installed_command(folder: Path, packages: Packages) -> list[str]:
    """The command of the backend in ``folder``; empty where it is not whole, or of another
    version.
    """
    try:
        made_of = (folder / STAMP).read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError):
        return []
    python = environment_python(folder)
    if made_of != packages.fingerprint() or not python.is_file():
        return []
    return [str(python), "-P", "-m", "facestage"]


def install_command(folder: Path, packages: Packages, wheels: Path | None) -> list[str]:
    """The command that makes the environment anew, from PyPI or from the folder ``wheels``."""
    return [
        sys.executable,
        "-I",
        str(INSTALLER),
        str(folder),
        str(packages.lock),
        str(packages.wheel),
        STAMP,
        packages.fingerprint(),
        *([] if wheels is None else [str(wheels)]),
    ]


def remove_environment(folder: Path) -> None:
    """Remove the environment. Raises BackendUnavailableError where something of it is in use."""
    (folder / STAMP).unlink(missing_ok=True)
    try:
        shutil.rmtree(folder)
    except FileNotFoundError:
        return
    except OSError as error:
        raise BackendUnavailableError(
            f"'{folder}' cannot be removed ({error.strerror or error}); close what uses it and "
            "press Remove again."
        ) from error

"""Where Facestage keeps and looks for files that are not part of a job."""

from __future__ import annotations

import atexit
import os
import shutil
import sys
import tempfile
from pathlib import Path

from facestage.contract.errors import InputError


def cache_folder() -> Path:
    """The user's cache folder for Facestage ($FACESTAGE_CACHE, or the platform's own place).

    Raises InputError for a user without a home folder; what is only faster with a cache does
    without.
    """
    override = os.environ.get("FACESTAGE_CACHE")
    if override:
        return Path(override)
    named = {"win32": "LOCALAPPDATA"}.get(sys.platform, "XDG_CACHE_HOME")
    base = Path(os.environ.get(named, ""))
    # A relative one would be wherever the user happens to be, and the standard says to pass it
    # over.
    if base.is_absolute() and sys.platform != "darwin":
        return base / "facestage"
    if sys.platform == "win32":
        return _home() / "facestage"
    if sys.platform == "darwin":
        return _home() / "Library" / "Caches" / "facestage"
    return _home() / ".cache" / "facestage"


def data_folder() -> Path:
    """Data that is not part of the project ($FACESTAGE_DATA, or shared/data beside the source
    tree); may be absent.
    """
    return Path(
        os.environ.get("FACESTAGE_DATA", Path(__file__).resolve().parents[4] / "shared" / "data")
    )


def _home() -> Path:
    try:
        home = Path.home()
    except RuntimeError as error:
        raise _homeless() from error
    if not home.is_absolute():
        raise _homeless()
    return home


def _homeless() -> InputError:
    return InputError(
        "This user has no home folder, so there is no place for Facestage's cache; set "
        "FACESTAGE_CACHE to a folder that you may write to."
    )


def shelter_caches() -> None:
    """Give libraries whose own place for their caches cannot be used one that is removed when the
    process ends.

    They would say so in warnings of several lines, or put it into the current folder.
    """
    if os.name != "posix":
        return
    home = os.environ.get("HOME")
    for variable, places in _LIBRARY_CACHES.items():
        if variable in os.environ or (home and all(_usable(Path(home, place)) for place in places)):
            continue
        folder = tempfile.mkdtemp(prefix="facestage-cache-")
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        os.environ[variable] = folder


# Where Dr.Jit keeps compiled kernels, and Matplotlib its settings and its list of fonts.
_LIBRARY_CACHES = {
    "DRJIT_CACHE_DIR": (".drjit",),
    "MPLCONFIGDIR": (".config/matplotlib", ".cache/matplotlib"),
}


def _usable(folder: Path) -> bool:
    """Whether the folder can be read and written, or made."""
    while not os.path.exists(folder) and folder != folder.parent:  # noqa: PTH110 - Path's raises where it may not look
        folder = folder.parent
    is_folder = os.path.isdir(folder)  # noqa: PTH112 - Path's raises where it may not look
    return folder.is_absolute() and is_folder and os.access(folder, os.R_OK | os.W_OK | os.X_OK)

"""Where Facestage keeps and looks for files that are not part of a job."""

from __future__ import annotations

import os
import sys
from pathlib import Path


def cache_folder() -> Path:
    """The user's cache folder for Facestage ($FACESTAGE_CACHE, or the platform's own place)."""
    override = os.environ.get("FACESTAGE_CACHE")
    if override:
        return Path(override)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home())) / "facestage"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "facestage"
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "facestage"


def data_folder() -> Path:
    """Data that is not part of the project ($FACESTAGE_DATA, or shared/data beside the source tree); may be absent."""
    return Path(os.environ.get("FACESTAGE_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))

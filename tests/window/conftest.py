"""Blender's window for the tests of this folder, which only `make test-window` runs."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from window.blender import Blender, missing, screen

os.environ["OPENCV_IO_ENABLE_OPENEXR"] = "1"  # before anything imports OpenCV
ADDON = "bpy.context.preferences.addons['bl_ext.user_default.facestage_blender']"
VARIABLE = "FACESTAGE_WINDOW"


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    """Leave this folder out of `make test`."""
    return True if VARIABLE not in os.environ and collection_path.name != "conftest.py" else None


@pytest.fixture(scope="session")
def blender(repository: Path) -> Iterator[Blender]:
    """Blender with its default scene, the built extension installed and the backend set."""
    root = Path(os.environ[VARIABLE]).expanduser().resolve()
    why = missing(root)
    if why:
        pytest.skip(why)
    archives = sorted((repository / "dist").glob("facestage_blender-*.zip"))
    assert archives, "make extension has built nothing"
    out = Path(os.environ.get("FACESTAGE_WINDOW_OUT", repository / "out" / "window")).resolve()
    out.mkdir(parents=True, exist_ok=True)
    for old in out.glob("*.png"):
        old.unlink()
    with screen() as display:
        blender = Blender(root, repository, out, display)
        install = ["--command", "extension", "install-file", "--repo", "user_default", "--enable"]
        blender.console([*install, str(archives[-1])])
        blender.start()
        try:
            blender.do(f"{ADDON}.preferences.backend = {str(blender.backend)!r}")
            yield blender
        finally:
            blender.stop()

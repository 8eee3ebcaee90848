"""Fixtures that every test may use."""

from __future__ import annotations

import os
from pathlib import Path

import hypothesis
import pytest

# The same examples on every run, and no failure because a machine is slow.
hypothesis.settings.register_profile("facestage", derandomize=True, deadline=None)
hypothesis.settings.load_profile("facestage")

REPOSITORY = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def repository() -> Path:
    """The root of the project's working tree."""
    return REPOSITORY


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of face models and reference cases ($FACESTAGE_DATA, or shared/data beside the
    project).

    A test that asks for it is skipped where the folder is absent: the data is not part of the
    project.
    """
    folder = Path(os.environ.get("FACESTAGE_DATA", REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"needs the shared data folder, which is not at {folder}; set FACESTAGE_DATA")
    return folder

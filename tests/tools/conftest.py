"""Scripts of tools/, which are no package."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture
def tools(repository: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the scripts of tools/ importable."""
    monkeypatch.syspath_prepend(str(repository / "tools"))

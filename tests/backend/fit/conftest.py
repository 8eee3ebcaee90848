"""The renderer and two synthetic scenes, built once."""

from __future__ import annotations

import pytest

from reference.synthetic_scene import Scene, synthetic_scene


@pytest.fixture(scope="session")
def renderer() -> str:
    """The CPU renderer: the same numbers on every machine."""
    from facestage.render.variant import start_renderer

    return start_renderer("cpu")


@pytest.fixture(scope="session")
def scene(renderer: str) -> Scene:
    """Every light has its own color."""
    return synthetic_scene()


@pytest.fixture(scope="session")
def uniform_scene(renderer: str) -> Scene:
    """All lights share one color."""
    return synthetic_scene(uniform=True)

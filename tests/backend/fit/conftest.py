"""The renderer and two synthetic scenes, built once."""

from __future__ import annotations

import pytest

from facestage.fit.given.fineness import Fineness
from reference.small_fit import SMALL
from reference.synthetic_case import Case, write_case
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


@pytest.fixture(scope="session")
def case(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Case:
    """The first scene as files."""
    return write_case(tmp_path_factory.mktemp("case"), scene)


@pytest.fixture
def small_maps() -> Fineness:
    """For ``fit_job`` and ``read_problem``: textures of a size that fits a photo of 96 pixels."""
    return SMALL

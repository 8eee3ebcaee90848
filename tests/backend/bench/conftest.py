"""A tiny case, opened once, and settings under which it is fitted in seconds."""

from __future__ import annotations

import pytest

from facestage.bench.cases import Case
from facestage.bench.trace import Judge
from facestage.fit.given.problem import Problem
from facestage.fit.given.truth import Truth
from reference.synthetic_case import write_case
from reference.synthetic_scene import Scene, synthetic_scene
from reference.tiny_bench import SHORT


@pytest.fixture(scope="session")
def scene() -> Scene:
    from facestage.render.variant import start_renderer

    start_renderer("cpu")
    return synthetic_scene()


@pytest.fixture(scope="session")
def case(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Case:
    files = write_case(tmp_path_factory.mktemp("tiny"), scene)
    return Case("tiny", files.photo.parent, files.model_option)


@pytest.fixture(scope="session")
def opened(case: Case) -> tuple[Problem, Truth, Judge]:
    from facestage.bench.run import open_case

    return open_case(case, "cpu", fineness=SHORT)

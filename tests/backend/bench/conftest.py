"""A tiny case, opened once, and settings under which it is fitted in seconds."""

from __future__ import annotations

from dataclasses import replace

import pytest

from facestage.bench.cases import Case
from facestage.bench.trace import Judge
from facestage.fit import phases
from facestage.fit.problem import Problem
from facestage.fit.truth import Truth
from reference.synthetic_case import write_case
from reference.synthetic_scene import Scene, synthetic_scene


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

    return open_case(case, "cpu")


@pytest.fixture(autouse=True)
def small_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Textures of a size that fits a photo of 96 pixels, and two steps per photo phase."""
    monkeypatch.setattr("facestage.fit.view.SPECULAR_SIZE", 6)
    monkeypatch.setattr("facestage.fit.refine.TEXTURE_MIN", 64)
    monkeypatch.setattr("facestage.fit.refine.TEXTURE_MAX", 64)
    monkeypatch.setattr("facestage.fit.refine.SPECULAR_TEXTURE", 32)
    short = tuple(replace(phase, steps=min(phase.steps, 2)) if phase.face_px else phase for phase in phases.PHASES)
    monkeypatch.setattr(phases, "PHASES", short)

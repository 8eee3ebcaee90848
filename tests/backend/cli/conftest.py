"""A small photo with all its files, and one whole fit of it."""

from __future__ import annotations

import pytest

from reference.command_line import Finished, call, fit_arguments
from reference.synthetic_case import Case, write_case
from reference.synthetic_scene import synthetic_scene


@pytest.fixture(scope="session")
def case(tmp_path_factory: pytest.TempPathFactory) -> Case:
    from facestage.render.variant import start_renderer

    start_renderer("cpu")
    return write_case(tmp_path_factory.mktemp("case"), synthetic_scene())


@pytest.fixture(scope="session")
def finished(case: Case, tmp_path_factory: pytest.TempPathFactory) -> Finished:
    """The result folder of a fit that nothing disturbed, and what it said."""
    out = tmp_path_factory.mktemp("finished") / "out"
    return out, call(*fit_arguments(case, out))

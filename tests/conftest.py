"""Fixtures that every test may use."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING

# Processes of `make test` share the cores; before anything imports numpy.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

# A shell has what runs in its background ignore Ctrl+C, and children inherit it; ours must hear it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

import hypothesis
import pytest

# The first import, so that it checks the calls of what the others import.
from reference.checked import begin_test
from reference.made_once import made_once
from reference.numpy_2 import hold_to_numpy_2

if TYPE_CHECKING:
    from facestage.contract.face_model import FaceModel

# The same examples on every run, and no failure because a machine is slow.
hypothesis.settings.register_profile("facestage", derandomize=True, deadline=None)
hypothesis.settings.load_profile("facestage")

hold_to_numpy_2()

REPOSITORY = Path(__file__).resolve().parent.parent


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the modules of slow tests, so that at the end no process waits for another's."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup() -> None:
    """Check first calls anew; render with one thread where several processes run tests at once."""
    begin_test()
    if "drjit" in sys.modules and "PYTEST_XDIST_WORKER" in os.environ:
        import drjit

        if drjit.thread_count() != 1:
            drjit.set_thread_count(1)


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


@pytest.fixture(scope="session")
def ict_facekit(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> FaceModel:
    """The published ICT-FaceKit, converted anew in each test run, but once."""
    from facestage.models.registry import load_model

    def load(cache: Path) -> FaceModel:
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("FACESTAGE_CACHE", str(cache))
            return load_model(f"ict:{shared_data / 'ict-facekit.tar.xz'}")

    return load(made_once(tmp_path_factory, "ict-facekit", load))

"""What Install Backend runs: an environment of locked wheels, made of two tiny packages."""

from __future__ import annotations

import hashlib
import signal
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import pytest

from facestage.contract.errors import BackendUnavailableError
from facestage.contract.events import Event
from facestage_blender.backend.commands import find_backend
from facestage_blender.backend.environment import (
    Packages,
    install_command,
    installed_command,
    remove_environment,
)
from facestage_blender.backend.install import Cancel, explain, run
from facestage_blender.backend.process import BAD_INPUT, CANCELLED, BackendProcess, Outcome


def wheel(folder: Path, name: str, files: dict[str, str]) -> Path:
    """A wheel of plain Python."""
    path, info = folder / f"{name}-1.0-py3-none-any.whl", f"{name}-1.0.dist-info"
    described = {
        f"{info}/METADATA": f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n",
        f"{info}/WHEEL": "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        f"{info}/RECORD": "",
    }
    folder.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w") as archive:
        for inside, text in {**files, **described}.items():
            archive.writestr(inside, text)
    return path


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> Packages:
    """A backend that greets, and the package that it needs, with its digest, in a folder."""
    folder = tmp_path_factory.mktemp("extension")
    needed = wheel(folder / "of mine", "greeting", {"greeting.py": "words = 'I fit faces'\n"})
    main = "import greeting\nprint(greeting.words)\n"
    backend = wheel(
        folder, "facestage", {"facestage/__init__.py": "", "facestage/__main__.py": main}
    )
    lock = folder / "lock.txt"
    digest = hashlib.sha256(needed.read_bytes()).hexdigest()
    lock.write_text(f"greeting==1.0 \\\n    --hash=sha256:{digest}\n", encoding="utf-8")
    return Packages(lock, backend)


@pytest.fixture(scope="module")
def wheels(packages: Packages) -> Path:
    """The folder of the package."""
    return packages.wheel.parent / "of mine"


@pytest.fixture(scope="module")
def installed(packages: Packages, wheels: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The environment, and on the way the events of its making."""
    folder = tmp_path_factory.mktemp("user's files") / "environment"
    seen: list[Event] = []
    process = BackendProcess(install_command(folder, packages, wheels), online=False)
    outcome = process.wait(seen.append)
    assert outcome.ok, outcome.message
    assert [event.fraction for event in seen] == sorted(event.fraction for event in seen)
    assert seen[-1].fraction == 1.0
    assert "Fetching greeting" in [event.stage for event in seen]
    return folder


def refused(packages: Packages, folder: Path, wheels: Path) -> str:
    """Why nothing was installed."""
    outcome: Outcome = BackendProcess(
        install_command(folder, packages, wheels), online=False
    ).wait()
    assert outcome.code == BAD_INPUT
    assert installed_command(folder, packages) == []
    return outcome.message


def test_the_backend_runs_in_an_environment_of_its_own(installed: Path, packages: Packages):
    command = installed_command(installed, packages)
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == "I fit faces\n"
    assert find_backend("", command) == command
    assert find_backend(sys.executable, command) == [sys.executable]  # the user's own goes first


def test_another_version_is_installed_anew(installed: Path, packages: Packages, tmp_path: Path):
    newer = wheel(tmp_path, "facestage", {"facestage/__init__.py": "version = 2\n"})
    assert installed_command(installed, Packages(packages.lock, newer)) == []


def test_a_package_of_another_digest_is_not_used(packages: Packages, tmp_path: Path):
    other = wheel(tmp_path / "theirs", "greeting", {"greeting.py": "words = 'gotcha'\n"}).parent
    assert "its digest differs" in refused(packages, tmp_path / "environment", other)


def test_a_package_that_the_folder_lacks_is_named(packages: Packages, tmp_path: Path):
    (tmp_path / "empty").mkdir()
    sentence = refused(packages, tmp_path / "environment", tmp_path / "empty")
    assert "no wheel of greeting" in sentence and "\n" not in sentence


def test_a_folder_that_is_not_there_is_named(packages: Packages, tmp_path: Path):
    sentence = refused(packages, tmp_path / "environment", tmp_path / "nowhere")
    assert "nowhere' does not exist" in sentence


@pytest.mark.parametrize(
    ("said", "sentence"),
    [
        (
            [
                "WARNING: Retrying (Retry(total=0)) after connection broken by 'SSLError(...)'",
                "ERROR: No matching distribution found for numpy==1.26.4",
            ],
            "PyPI cannot be reached",
        ),
        (
            ["ERROR: No matching distribution found for drjit==1.5.0"],
            "PyPI has no wheel of drjit for this Python and system.",
        ),
        (
            ["ERROR: Could not install packages due to an OSError: No space left on device."],
            "(Could not install packages due to an OSError: No space left on device)",
        ),
    ],
)
def test_pips_words_become_one_sentence(said: list[str], sentence: str):
    explained = explain(said, None)
    assert sentence in explained and "\n" not in explained and explained.endswith(".")


def test_cancelled_leaves_nothing(packages: Packages, wheels: Path, tmp_path: Path):
    folder = tmp_path / "environment"
    process = BackendProcess(install_command(folder, packages, wheels), online=False)
    outcome = process.wait(lambda _event: process.cancel())
    assert outcome.code == CANCELLED
    assert not folder.exists()


def test_what_a_child_started_ends_with_it(tmp_path: Path):
    """As pip ends with venv, which called it."""
    beats = tmp_path / "beats"
    beat = f"""import time
while True:
    open({str(beats)!r}, "a").write(".")
    time.sleep(0.01)"""
    child = f"""import subprocess, sys, time
subprocess.Popen([sys.executable, "-c", {beat!r}])
print("started", flush=True)
time.sleep(60)"""

    def cancelled(_line: str) -> None:
        while not beats.exists():
            time.sleep(0.01)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run([sys.executable, "-c", child], cancelled)
    time.sleep(0.1)  # for a write that was under way
    heard = beats.stat().st_size
    time.sleep(0.3)
    assert beats.stat().st_size == heard


def test_a_cancel_waits_until_its_child_is_known():
    cancel = Cancel()
    cancel.held = True
    cancel(signal.SIGTERM, None)
    with pytest.raises(KeyboardInterrupt):
        cancel.let_go()
    with pytest.raises(KeyboardInterrupt):
        Cancel()(signal.SIGTERM, None)
    Cancel().let_go()  # nothing was asked


def test_removing_takes_all_of_it(packages: Packages, tmp_path: Path):
    folder = tmp_path / "environment"
    (folder / "bin").mkdir(parents=True)
    (folder / "bin" / "python").write_text("", encoding="utf-8")
    remove_environment(folder)
    remove_environment(folder)  # nothing to do is no error
    assert not folder.exists() and installed_command(folder, packages) == []


def test_the_source_tree_carries_nothing_to_install(tmp_path: Path):
    with pytest.raises(BackendUnavailableError, match="carries no backend to install"):
        Packages.of_extension(tmp_path)
    wheel(tmp_path / "wheels", "facestage", {})
    with pytest.raises(BackendUnavailableError, match="not known for Python"):
        Packages.of_extension(tmp_path)

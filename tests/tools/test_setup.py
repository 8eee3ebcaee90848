"""The set-up's decisions, without installing anything."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from pathlib import Path
from types import ModuleType

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]


@pytest.fixture
def tools(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the scripts of tools/ importable."""
    monkeypatch.syspath_prepend(str(REPOSITORY / "tools"))


@pytest.fixture
def set_up(tools: None) -> ModuleType:
    """The module tools/setup.py."""
    import setup

    return setup


@pytest.fixture
def native(tools: None) -> ModuleType:
    """The module tools/setup_native.py."""
    import setup_native

    return setup_native


def fake_python(folder: Path, name: str, version: str) -> Path:
    """A program that answers as an interpreter of ``version`` would; an empty one fails, like a pyenv shim."""
    program = folder / name
    program.write_text(f"#!/bin/sh\n{f'echo {version}' if version else 'exit 127'}\n")
    program.chmod(0o755)
    return program


@pytest.mark.skipif(os.name == "nt", reason="the stand-ins are shell scripts")
@pytest.mark.parametrize(
    ("present", "chosen"),
    [
        ({"python3": "3.11"}, "python3"),
        ({"python3": "3.9", "python3.11": "3.11"}, "python3.11"),
        ({"python3.11": "", "python3.13": "3.13"}, "python3.13"),
        ({"python3.11": "3.11", "python3.13": "3.13"}, "python3.11"),
    ],
)
def test_best_python_is_found(
    set_up: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, present: dict[str, str], chosen: str
) -> None:
    for name, version in present.items():
        fake_python(tmp_path, name, version)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(sys, "executable", str(fake_python(tmp_path, "other", "3.12")))
    assert set_up.find_python(None) == str(tmp_path / chosen)


@pytest.mark.skipif(os.name == "nt", reason="the stand-ins are shell scripts")
def test_no_fitting_python_is_one_sentence(set_up: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(sys, "executable", str(fake_python(tmp_path, "python3", "3.12")))
    with pytest.raises(set_up.SetupError, match=r"3\.11 or 3\.13 is needed, found: 3\.12; install Python 3\.11"):
        set_up.find_python(None)


def test_stamp_follows_what_the_environment_is_made_from(
    set_up: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(set_up, "PROJECT", tmp_path)
    (tmp_path / "pyproject.toml").write_text("a")
    first = set_up.fingerprint()
    assert set_up.fingerprint() == first
    (tmp_path / "pyproject.toml").write_text("b")
    assert set_up.fingerprint() != first


def test_locked_versions_are_the_allowed_ones() -> None:
    from packaging.requirements import Requirement

    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = [
        *project["dependencies"],
        *(text for extra in project["optional-dependencies"].values() for text in extra),
    ]
    for python in ("3.11", "3.13"):
        lines = (REPOSITORY / "requirements" / f"python{python}.txt").read_text(encoding="utf-8").split()
        locked = dict(line.lower().split("==") for line in lines)
        for requirement in map(Requirement, wanted):
            if requirement.marker is None or requirement.marker.evaluate({"python_version": python}):
                assert requirement.specifier.contains(locked[requirement.name]), f"{requirement} on Python {python}"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="apt and ldd are Linux programs")
def test_libraries_are_loaded_after_those_they_need(
    native: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    needs = {"module.so": ["libtop.so.1"], "libtop.so.1": ["libmid.so.2", "libelse.so"], "libmid.so.2": ["libend.so.3"]}
    (tmp_path / "site" / "bpy").mkdir(parents=True)
    (tmp_path / "native").mkdir()
    (tmp_path / "site" / "bpy" / "module.so").write_text("")
    for name in ("libtop.so.1", "libmid.so.2", "libend.so.3", "libunused.so"):
        (tmp_path / "native" / name).write_text("")
    monkeypatch.setattr(native, "not_found", lambda path: needs.get(path.name, []))
    order = [path.name for path in native.libraries_to_load(tmp_path / "site", tmp_path / "native")]
    assert order == ["libend.so.3", "libmid.so.2", "libtop.so.1"]


@pytest.mark.skipif(os.name == "nt", reason="make is not part of Windows")
def test_make_lists_its_commands() -> None:
    done = subprocess.run(["make", "--no-print-directory"], cwd=REPOSITORY, capture_output=True, text=True)
    for command in ("setup", "demo", "test", "lint", "types", "ci", "doctor", "extension", "clean"):
        assert f"make {command} " in done.stdout, done.stdout + done.stderr


def test_continuous_integration_is_executable() -> None:
    assert os.access(REPOSITORY / ".ci" / "run", os.X_OK)

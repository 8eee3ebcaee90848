"""The set-up's decisions, without installing anything."""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path
from types import ModuleType

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]


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
    """A program that answers as an interpreter of ``version`` would; an empty one fails, like a
    pyenv shim.
    """
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
    set_up: ModuleType,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    present: dict[str, str],
    chosen: str,
) -> None:
    for name, version in present.items():
        fake_python(tmp_path, name, version)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(sys, "executable", str(fake_python(tmp_path, "other", "3.12")))
    assert set_up.find_python(None) == str(tmp_path / chosen)


@pytest.mark.skipif(os.name == "nt", reason="the stand-ins are shell scripts")
def test_no_fitting_python_is_one_sentence(
    set_up: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(sys, "executable", str(fake_python(tmp_path, "python3", "3.12")))
    with pytest.raises(
        set_up.SetupError, match=r"3\.11 or 3\.13 is needed, found: 3\.12; install Python 3\.11"
    ):
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


def pinned(python: str) -> dict[str, str]:
    """What the list for a Python pins: the version of each package."""
    text = (REPOSITORY / "requirements" / f"python{python}.txt").read_text(encoding="utf-8")
    return dict(re.findall(r"^([a-z0-9.-]+)==(\S+)", text, re.MULTILINE))


@pytest.mark.parametrize("python", ["3.11", "3.13"])
def test_every_locked_package_has_digests(python: str) -> None:
    text = (REPOSITORY / "requirements" / f"python{python}.txt").read_text(encoding="utf-8")
    packages = text.replace("\\\n", " ").splitlines()
    assert len(packages) == len(pinned(python)) > 40
    for line in packages:
        requirement, *digests = line.split()
        assert digests, f"{requirement} has no digest"
        assert all(re.fullmatch(r"--hash=sha256:[0-9a-f]{64}", digest) for digest in digests), (
            requirement
        )


def test_nothing_is_installed_without_its_digest(
    set_up: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[tuple[str, ...]] = []
    monkeypatch.setattr(set_up, "pip", lambda *arguments, venv: calls.append(arguments))
    monkeypatch.setattr(set_up, "venv_version", lambda _venv: "3.11")
    set_up.install_packages()
    packages, project = calls
    assert packages[:3] == ("--require-hashes", "--only-binary", ":all:") and packages[-1].endswith(
        "python3.11.txt"
    )
    assert {"--no-deps", "--no-build-isolation", "--no-index"} <= set(project)


def test_pip_refuses_a_package_with_another_digest(set_up: ModuleType, tmp_path: Path) -> None:
    wheel = tmp_path / "tiny-1-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        archive.writestr(
            "tiny-1.dist-info/METADATA", "Metadata-Version: 2.1\nName: tiny\nVersion: 1\n"
        )
        archive.writestr(
            "tiny-1.dist-info/WHEEL",
            "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        )
        archive.writestr("tiny-1.dist-info/RECORD", "")
    for digest, refused in (
        (hashlib.sha256(wheel.read_bytes()).hexdigest(), False),
        ("0" * 64, True),
    ):
        (tmp_path / "list.txt").write_text(f"tiny==1 --hash=sha256:{digest}\n")
        done = set_up.run(
            [
                sys.executable,
                "-I",
                "-m",
                "pip",
                "install",
                "--dry-run",
                "--no-index",
                "--find-links",
                str(tmp_path),
                *set_up.LOCKED,
                "-r",
                str(tmp_path / "list.txt"),
            ]
        )
        assert ("DO NOT MATCH THE HASHES" in done.stdout) == (done.returncode != 0) == refused, (
            done.stdout
        )


def test_an_interpreter_is_asked_without_the_current_folder(
    set_up: ModuleType, native: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("ensurepip", "venv", "mitsuba", "facestage", "sysconfig"):
        (tmp_path / f"{name}.py").write_text(f"open('sprung-{name}', 'w')\n")
    monkeypatch.chdir(tmp_path)
    set_up.python_version(sys.executable)
    native.import_failure(Path(sys.executable), "mitsuba")
    native.renderer_works(Path(sys.executable))
    assert not list(tmp_path.glob("sprung-*"))


def test_locked_versions_are_the_allowed_ones() -> None:
    from packaging.requirements import Requirement

    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = [
        *project["dependencies"],
        *(text for extra in project["optional-dependencies"].values() for text in extra),
    ]
    for python in ("3.11", "3.13"):
        locked = pinned(python)
        for requirement in map(Requirement, wanted):
            if requirement.marker is None or requirement.marker.evaluate(
                {"python_version": python}
            ):
                assert requirement.specifier.contains(locked[requirement.name]), (
                    f"{requirement} on Python {python}"
                )


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="apt and ldd are Linux programs")
def test_libraries_are_loaded_after_those_they_need(
    native: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    needs = {
        "module.so": ["libtop.so.1"],
        "libtop.so.1": ["libmid.so.2", "libelse.so"],
        "libmid.so.2": ["libend.so.3"],
    }
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
    done = subprocess.run(
        ["make", "--no-print-directory"], cwd=REPOSITORY, capture_output=True, text=True
    )
    for command in ("setup", "demo", "test", "lint", "types", "ci", "doctor", "extension", "clean"):
        assert f"make {command} " in done.stdout, done.stdout + done.stderr


def test_continuous_integration_is_executable() -> None:
    assert os.access(REPOSITORY / ".ci" / "run", os.X_OK)

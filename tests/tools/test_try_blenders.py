"""Which versions of Blender the add-on's tests run in, without installing any."""

from __future__ import annotations

import re
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture
def blenders(tools: None) -> ModuleType:
    """The module tools/try_blenders.py."""
    import try_blenders

    return try_blenders


def test_each_version_is_pinned_by_digests(blenders: ModuleType, repository: Path) -> None:
    assert {"4.2", "4.5", "5.2"} <= set(blenders.versions())
    for version in blenders.versions():
        if version in blenders.OTHER_PYTHON:
            number = blenders.OTHER_PYTHON[version].removeprefix("python")
            lock = repository / "requirements" / f"python{number}.txt"
        else:
            lock = repository / "requirements" / f"blender{version}.txt"
        text = lock.read_text(encoding="utf-8")
        pinned = re.search(
            rf"^bpy=={re.escape(version)}\.\d+ (.*\n)+?(?=\S|\Z)", text, re.MULTILINE
        )
        assert pinned, f"{lock} does not pin bpy {version}"
        assert pinned[0].count("--hash=sha256:") >= 3


def test_an_unknown_version_is_refused(
    blenders: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["try_blenders.py", "--folder", "x", "3.6"])
    with pytest.raises(SystemExit):
        blenders.main()
    assert "no such version: 3.6; known are 4.2" in capsys.readouterr().err


def test_what_fails_is_said_and_the_others_are_tried(
    blenders: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def tried(version: str, _folder: Path, _tests: str) -> str:
        if version == "4.2":
            raise blenders.SetupError("no room")
        return "passed"

    monkeypatch.setattr(blenders, "try_version", tried)
    monkeypatch.setattr("sys.argv", ["try_blenders.py", "--folder", "x", "4.2", "4.5"])
    assert blenders.main() == 1
    assert capsys.readouterr().out == "Blender 4.2: not tried: no room\nBlender 4.5: passed\n"


def test_a_python_that_does_not_start_is_said(
    blenders: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(blenders.OTHER_PYTHON, "5.2", str(tmp_path / "python3.13"))
    with pytest.raises(blenders.SetupError, match=r"it needs .*python3\.13, which does not start"):
        blenders.try_version("5.2", tmp_path, "none")
    assert not list(tmp_path.iterdir())

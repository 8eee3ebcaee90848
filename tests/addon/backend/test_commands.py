"""What the add-on tells the backend that it starts, and where it takes it from."""

from __future__ import annotations

import os
import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace

import pytest

from facestage.contract.errors import BackendUnavailableError
from facestage_blender import preferences
from facestage_blender.backend import commands as backend
from facestage_blender.backend.process import CANCELLED, BackendProcess, explain
from facestage_blender.headless import pipeline

REPOSITORY = Path(__file__).resolve().parents[3]
SAY = "import os; print(os.environ.get('FACESTAGE_OFFLINE'), os.environ['PYTHONSAFEPATH'])"


def blender(monkeypatch: pytest.MonkeyPatch, *, module: bool | None, allowed: bool) -> None:
    """``module``: None in a Blender that does not know the word, as 4.3."""
    app = SimpleNamespace(online_access=allowed)
    if module is not None:
        app.module = module
    monkeypatch.setattr(preferences, "bpy", SimpleNamespace(app=app))


@pytest.mark.parametrize(
    ("module", "allowed", "expected"),
    [
        (False, True, True),
        (False, False, False),
        (True, False, True),
        (None, True, True),
        (None, False, False),
    ],
)
def test_blenders_preference_decides_except_without_one(
    monkeypatch: pytest.MonkeyPatch, module: bool | None, allowed: bool, expected: bool
) -> None:
    blender(monkeypatch, module=module, allowed=allowed)
    assert preferences.online_access() == expected


@pytest.mark.parametrize(("allowed", "said"), [(True, "None 1"), (False, "1 1")])
def test_the_backend_is_told(monkeypatch: pytest.MonkeyPatch, allowed: bool, said: str) -> None:
    monkeypatch.delenv("FACESTAGE_OFFLINE", raising=False)
    child = BackendProcess([sys.executable, "-c", SAY], allowed)
    assert child.wait().ok
    assert child.output == said


def test_a_user_who_is_offline_stays_offline(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FACESTAGE_OFFLINE", "1")
    child = BackendProcess([sys.executable, "-c", SAY], online=True)
    assert child.wait().ok
    assert child.output == "1 1"


@pytest.mark.parametrize("allowed", [True, False])
def test_a_run_without_a_window_asks_the_preference_too(
    monkeypatch: pytest.MonkeyPatch, allowed: bool
) -> None:
    blender(monkeypatch, module=False, allowed=allowed)
    monkeypatch.delenv("FACESTAGE_OFFLINE", raising=False)
    code = f"import os, sys; sys.exit(('FACESTAGE_OFFLINE' in os.environ) == {allowed})"
    pipeline.run_backend([sys.executable, "-c", code], lambda _event: None)


def test_the_manifest_declares_what_is_downloaded() -> None:
    manifest = REPOSITORY / "addon" / "facestage_blender" / "blender_manifest.toml"
    permissions = tomllib.loads(manifest.read_text(encoding="utf-8"))["permissions"]
    assert "landmark model" in permissions["network"]
    # Blender's own rules for these texts.
    assert all(
        len(text) <= 64 and text[-1].isalnum() | (text[-1] in ")") for text in permissions.values()
    )


@pytest.mark.skipif(os.name == "nt", reason="the stand-in is a shell script")
@pytest.mark.parametrize("path", ["", ".", "photos", f".{os.pathsep}photos"])
def test_no_backend_is_taken_from_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, path: str
) -> None:
    for folder in (tmp_path, tmp_path / "photos"):
        folder.mkdir(exist_ok=True)
        (folder / "facestage").write_text("#!/bin/sh\n")
        (folder / "facestage").chmod(0o755)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", path)
    monkeypatch.delenv("FACESTAGE_BACKEND", raising=False)
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    for preferred in ("", "facestage"):
        with pytest.raises(BackendUnavailableError):
            backend.find_backend(preferred)
    monkeypatch.setenv("PATH", f"{path}{os.pathsep}{tmp_path / 'photos'}")
    assert (
        backend.find_backend()
        == backend.find_backend("facestage")
        == [str(tmp_path / "photos" / "facestage")]
    )


@pytest.mark.parametrize("text", ["~nosuchuser/facestage", "'facestage", "x" * 5000, "\0"])
def test_a_command_that_is_none_is_one_sentence(text: str) -> None:
    with pytest.raises(BackendUnavailableError) as caught:
        backend.find_backend(text)
    assert "preferences" in str(caught.value)


def test_a_cancelled_run_speaks_of_a_checkpoint_only_when_there_is_one() -> None:
    kept = explain(
        3,
        ["facestage: cancelled; the last checkpoint is kept, --resume continues from it."],
        "",
        True,
    )
    early = explain(
        3,
        ["facestage: cancelled before the first checkpoint; run it again to start over."],
        "",
        True,
    )
    killed = explain(-9, [], "", cancelled=True)
    assert {kept.code, early.code, killed.code} == {CANCELLED}
    assert "is kept" in kept.message
    assert "before there was a checkpoint" in early.message
    assert "if there is one" in killed.message

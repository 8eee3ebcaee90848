"""The buttons that install and remove the backend: what they refuse, and what they leave."""

from __future__ import annotations

from pathlib import Path

import pytest

from addon.ui.refusal import refused


@pytest.fixture
def environment(scene, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Where the buttons install to: not into the user's Blender."""
    from facestage_blender.ui import install

    folder = tmp_path / "environment"
    monkeypatch.setattr(install, "environment_folder", lambda: folder)
    return folder


def test_nothing_is_fetched_while_online_access_is_off(
    environment: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import bpy

    from facestage_blender.ui import install

    monkeypatch.setattr(install, "online_access", lambda: False)
    refused(bpy.ops.facestage.install_backend, "online access is off")
    assert not environment.exists()
    # A folder of wheels needs no network: then it is the source tree that has nothing to install.
    preferences = bpy.context.preferences.addons["facestage_blender"].preferences
    preferences.wheels = str(environment.parent)
    refused(bpy.ops.facestage.install_backend, "carries no backend")
    preferences.wheels = ""


def test_remove_takes_the_environment_away(environment: Path) -> None:
    import bpy

    (environment / "bin").mkdir(parents=True)
    assert bpy.ops.facestage.remove_backend() == {"FINISHED"}
    assert not environment.exists()


def test_the_sidebar_offers_it_while_there_is_no_backend(scene, monkeypatch, tmp_path) -> None:
    import bpy

    from facestage_blender.ui.install import FACESTAGE_PT_backend

    monkeypatch.setenv("FACESTAGE_BACKEND", str(tmp_path / "none"))
    assert FACESTAGE_PT_backend.poll(bpy.context)
    monkeypatch.setenv("FACESTAGE_BACKEND", "python3")
    assert not FACESTAGE_PT_backend.poll(bpy.context)

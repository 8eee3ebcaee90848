"""The extension's package: what it does when it is imported."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

import facestage_blender

OLD = ("facestage", "facestage.contract", "facestage.contract.job")


@pytest.fixture
def remembered(monkeypatch: pytest.MonkeyPatch) -> None:
    """Modules of an older version in memory; all is put back."""
    monkeypatch.setattr(sys, "modules", dict(sys.modules))
    for name in (*OLD, "facestages"):
        sys.modules[name] = ModuleType(name)


def load(name: str) -> None:
    path = Path(str(facestage_blender.__file__))
    spec = importlib.util.spec_from_file_location(
        name, path, submodule_search_locations=[str(path.parent)]
    )
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)


@pytest.mark.usefixtures("remembered")
def test_an_extension_that_is_replaced_forgets_the_old_contract() -> None:
    load("bl_ext.user_default.facestage_blender")
    assert not set(OLD) & set(sys.modules) and "facestages" in sys.modules


@pytest.mark.usefixtures("remembered")
def test_one_that_is_reloaded_keeps_what_its_modules_use() -> None:
    sys.modules["bl_ext.user_default.facestage_blender.ui"] = ModuleType("ui")
    load("bl_ext.user_default.facestage_blender")
    assert set(OLD) <= set(sys.modules)


@pytest.mark.usefixtures("remembered")
def test_a_package_on_the_path_leaves_memory_alone() -> None:
    load("facestage_blender")
    assert set(OLD) <= set(sys.modules)

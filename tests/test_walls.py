"""Who imports what: proved in fresh processes, because lint sees neither indirect nor computed
imports.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parent.parent
BACKEND = REPOSITORY / "backend" / "facestage"
ADDON = REPOSITORY / "addon" / "facestage_blender"

RENDERER = {"mitsuba", "drjit"}
HEAVY = RENDERER | {"cv2", "scipy", "skimage", "matplotlib"}
BLENDER = {"bpy", "bmesh", "mathutils", "facestage_blender"}

# Imports modules one after another, and says which modules that loaded.
LOADED = """
import importlib, json, sys
for name in sys.argv[1:]:
    importlib.import_module(name)
print("LOADED " + json.dumps(sorted(sys.modules)))
"""


def modules_in(package: Path, *leave_out: str) -> list[str]:
    """Dotted names of all modules of a package on disk, but those below ``leave_out`` and
    ``__main__``.
    """
    top = ADDON.parent if package.is_relative_to(ADDON) else BACKEND.parent
    names = []
    for path in sorted(package.rglob("*.py")):
        parts = path.relative_to(top).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        outside = not any(name == prefix or name.startswith(f"{prefix}.") for prefix in leave_out)
        if outside and parts[-1] != "__main__":
            names.append(name)
    if not names:
        pytest.skip(f"the package {package.name} has no modules")
    return names


def modules_loaded_by(modules: list[str]) -> set[str]:
    """All modules in a fresh process after importing ``modules``."""
    done = subprocess.run(
        [sys.executable, "-c", LOADED, *modules],
        capture_output=True,
        text=True,
        timeout=300,
        stdin=subprocess.DEVNULL,
    )
    assert done.returncode == 0, f"a module does not import:\n{done.stderr}"
    answer = next(line for line in done.stdout.splitlines() if line.startswith("LOADED "))
    return set(json.loads(answer.removeprefix("LOADED ")))


def packages_loaded_by(modules: list[str]) -> set[str]:
    """Top-level packages in a fresh process after importing ``modules``."""
    return {name.partition(".")[0] for name in modules_loaded_by(modules)}


def banned_in(folder: Path) -> set[str]:
    """The imports that the folder's lint settings ban."""
    settings = tomllib.loads((folder / "ruff.toml").read_text(encoding="utf-8"))
    return set(settings["lint"]["flake8-tidy-imports"]["banned-api"])


def test_addon_loads_no_renderer_and_no_opencv() -> None:
    pytest.importorskip("bpy", reason="the add-on's modules import Blender")
    assert not packages_loaded_by(modules_in(ADDON)) & HEAVY


def test_addon_loads_nothing_of_the_backend_but_the_contract() -> None:
    pytest.importorskip("bpy", reason="the add-on's modules import Blender")
    loaded = {
        name for name in modules_loaded_by(modules_in(ADDON)) if name.startswith("facestage.")
    }
    assert {name for name in loaded if name.split(".")[1] != "contract"} == set()


def test_backend_loads_no_blender() -> None:
    assert not packages_loaded_by(modules_in(BACKEND)) & BLENDER


def test_no_room_but_those_that_fit_and_report_loads_the_renderer() -> None:
    rooms = ("render", "fit", "report", "bench", "stress")
    modules = modules_in(BACKEND, *(f"facestage.{room}" for room in rooms))
    assert not packages_loaded_by(modules) & RENDERER


def test_contract_loads_numpy_marshmallow_and_the_standard_library_only() -> None:
    contract = packages_loaded_by(modules_in(BACKEND / "contract"))
    assert contract - packages_loaded_by(["numpy"]) - set(sys.stdlib_module_names) == {
        "facestage",
        "marshmallow",
    }


def test_marshmallow_loads_the_standard_library_only() -> None:
    # It goes into the Blender extension as one wheel.
    plain = packages_loaded_by(["json"])
    assert packages_loaded_by(["marshmallow"]) - plain - set(sys.stdlib_module_names) == {
        "marshmallow"
    }


@pytest.mark.parametrize(
    "module", ["facestage", "facestage.cli", "facestage.contract", "facestage.doctor"]
)
def test_starting_is_cheap(module: str) -> None:
    path = BACKEND.parent.joinpath(*module.split("."))
    if not path.exists() and not path.with_suffix(".py").exists():
        pytest.skip(f"{module} does not exist")
    assert not packages_loaded_by([module]) & (HEAVY | BLENDER)


def test_lint_bans_every_part_of_the_backend_in_the_addon() -> None:
    parts = {
        f"facestage.{path.stem}"
        for path in BACKEND.iterdir()
        if path.suffix == ".py" or path.is_dir()
    }
    parts -= {
        "facestage.__init__",
        "facestage.__main__",
        "facestage.__pycache__",
        "facestage.contract",
    }
    assert parts <= banned_in(ADDON.parent), "add the missing ones to addon/ruff.toml"


@pytest.mark.parametrize(
    ("folder", "statement"),
    [
        ("addon/facestage_blender", "import mitsuba"),
        ("addon/facestage_blender", "import cv2"),
        ("addon/facestage_blender", "from facestage.fit import solver"),
        ("addon/facestage_blender", "from facestage import cli"),
        ("backend/facestage", "import bpy"),
        ("backend/facestage/fit", "import mitsuba as mi"),
        ("backend/facestage/fit", "from drjit import llvm"),
        ("backend/facestage/render", "import bpy"),
        ("backend/facestage/contract", "from scipy import optimize"),
    ],
)
def test_lint_rejects_an_import_across_a_wall(folder: str, statement: str) -> None:
    pytest.importorskip("ruff")
    done = lint(folder, statement)
    assert "TID251" in done.stdout, done.stdout + done.stderr


@pytest.mark.parametrize(
    ("folder", "statement"),
    [
        ("addon/facestage_blender", "from facestage.contract import errors"),
        ("addon/facestage_blender", "import bpy"),
        ("backend/facestage/render", "import mitsuba as mi"),
        ("backend/facestage/landmarks", "import cv2"),
    ],
)
def test_lint_allows_what_a_room_is_for(folder: str, statement: str) -> None:
    pytest.importorskip("ruff")
    done = lint(folder, statement)
    assert done.returncode == 0, done.stdout + done.stderr


def lint(folder: str, statement: str) -> subprocess.CompletedProcess[str]:
    """Run ruff's import bans on a statement as if it stood in a file of ``folder``."""
    command = [
        sys.executable,
        "-m",
        "ruff",
        "check",
        "--select",
        "TID251",
        "--no-cache",
        "--output-format",
        "concise",
    ]
    return subprocess.run(
        [*command, "--stdin-filename", f"{folder}/imagined.py", "-"],
        input=f"{statement}\n",
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        timeout=60,
    )

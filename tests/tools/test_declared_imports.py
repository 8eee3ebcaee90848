"""Whatever is imported is declared: a library that comes with another may leave with it."""

from __future__ import annotations

import ast
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from packaging.requirements import Requirement

REPOSITORY = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = PROJECT["optional-dependencies"]
# Blender's, as a program or as the module bpy.
BLENDER = {"addon_utils", "blf", "bmesh", "bpy", "bpy_extras", "gpu", "gpu_extras", "mathutils"}
# The tests' checks of shapes: contract/arrays.py takes it only where it is loaded already.
CHECKS = {"jaxtyping"}
# A peer's, which only the comparison with it wants, and asks for: bench/mediapipe_weights.py.
PEERS = {"ai_edge_litert"}


def imported(folder: Path) -> dict[str, Path]:
    """A file for each module, by its first name, that the files in ``folder`` import."""
    found: dict[str, Path] = {}
    for path in sorted(folder.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and not node.level:
                names = [node.module or ""]
            else:
                continue
            found |= {name.partition(".")[0]: path for name in names}
    return found


def own() -> set[str]:
    """What this repository itself brings to import."""
    folders = [REPOSITORY, *(REPOSITORY / name for name in ("backend", "addon", "tests"))]
    scripts = {path.stem for path in (REPOSITORY / "tools").glob("*.py")}
    return scripts | {path.name for folder in folders for path in folder.iterdir() if path.is_dir()}


@pytest.mark.parametrize(
    ("folder", "extras"),
    [
        ("backend", ["batch"]),
        ("addon", ["blender"]),
        ("tests", ["batch", "blender", "dev"]),
        ("tools", ["blender", "dev"]),
    ],
)
def test_every_import_is_declared(folder: str, extras: list[str]):
    texts = [*PROJECT["dependencies"], *(text for extra in extras for text in EXTRAS[extra])]
    declared = {Requirement(text).name for text in texts}
    from_where = packages_distributions()
    known = sys.stdlib_module_names | BLENDER | CHECKS | PEERS | own()
    missing = {
        f"{name} in {path.relative_to(REPOSITORY)}"
        for name, path in imported(REPOSITORY / folder).items()
        if name not in known and declared.isdisjoint(from_where.get(name, []))
    }
    assert not missing

"""Build the Blender extension: the add-on, and beside it wheels of the backend's package and what
its contract imports.

Blender puts the wheels on its Python path, so that the add-on can ``import facestage.contract``;
the backend's wheel is what `pip install` takes to make the backend's own environment. Blender's own
builder checks and zips it.
"""

from __future__ import annotations

import hashlib
import importlib.util
import shutil
import sys
import tempfile
import tomllib
from collections.abc import Sequence
from pathlib import Path

from backend_lock import locked, write_backend_locks
from commands import require
from setup_error import SetupError

PROJECT = Path(__file__).resolve().parent.parent
ADDON = PROJECT / "addon" / "facestage_blender"
LOCK = PROJECT / "requirements" / "python3.11.txt"
# pure Python, without dependencies: what facestage.contract imports beside numpy
LIBRARIES = ("marshmallow",)
PIP = (sys.executable, "-I", "-m", "pip", "--quiet", "--disable-pip-version-check")
NOT_SHIPPED = shutil.ignore_patterns("__pycache__", "*.pyc", "*.egg-info")


def main() -> int:
    """Build into dist/ (or the folder given), or say in one sentence why not.

    Returns the exit code.
    """
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else PROJECT / "dist"
    try:
        print(build_extension(target))
    except SetupError as error:
        print(f"make extension: {error}", file=sys.stderr)
        return 1
    return 0


def build_extension(target: Path) -> Path:
    """Write facestage_blender-VERSION.zip into the folder ``target`` and return its path."""
    builder = blender_builder()
    with tempfile.TemporaryDirectory(prefix="facestage-extension-") as folder:
        stage = Path(folder, ADDON.name)
        shutil.copytree(ADDON, stage, ignore=NOT_SHIPPED)
        shutil.copyfile(PROJECT / "LICENSE", stage / "LICENSE")
        manifest = stage / "blender_manifest.toml"
        build_wheel(Path(folder, "package"), stage / "wheels")
        fetch_wheels(Path(folder, "libraries.txt"), stage / "wheels")
        write_backend_locks(stage / "requirements")
        names = sorted(path.name for path in (stage / "wheels").glob("*.whl"))
        manifest.write_text(
            with_wheels(manifest.read_text(encoding="utf-8"), names), encoding="utf-8"
        )
        version = tomllib.loads(manifest.read_text(encoding="utf-8"))["version"]
        target.mkdir(parents=True, exist_ok=True)
        archive = target / f"{ADDON.name}-{version}.zip"
        build = [sys.executable, "-I", str(builder)]
        require([*build, "build", "--source-dir", str(stage), "--output-filepath", str(archive)])
        require([*build, "validate", str(archive)])
    return archive


def build_wheel(stage: Path, target: Path) -> None:
    """Build the wheel of the backend's package alone, without the add-on, into the folder
    ``target``.

    Blender unpacks no wheel of a version that it has: installed over an older build, the add-on
    would meet that build's package. So the version ends in a digest of what is in it.
    """
    shutil.copytree(PROJECT / "backend", stage / "backend", ignore=NOT_SHIPPED)
    (stage / "addon").mkdir()
    for name in ("pyproject.toml", "LICENSE", "README.md"):
        if (PROJECT / name).is_file():
            shutil.copyfile(PROJECT / name, stage / name)
    project = stage / "pyproject.toml"
    project.write_text(
        with_digest(project.read_text(encoding="utf-8"), digest(stage)), encoding="utf-8"
    )
    # With the installed setuptools: a build of its own would fetch another.
    require(
        [
            *PIP,
            "wheel",
            "--no-deps",
            "--no-build-isolation",
            "--no-index",
            "--wheel-dir",
            str(target),
            str(stage),
        ]
    )


def digest(folder: Path) -> str:
    """Eight letters that change with the name or the content of any file in ``folder``."""
    found = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            content = path.read_bytes()
            found.update(f"{path.relative_to(folder).as_posix()}\0{len(content)}\0".encode())
            found.update(content)
    return found.hexdigest()[:8]


def with_digest(project: str, letters: str) -> str:
    """The text of a pyproject.toml whose version ends in +g and ``letters`` (PEP 440's local
    version, which is no number whatever the letters are).
    """
    version = tomllib.loads(project)["project"]["version"]
    line = f'version = "{version}"\n'
    if project.count(line) != 1:
        raise SetupError(f"pyproject.toml has no line of its own that says {line.strip()}.")
    return project.replace(line, f'version = "{version}+g{letters}"\n')


def fetch_wheels(listing: Path, target: Path) -> None:
    """Fetch the wheels of LIBRARIES into ``target``: exactly those whose digests requirements/
    names.
    """
    lock = LOCK.read_text(encoding="utf-8")
    pinned = "".join(locked(lock, name, LOCK.name) for name in LIBRARIES)
    listing.write_text(pinned, encoding="utf-8")
    only = ["--no-deps", "--require-hashes", "--only-binary", ":all:"]
    require([*PIP, "download", *only, "--dest", str(target), "--requirement", str(listing)])


def with_wheels(manifest: str, wheels: Sequence[str]) -> str:
    """The manifest's text with the wheels listed, before its first table."""
    if "wheels" in tomllib.loads(manifest):
        raise SetupError(
            "blender_manifest.toml lists wheels already; leave that to tools/build_extension.py."
        )
    lines = manifest.splitlines(keepends=True)
    first_table = next(
        (number for number, line in enumerate(lines) if line.startswith("[")), len(lines)
    )
    listed = "".join(f'  "./wheels/{wheel}",\n' for wheel in wheels)
    return "".join([*lines[:first_table], f"wheels = [\n{listed}]\n\n", *lines[first_table:]])


def blender_builder() -> Path:
    """The extension builder inside Blender's Python module."""
    module = importlib.util.find_spec("bpy")
    for folder in (module.submodule_search_locations or []) if module else []:
        for path in Path(folder).glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py"):
            return path
    raise SetupError(
        "Blender's extension builder comes with the package bpy, which is not installed; run: "
        "make setup"
    )


if __name__ == "__main__":
    sys.exit(main())

"""Run the add-on's tests in the other supported versions of Blender, for `make test-blenders`.

`make test` runs them in one version, as a module of Python. Each other one that goes with this
environment's Python is unpacked into a folder of its own, which Python looks into first; one that
goes with another Python gets an environment, where that Python is installed.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import setup
from setup_error import SetupError

OTHER_PYTHON = {"5.2": "python3.13"}  # Blender: the Python it goes with, where that is not 3.11
TESTS = "tests/addon"
# Processes other than pytest's own, also where it is one: 4.2 crashes when Python takes it down.
SPREAD = ("--numprocesses", "auto", "--maxprocesses", "4", "--dist", "worksteal")


def main() -> int:
    """Try each version; says what came of each. Returns 1 where a test failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--folder", type=Path, required=True, help="where the versions of Blender are kept"
    )
    parser.add_argument(
        "versions", nargs="*", help=f"which ones (default: {' '.join(versions())})", metavar="X.Y"
    )
    parser.add_argument("--tests", default=TESTS, help="what pytest runs (default: %(default)s)")
    options = parser.parse_args()
    unknown = sorted(set(options.versions) - set(versions()))
    if unknown:
        parser.error(f"no such version: {unknown[0]}; known are {', '.join(versions())}")
    came: dict[str, str] = {}
    for version in options.versions or versions():
        try:
            came[version] = try_version(version, options.folder.expanduser(), options.tests)
        except (SetupError, OSError) as error:
            came[version] = f"not tried: {error}"
    for version, what in came.items():
        setup.say(f"Blender {version}: {what}")
    return int(any(what != "passed" for what in came.values()))


def versions() -> list[str]:
    """Major.minor of every version that has a lock file, or a Python of its own."""
    requirements = setup.PROJECT / "requirements"
    locked = [path.stem.removeprefix("blender") for path in requirements.glob("blender*.txt")]
    return sorted([*locked, *OTHER_PYTHON])


def try_version(version: str, folder: Path, tests: str) -> str:
    """Install one version where it is not there yet, and run the tests in it."""
    environment = dict(os.environ)
    python = setup.venv_python()
    if version in OTHER_PYTHON:
        venv = (folder / f"environment{version}").resolve()
        if setup.python_version(OTHER_PYTHON[version]) is None:
            raise SetupError(f"it needs {OTHER_PYTHON[version]}, which does not start; install it")
        setup.set_up(OTHER_PYTHON[version], venv=venv)
        python = setup.venv_python(venv)
    else:
        environment["PYTHONPATH"] = str(unpacked(version, folder))
    found = subprocess.run(
        [str(python), "-c", "import bpy; print(bpy.app.version_string)"],
        env=environment, stdout=subprocess.PIPE, encoding="utf-8",
    ).stdout  # fmt: skip
    if not (found or "").splitlines()[-1:] or not found.splitlines()[-1].startswith(version):
        raise SetupError(f"{python} imports another Blender: {found.strip() or 'none'}")
    setup.say(f"Blender {found.splitlines()[-1]} in {python}:")
    done = subprocess.run(
        [str(python), "-m", "pytest", *SPREAD, *tests.split()], cwd=setup.PROJECT, env=environment
    )
    return "passed" if done.returncode == 0 else f"failed (pytest's exit code {done.returncode})"


def unpacked(version: str, folder: Path) -> Path:
    """The folder in which this version's module ``bpy`` lies, unpacked if it does not yet."""
    lock = setup.PROJECT / "requirements" / f"blender{version}.txt"
    target = folder.resolve() / version
    stamp = target / setup.STAMP
    if not stamp.is_file() or stamp.read_text(encoding="utf-8") != lock.read_text(encoding="utf-8"):
        setup.say(f"Unpacking Blender {version} into {target} (1.2 GB) ...")
        into = ("--no-deps", "--upgrade", "--target", str(target), "-r", str(lock))
        setup.pip(*setup.LOCKED, *into)
        stamp.write_text(lock.read_text(encoding="utf-8"), encoding="utf-8")
    return target


if __name__ == "__main__":
    sys.exit(main())

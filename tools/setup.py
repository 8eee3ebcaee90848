"""Make the project's environment in .venv, so that one command suffices on a bare machine.

Standard library only, and any Python 3.8 or later may start it: it looks for the Python that fits.
Run again it does nothing, because a stamp remembers what the environment was made from.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from commands import run
from setup_error import SetupError
from setup_native import apt, apt_install, can_apt_install, provide_native_libraries

PROJECT = Path(__file__).resolve().parent.parent
VENV = PROJECT / ".venv"
STAMP = "facestage-setup.stamp"
SUPPORTED = ("3.11", "3.13")  # the Pythons inside Blender 4.2-5.0 and 5.1+
# Only files whose digests are in the list, and nothing that would have to be built: a build fetches
# what no list names.
LOCKED = ("--require-hashes", "--only-binary", ":all:")
# On all cores, where pip has one; nobody imports the packages' own tests.
COMPILE = ("compileall", "-qq", "-j", "0", "-x", r"site-packages.*[/\\]tests?[/\\]")
INGREDIENTS = ("pyproject.toml", "tools/*.py", "requirements/*.txt")


def main() -> int:
    """Set up, or say in one sentence what the user has to do. Returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--python", help="interpreter for the environment (default: 3.11, else 3.13, on PATH)"
    )
    parser.add_argument(
        "--force", action="store_true", help="set up again although nothing changed"
    )
    parser.add_argument(
        "--folder", type=Path, default=VENV, help="where the environment is made (default: .venv)"
    )
    options = parser.parse_args()
    try:
        set_up(options.python, options.force, options.folder.resolve())
    except SetupError as error:
        print(f"make setup: {error}", file=sys.stderr)
        return 1
    except (OSError, subprocess.CalledProcessError) as error:
        print(f"make setup: {error}; mend that and run it again.", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("make setup: interrupted; run it again to go on.", file=sys.stderr)
        return 130
    return 0


def set_up(python: str | None, force: bool = False, venv: Path = VENV) -> None:
    """Create the environment, install the locked packages, find the libraries they need."""
    version = venv_version(venv)
    usable = bool(version) and version in ([python_version(python)] if python else SUPPORTED)
    stamp = venv / STAMP
    if usable and not force and stamp.is_file() and stamp.read_text() == fingerprint():
        return
    stamp.unlink(missing_ok=True)
    if not usable:
        create_environment(find_python(python), venv)
    install_packages(venv)
    provide_native_libraries(venv, venv_python(venv))
    stamp.write_text(fingerprint())
    say(f"The environment in {shown(venv)} is ready.")


def fingerprint() -> str:
    """A digest of everything the environment is made from; the folder counts, since paths are
    stored in it.
    """
    digest = hashlib.sha256(str(PROJECT).encode())
    for pattern in INGREDIENTS:
        for path in sorted(PROJECT.glob(pattern)):
            digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def shown(venv: Path) -> str:
    """The folder as messages name it: from the project's, where it lies within."""
    return str(venv.relative_to(PROJECT) if venv.is_relative_to(PROJECT) else venv)


def venv_python(venv: Path = VENV) -> Path:
    """The interpreter inside an environment."""
    return venv / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def venv_version(venv: Path = VENV) -> str | None:
    """The major.minor version of a usable environment, or None."""
    program = venv_python(venv)
    return python_version(str(program)) if program.exists() else None


def python_version(executable: str) -> str | None:
    """Major.minor of an interpreter, or None when it does not start (a pyenv shim, a dangling
    link).
    """
    code = "import sys; print('%d.%d' % sys.version_info[:2])"
    try:
        done = subprocess.run(
            [executable, "-I", "-c", code], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        )
    except OSError:
        return None
    return done.stdout.decode().strip() if done.returncode == 0 else None


def find_python(wanted: str | None) -> str:
    """The interpreter to build the environment with."""
    names = (
        [wanted]
        if wanted
        else [*(f"python{version}" for version in SUPPORTED), "python3", sys.executable]
    )
    found: dict[str, str] = {}
    for name in names:
        path = shutil.which(name)
        version = python_version(path) if path else None
        if path and version:
            found.setdefault(version, path)
    for version in SUPPORTED:
        if version in found:
            return found[version]
    have = ", ".join(sorted(found)) or "none"
    raise SetupError(
        f"Python {' or '.join(SUPPORTED)} is needed, found: {have}; install Python 3.11 (Debian: "
        "apt-get install python3 python3-venv; elsewhere: python.org) and run it again."
    )


def create_environment(python: str, venv: Path = VENV) -> None:
    """Make the environment anew with ``python``; on a Debian without ensurepip, root gets
    python3-venv installed.
    """
    name = shown(venv)
    if venv.exists():
        say(f"The folder {name} is not a usable environment of the Python wanted; making it anew.")
        shutil.rmtree(venv)
    say(f"Making {name} with {python} ...")
    if subprocess.run(
        [python, "-I", "-c", "import ensurepip, venv"], stderr=subprocess.DEVNULL
    ).returncode:
        install_venv_module(python)
    done = run([python, "-I", "-m", "venv", str(venv)])
    if done.returncode:
        shutil.rmtree(venv, ignore_errors=True)
        raise SetupError(
            f"'{python} -m venv {name}' failed ({last_line(done)}); mend that and run it again."
        )


def install_venv_module(python: str) -> None:
    """Install Debian's python3-venv as root, or say how."""
    package = f"python{python_version(python)}-venv"
    if not can_apt_install():
        raise SetupError(f"{python} lacks the venv module; run: sudo apt-get install {package}")
    apt(["apt-get", "update"])
    apt_install([package])


def install_packages(venv: Path = VENV) -> None:
    """Install the locked packages and the project itself, editable."""
    lock = PROJECT / "requirements" / f"python{venv_version(venv)}.txt"
    say(
        f"Installing the packages of {lock.relative_to(PROJECT)} (1.7 GB on disk; minutes the "
        "first time) ..."
    )
    pip(*LOCKED, "--no-compile", "-r", str(lock), venv=venv)
    # What does not compile, files for other Pythons, nobody imports.
    run([str(venv_python(venv)), "-I", "-m", *COMPILE, str(venv / "lib")])
    # With the locked setuptools: a build of its own would fetch another.
    own = ("--no-deps", "--no-build-isolation", "--no-index", "--editable", str(PROJECT))
    pip(*own, venv=venv)


def pip(*arguments: str, venv: Path = VENV) -> None:
    """Run pip install; on failure show its output and raise SetupError."""
    command = [
        str(venv_python(venv)),
        "-I",
        "-m",
        "pip",
        "install",
        "--disable-pip-version-check",
        "--quiet",
        *arguments,
    ]
    done = run(command)
    if done.returncode:
        print(done.stdout, file=sys.stderr)
        raise SetupError(
            f"pip could not install the packages ({last_line(done)}); check the network connection "
            "and the free disk space, and run it again."
        )


def last_line(done: subprocess.CompletedProcess[str]) -> str:
    """The last non-empty line of what a command said: usually the reason it failed."""
    lines = [line.strip() for line in done.stdout.splitlines() if line.strip()]
    return lines[-1] if lines else f"exit code {done.returncode}"


def say(text: str) -> None:
    """Tell the user at once what is going on."""
    print(text, flush=True)


if __name__ == "__main__":
    sys.exit(main())

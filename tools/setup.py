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
STAMP = VENV / "facestage-setup.stamp"
SUPPORTED = ("3.11", "3.13")  # the Pythons inside Blender 4.2-5.0 and 5.1+
# Only files whose digests are in the list, and nothing that would have to be built: a build fetches
# what no list names.
LOCKED = ("--require-hashes", "--only-binary", ":all:")
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
    options = parser.parse_args()
    try:
        set_up(options.python, options.force)
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


def set_up(python: str | None, force: bool) -> None:
    """Create the environment, install the locked packages, find the libraries they need."""
    usable = venv_version() in ([python_version(python)] if python else SUPPORTED)
    if usable and not force and STAMP.is_file() and STAMP.read_text() == fingerprint():
        return
    STAMP.unlink(missing_ok=True)
    if not usable:
        create_environment(find_python(python))
    install_packages()
    provide_native_libraries(VENV, venv_python())
    STAMP.write_text(fingerprint())
    say("The environment in .venv is ready.")


def fingerprint() -> str:
    """A digest of everything the environment is made from; the folder counts, since paths are
    stored in it.
    """
    digest = hashlib.sha256(str(PROJECT).encode())
    for pattern in INGREDIENTS:
        for path in sorted(PROJECT.glob(pattern)):
            digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def venv_python() -> Path:
    """The interpreter inside .venv."""
    return VENV / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def venv_version() -> str | None:
    """The major.minor version of a usable .venv, or None."""
    return python_version(str(venv_python())) if venv_python().exists() else None


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


def create_environment(python: str) -> None:
    """Make .venv anew with ``python``; on a Debian without ensurepip, root gets python3-venv
    installed.
    """
    if VENV.exists():
        say("The folder .venv is not a usable environment of the Python wanted; making it anew.")
        shutil.rmtree(VENV)
    say(f"Making .venv with {python} ...")
    if subprocess.run(
        [python, "-I", "-c", "import ensurepip, venv"], stderr=subprocess.DEVNULL
    ).returncode:
        install_venv_module(python)
    done = run([python, "-I", "-m", "venv", str(VENV)])
    if done.returncode:
        shutil.rmtree(VENV, ignore_errors=True)
        raise SetupError(
            f"'{python} -m venv .venv' failed ({last_line(done)}); mend that and run it again."
        )


def install_venv_module(python: str) -> None:
    """Install Debian's python3-venv as root, or say how."""
    package = f"python{python_version(python)}-venv"
    if not can_apt_install():
        raise SetupError(f"{python} lacks the venv module; run: sudo apt-get install {package}")
    apt(["apt-get", "update"])
    apt_install([package])


def install_packages() -> None:
    """Install the locked packages and the project itself, editable."""
    lock = PROJECT / "requirements" / f"python{venv_version()}.txt"
    say(
        f"Installing the packages of {lock.relative_to(PROJECT)} (1.7 GB on disk; minutes the "
        "first time) ..."
    )
    pip(*LOCKED, "-r", str(lock))
    # With the locked setuptools: a build of its own would fetch another.
    pip("--no-deps", "--no-build-isolation", "--no-index", "--editable", str(PROJECT))


def pip(*arguments: str) -> None:
    """Run pip install; on failure show its output and raise SetupError."""
    command = [
        str(venv_python()),
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

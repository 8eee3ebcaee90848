"""Shared libraries that the Python packages expect from the operating system.

A bare Debian lacks some that ``import bpy`` and ``import drjit`` want, and the renderer compiles
its kernels with libLLVM, which no Python package carries. Root gets them from apt; anybody else
gets the same packages unpacked into .venv/native, whose libraries a ``.pth`` file loads when Python
starts.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from setup_error import SetupError

# Checked in an empty Debian 12: enough for bpy, mitsuba and cv2.
PACKAGES = [
    "libatomic1",
    "libsm6",
    "libxext6",
    "libgl1",
    "libxi6",
    "libxfixes3",
    "libxrender1",
    "libxkbcommon0",
]
# In order of preference: with Mitsuba 3.9, 19 and 22 work; 15 and 16 crash, and 14 is refused.
LLVM_PACKAGES = ["libllvm19", "libllvm20", "libllvm21", "libllvm22", "libllvm18", "libllvm17"]
# Drivers: large, and loaded only by programs that draw on a screen.
NOT_UNPACKED = re.compile(
    r"libc6|libgcc|libstdc|.*mesa|libdrm|libllvm|libsensors|libpciaccess|libglapi"
)

IMPORTS = ("bpy", "mitsuba", "cv2")
PRELOAD = "facestage_preload"


def provide_native_libraries(venv: Path, python: Path) -> None:
    """Make the packages import and the renderer find a compiler, or raise SetupError with the
    remedy.
    """
    imports = not any(import_failure(python, module) for module in IMPORTS)
    if imports and renderer_works(python):
        return
    if can_apt_install():
        apt(["apt-get", "update"])
        apt_install([*PACKAGES, *first_available(LLVM_PACKAGES)])
    elif shutil.which("apt-get"):
        unpack_packages(venv, python)
    for module in IMPORTS:
        reason = import_failure(python, module)
        if reason:
            raise SetupError(
                f"'import {module}' fails ({reason}); {remedy(PACKAGES)} and run it again."
            )
    if not renderer_works(python):
        print(
            "make setup: the renderer does not work on this machine yet, because it found no "
            "usable libLLVM; 'make doctor' says what to install.",
            file=sys.stderr,
        )


def import_failure(python: Path, module: str) -> str:
    """Why a module cannot be imported in a fresh process; empty when it can."""
    done = subprocess.run(
        [str(python), "-I", "-c", f"import {module}"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        encoding="utf-8",
        errors="replace",
    )
    if done.returncode == 0:
        return ""
    lines = done.stderr.strip().splitlines()
    return lines[-1] if lines else f"exit code {done.returncode}"


def renderer_works(python: Path) -> bool:
    """Whether the backend finds a renderer that compiles and runs here."""
    command = [str(python), "-I", "-m", "facestage.system.native"]
    return (
        subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode
        == 0
    )


def can_apt_install() -> bool:
    """Whether this process may install Debian packages."""
    return os.name == "posix" and os.geteuid() == 0 and shutil.which("apt-get") is not None


def remedy(packages: list[str]) -> str:
    """What the user can do, on a machine that could not be set up."""
    if shutil.which("apt-get"):
        return f"run: sudo apt-get install {' '.join(packages)}"
    return "install the library it names with your system's package manager"


def apt_install(packages: list[str]) -> None:
    """Install Debian packages as root."""
    print(f"Installing system packages: {' '.join(packages)} ...", flush=True)
    done = apt(["apt-get", "install", "--yes", "--no-install-recommends", *packages])
    if done.returncode:
        print(done.stdout, file=sys.stderr)
        raise SetupError(
            f"apt-get could not install the system packages; {remedy(packages)} and run it again."
        )


def apt(
    command: list[str], options: tuple[str, ...] = (), folder: Path | None = None
) -> subprocess.CompletedProcess[str]:
    """Run an apt command without questions, in ``folder`` if given."""
    return subprocess.run(
        [command[0], *options, *command[1:]],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        errors="replace",
        env={**os.environ, "DEBIAN_FRONTEND": "noninteractive", "LC_ALL": "C"},
    )


def first_available(packages: list[str], options: tuple[str, ...] = ()) -> list[str]:
    """The first of the packages that apt knows, as a list; an empty one when it knows none."""
    for package in packages:
        if apt(["apt-cache", "show", "--no-all-versions", package], options).returncode == 0:
            return [package]
    return []


def unpack_packages(venv: Path, python: Path) -> None:
    """Without root: download the packages with what they depend on, and unpack them into
    .venv/native.
    """
    native = venv / "native"
    print(
        f"Unpacking system packages into {native}, since only root may install them ...", flush=True
    )
    with tempfile.TemporaryDirectory(prefix="facestage-apt-") as folder:
        # Package lists of our own: those of the machine may be missing, and only root may renew
        # them.
        options = private_apt(Path(folder))
        apt(["apt-get", "update"], options)
        wanted = [*PACKAGES, *first_available(LLVM_PACKAGES, options)]
        done = apt(
            ["apt-get", "install", "--simulate", "--no-install-recommends", *wanted], options
        )
        missing = re.findall(r"^Inst (\S+)", done.stdout, re.MULTILINE)
        names = [name for name in missing if name in wanted or not NOT_UNPACKED.match(name)]
        if done.returncode == 0 and names:
            done = apt(["apt-get", "download", *names], options, Path(folder))
        if done.returncode:
            print(done.stdout, file=sys.stderr)
            raise SetupError(
                f"the system packages could not be downloaded; {remedy(wanted)} and run it again."
            )
        for archive in sorted(Path(folder).glob("*.deb")):
            subprocess.run(["dpkg", "-x", str(archive), str(native)], check=True)
    native.mkdir(exist_ok=True)
    install_preload(venv, python)


def private_apt(folder: Path) -> tuple[str, ...]:
    """Options that let apt keep its lists and downloads in ``folder``, and look at the machine's
    for the rest.
    """
    for name in ("lists/partial", "cache/archives/partial"):
        (folder / name).mkdir(parents=True)
    settings = {
        "Dir::State": str(folder),
        "Dir::State::lists": str(folder / "lists"),
        "Dir::State::status": "/var/lib/dpkg/status",
        "Dir::Cache": str(folder / "cache"),
        "Debug::NoLocking": "1",
        "APT::Sandbox::User": "",
    }
    return tuple(
        argument for name, value in settings.items() for argument in ("-o", f"{name}={value}")
    )


def install_preload(venv: Path, python: Path) -> None:
    """Have Python load the unpacked libraries at start, those that the packages miss and no
    others.
    """
    code = "import sysconfig; print(sysconfig.get_path('platlib'))"
    done = subprocess.run(
        [str(python), "-I", "-c", code], check=True, capture_output=True, text=True
    )
    site = Path(done.stdout.strip())
    libraries = libraries_to_load(site, venv / "native")
    shutil.copyfile(Path(__file__).with_name(f"{PRELOAD}.py"), site / f"{PRELOAD}.py")
    relative = [str(path.relative_to(venv)) for path in libraries]
    (venv / "native" / "preload.txt").write_text("".join(f"{line}\n" for line in relative))
    (site / f"{PRELOAD}.pth").write_text(f"import {PRELOAD}; {PRELOAD}.load()\n")


def libraries_to_load(site: Path, native: Path) -> list[Path]:
    """Unpacked libraries that some package in ``site`` does not find, each after those it needs
    itself.
    """
    unpacked = {path.name: path for path in sorted(native.rglob("*.so*")) if path.is_file()}
    order: list[Path] = []

    def visit(library: Path) -> None:
        for name in not_found(library):
            if name in unpacked and unpacked[name] not in order:
                visit(unpacked[name])
                order.append(unpacked[name])

    for folder in ("bpy", "drjit", "mitsuba", "cv2"):
        for library in sorted((site / folder).rglob("*.so*")):
            visit(library)
    return order


def not_found(library: Path) -> list[str]:
    """Names of shared libraries that the dynamic loader does not find for ``library``."""
    done = subprocess.run(
        ["ldd", str(library)], stdin=subprocess.DEVNULL, capture_output=True, text=True
    )
    return re.findall(r"^\s*(\S+) => not found", done.stdout, re.MULTILINE)

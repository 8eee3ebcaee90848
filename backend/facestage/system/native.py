"""Finds what the renderer needs from this machine: a libLLVM that works, or a CUDA device that
works.

The CPU renderer compiles its kernels with libLLVM. Some versions do not merely fail: LLVM 15 and 16
abort the process while compiling, which no ``except`` can catch. So each candidate compiles and
runs a small scene in a child process first, and the answer is remembered until the library or the
renderer changes.
"""

from __future__ import annotations

import contextlib
import os
import platform
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from facestage.contract.errors import BackendUnavailableError, FacestageError, InputError
from facestage.contract.files.storage import read_json, write_json
from facestage.system.child import python_code
from facestage.system.folders import cache_folder

LLVM_VARIABLE = "DRJIT_LIBLLVM_PATH"
LLVM_VARIANT = "llvm_ad_rgb"
CUDA_VARIANT = "cuda_ad_rgb"
DEVICES = ("auto", "cpu", "cuda")
PREFERRED_LLVM = 19  # what the tests run with
PROBE_SECONDS = 180.0

# A text, because only the renderer's own room may import these, and this must run in another
# process.
_PROBE = """
import sys
try:
    import resource
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
except ImportError:
    pass
import drjit as dr
import mitsuba as mi
mi.set_variant(sys.argv[1])
lamp = {"type": "rectangle", "emitter": {"type": "area"}}
scene = mi.load_dict({
    "type": "scene", "integrator": {"type": "prb_basic"},
    "ball": {"type": "sphere", "center": [0, 0, 3]},
    "lamp": lamp,
    "sensor": {"type": "perspective", "film": {"type": "hdrfilm", "width": 4, "height": 4}},
})
params = mi.traverse(scene)
key = "lamp.emitter.radiance.value"
dr.enable_grad(params[key])
params.update()
dr.backward(dr.sum(mi.render(scene, params, spp=1), axis=None))
assert dr.all(dr.isfinite(dr.grad(params[key])), axis=None)
print("works", flush=True)
"""


@dataclass(frozen=True)
class Probe:
    """What trying one libLLVM, or CUDA, gave: ``reason`` is empty when it works."""

    name: str
    reason: str

    @property
    def works(self) -> bool:
        """Whether the renderer can use it."""
        return not self.reason


def ensure_llvm() -> Path:
    """Point Dr.Jit at a libLLVM that works, and return it.

    Dr.Jit reads this when it is imported, so it has no effect later; facestage.render sees to the
    order. Raises BackendUnavailableError, with the command that installs one, when there is none.
    """
    remembered = _remembered()
    tried = []
    for library in llvm_candidates():
        key = _library_key(library)
        if key not in remembered:
            probe = probe_llvm(library)
            if not probe.works:
                tried.append(f"{library}: {probe.reason}")
                continue
            _remember(key)
        os.environ[LLVM_VARIABLE] = str(library)
        return library
    found = f"found only {'; '.join(tried)}" if tried else "found none"
    raise BackendUnavailableError(
        f"The CPU renderer needs LLVM {PREFERRED_LLVM} (its libLLVM), {found}. {llvm_remedy()}"
    )


def prepare_renderer() -> None:
    """Choose the libLLVM, if there is one that works, for the renderer that is about to be
    imported.

    Without one, importing it still succeeds, since CUDA may work; :func:`choose_variant` says what
    is missing. Raises BackendUnavailableError when the renderer is not installed.
    """
    _renderer_version()
    with contextlib.suppress(BackendUnavailableError):
        ensure_llvm()


def choose_variant(device: str = "auto") -> str:
    """The Mitsuba variant for ``device``: CUDA where it really works ("auto"), else LLVM, made
    ready to import.

    Raises InputError for an unknown device, BackendUnavailableError when the device cannot be used.
    """
    if device not in DEVICES:
        raise InputError(f"The device is '{device}', expected one of {', '.join(DEVICES)}.")
    if device == "cpu":
        ensure_llvm()
        return LLVM_VARIANT
    probe = probe_cuda()
    if probe.works:
        return CUDA_VARIANT
    if device == "cuda":
        raise BackendUnavailableError(f"CUDA does not work here ({probe.reason}). {CUDA_REMEDY}")
    ensure_llvm()
    return LLVM_VARIANT


def llvm_candidates() -> list[Path]:
    """Every libLLVM on this machine, best first: the user's choice, the environment's own, then the
    system's.
    """
    chosen = os.environ.get(LLVM_VARIABLE)
    own = [Path(sys.prefix, "native"), Path(sys.prefix, "lib")]
    ordered = [Path(chosen).absolute()] if chosen else []
    for folders in (own, _system_folders()):
        # One that a variable names relative to the current folder may be anybody's.
        trusted = (folder for folder in folders if folder.is_absolute())
        ordered += sorted(_libraries_in(trusted), key=_preference)
    unique: dict[Path, Path] = {}
    for path in ordered:
        unique.setdefault(path.resolve(), path)
    return list(unique.values())


def probe_llvm(library: Path) -> Probe:
    """Try one libLLVM in a child process."""
    if not library.is_file():
        return Probe(str(library), "the file does not exist")
    return Probe(str(library), _run_probe(LLVM_VARIANT, {LLVM_VARIABLE: str(library)}))


def probe_cuda() -> Probe:
    """Try CUDA with OptiX in a child process; without a driver no process is started."""
    driver = _cuda_driver()
    if driver is None:
        return Probe("CUDA", "no NVIDIA driver is installed")
    visible = os.environ.get("CUDA_VISIBLE_DEVICES", "all")
    key = f"cuda|{driver}|{visible}|{_renderer_version()}"
    if key in _remembered():
        return Probe("CUDA", "")
    reason = _run_probe(CUDA_VARIANT, {})
    if not reason:
        _remember(key)
    return Probe("CUDA", reason)


CUDA_REMEDY = "Install a current NVIDIA driver with OptiX (535 or later), or use --device cpu."


def llvm_remedy() -> str:
    """One sentence: the command that installs a libLLVM that works on this operating system."""
    system = platform.system()
    if system == "Darwin":
        return "Run: brew install llvm"
    if system == "Windows":
        return "Run: winget install LLVM.LLVM"
    if Path("/etc/debian_version").exists():
        package = f"libllvm{PREFERRED_LLVM}"
        if hasattr(os, "geteuid") and os.geteuid() == 0:
            return f"Run: apt-get install {package}"
        return f"Run: sudo apt-get install {package} (or, without root, make setup)"
    if Path("/etc/fedora-release").exists():
        return "Run: sudo dnf install llvm-libs"
    return (
        f"Install LLVM {PREFERRED_LLVM} with your package manager, or set {LLVM_VARIABLE} "
        "to its libLLVM."
    )


def _run_probe(variant: str, settings: dict[str, str]) -> str:
    """Render a small scene in a child; empty when it worked, else the reason in a few words."""
    with tempfile.TemporaryDirectory(prefix="facestage-probe-") as folder:
        # An empty kernel cache: one filled by another libLLVM would hide that this one cannot
        # compile.
        environment = {**os.environ, **settings, "DRJIT_CACHE_DIR": folder}
        try:
            # In that folder, because Mitsuba looks for plugins in the current one.
            done = subprocess.run(
                python_code(_PROBE, variant),
                cwd=folder,
                env=environment,
                stdin=subprocess.DEVNULL,
                capture_output=True,
                encoding="utf-8",
                errors="replace",
                timeout=PROBE_SECONDS,
            )
        except subprocess.TimeoutExpired:
            return f"it did not answer within {PROBE_SECONDS:.0f} s"
    if done.returncode == 0 and "works" in done.stdout:
        return ""
    return _reason(done)


def _reason(done: subprocess.CompletedProcess[str]) -> str:
    """Why a probe failed, in a few words, from what the child wrote."""
    if match := re.search(r"LLVM version.*too old\b", done.stderr):
        return match[0]
    if "LLVM shared library" in done.stderr:
        return "Dr.Jit cannot load it"
    lines = [line.strip(" :") for line in done.stderr.splitlines() if line.strip()]
    if done.returncode < 0:
        # A crash: the first line names the cause, what follows is a dump of the compiler's state.
        cause = next((line for line in lines if "ERROR" in line), "")
        return f"the renderer crashed with signal {-done.returncode}" + (
            f", {cause.split(': 0x')[0]}" if cause else ""
        )
    return lines[-1] if lines else f"the renderer stopped with exit code {done.returncode}"


def _system_folders() -> Iterator[Path]:
    """Folders where operating systems keep libLLVM."""
    if conda := os.environ.get("CONDA_PREFIX"):
        yield Path(conda, "lib")
    system = platform.system()
    if system == "Windows":
        for variable in ("ProgramFiles", "LOCALAPPDATA"):
            if programs := os.environ.get(variable):
                yield Path(programs, "LLVM", "bin")
        yield from (
            Path(folder) for folder in os.environ.get("PATH", "").split(os.pathsep) if folder
        )
    elif system == "Darwin":
        for root in (Path("/opt/homebrew/opt"), Path("/usr/local/opt")):
            yield from (folder / "lib" for folder in sorted(root.glob("llvm*")))
        yield Path("/opt/local/lib")
    else:
        yield from (
            Path(f"/usr/lib/{platform.machine()}-linux-gnu"),
            Path("/usr/lib64"),
            Path("/usr/lib"),
        )
        yield from (folder / "lib" for folder in sorted(Path("/usr/lib").glob("llvm*")))
        yield from (
            folder / name
            for folder in sorted(Path("/usr/lib64").glob("llvm*"))
            for name in ("lib", "lib64")
        )
        yield Path("/usr/local/lib")


def _libraries_in(folders: Iterable[Path]) -> Iterator[Path]:
    """Each libLLVM in the folders; only the environment's own folder is searched in depth."""
    names = {"Windows": ("LLVM-C.dll",), "Darwin": ("libLLVM*.dylib",)}
    for folder in folders:
        for name in names.get(platform.system(), ("libLLVM.so*", "libLLVM-*.so*")):
            yield from folder.rglob(name) if folder.name == "native" else folder.glob(name)


def llvm_version(library: Path) -> int | None:
    """The major version in a libLLVM's file name, links followed: libLLVM.so.19.1,
    libLLVM-14.so.1.
    """
    for name in (library.name, library.resolve().name):
        match = re.search(r"libLLVM(?:-|\.so\.|\.)(\d+)", name)
        if match:
            return int(match[1])
    return None


def _preference(library: Path) -> tuple[int, int]:
    """Sort key: the version the tests use, then newer ones, then older ones, newest first."""
    version = llvm_version(library)
    if version is None or version == PREFERRED_LLVM:
        return (0 if version else 1, 0)
    return (1, version) if version > PREFERRED_LLVM else (2, -version)


def _cuda_driver() -> str | None:
    """A text that changes with the NVIDIA driver, or None when there is none."""
    if platform.system() == "Windows":
        library = Path(os.environ.get("SYSTEMROOT", "C:\\Windows"), "System32", "nvcuda.dll")
        return str(library.stat().st_mtime_ns) if library.is_file() else None
    version = Path("/proc/driver/nvidia/version")
    if version.is_file():
        return version.read_text(errors="replace").split("\n", 1)[0]
    # Containers and the Windows Subsystem for Linux may have the driver's library, but no /proc
    # entry.
    for folder in (Path("/usr/lib/wsl/lib"), *_system_folders()):
        library = folder / "libcuda.so.1"
        if library.is_file():
            return f"{library} {library.stat().st_mtime_ns}"
    return None


def _renderer_version() -> str:
    """Versions of Mitsuba and Dr.Jit, read without importing them."""
    try:
        return f"mitsuba {metadata.version('mitsuba')} drjit {metadata.version('drjit')}"
    except metadata.PackageNotFoundError:
        raise BackendUnavailableError(
            "Mitsuba is not installed in this Python; run: make setup (Blender: Install Backend)."
        ) from None


def _library_key(library: Path) -> str:
    """What a remembered answer about a libLLVM depends on."""
    path = library.resolve()
    modified = path.stat().st_mtime_ns if path.is_file() else 0
    return f"{path}|{modified}|{_renderer_version()}"


def _memory() -> Path:
    return cache_folder() / "native.json"


def _remembered() -> list[str]:
    """Keys of what worked before; failures are tried again, since the user may have mended them."""
    try:
        works = read_json(_memory(), "memory of what works").get("works")
    except (OSError, FacestageError):
        return []
    return [str(key) for key in works] if isinstance(works, list) else []


def _remember(key: str) -> None:
    """Note that something works; a cache that cannot be written only costs time."""
    try:
        write_json(_memory(), {"works": [*_remembered(), key][-16:]})
    except (OSError, FacestageError):
        return


def main() -> int:
    """Say which renderer works here. Exit code 0, or 4 when none does."""
    try:
        variant = choose_variant("auto")
    except BackendUnavailableError as error:
        print(f"facestage: {error}", file=sys.stderr)
        return error.exit_code
    print(variant if variant == CUDA_VARIANT else f"{variant} with {os.environ[LLVM_VARIABLE]}")
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""``facestage doctor``: what works on this machine, and the one command that mends each thing that
does not.
"""

from __future__ import annotations

import importlib.util
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import TextIO

from facestage import __version__
from facestage.contract.errors import BackendUnavailableError, InputError
from facestage.contract.online import OFFLINE_VARIABLE, is_offline
from facestage.images.opencv import REMEDY
from facestage.landmarks.model_file import URL, VARIABLE, cached_path, find_model
from facestage.system import native
from facestage.system.child import python_code
from facestage.system.folders import cache_folder, data_folder

EXIT_ABLE, EXIT_UNABLE = 0, BackendUnavailableError.exit_code
PYTHONS = ((3, 11), (3, 13))  # the Pythons inside Blender 4.2-5.0 and 5.1+
# Distribution and the versions that work; each Mitsuba needs exactly one Dr.Jit.
PACKAGES = {
    "mitsuba": "3.9.",
    "drjit": "1.5.",
    "numpy": "",
    "scipy": "",
    "scikit-image": "",
    "matplotlib": "",
    "pooch": "",
}
INSTALL = "Run: make setup (outside the source tree: pip install --upgrade facestage)"
# Libraries of a desktop Linux that `import bpy` and `import cv2` link to, and servers lack.
DESKTOP_LIBRARIES = (
    "libatomic1",
    "libsm6",
    "libxext6",
    "libgl1",
    "libxi6",
    "libxfixes3",
    "libxrender1",
    "libxkbcommon0",
)


@dataclass(frozen=True)
class Finding:
    """One line of the report: what was looked at, what was found, how to mend it.

    ``needed`` says that no fit can run without it.
    """

    subject: str
    found: str
    works: bool = True
    needed: bool = False
    remedy: str = ""

    def __str__(self) -> str:
        mark = "ok" if self.works else ("FAIL" if self.needed else "--")
        text = f"{mark:>4}  {self.subject:<16} {self.found}"
        return text if self.works or not self.remedy else f"{text}\n{'':22} -> {self.remedy}"


def run_doctor(stream: TextIO) -> int:
    """Write the report to ``stream``. Returns 0 when a fit can run on this machine, else 4."""
    print(
        f"Facestage {__version__} on {platform.platform()}, {os.cpu_count()} CPU cores\n",
        file=stream,
    )
    able = True
    for finding in findings():
        print(finding, file=stream, flush=True)
        able = able and (finding.works or not finding.needed)
    verdict = (
        "This machine can fit."
        if able
        else "This machine cannot fit yet; mend what is marked FAIL."
    )
    print(f"\n{verdict}", file=stream)
    return EXIT_ABLE if able else EXIT_UNABLE


def findings() -> Iterator[Finding]:
    """Everything the report looks at, each found when it is asked for."""
    yield python_finding()
    for name, version in PACKAGES.items():
        yield package_finding(name, version)
    yield opencv_finding()
    yield from renderer_findings()
    yield import_finding("Blender (bpy)", "bpy", needed=False)
    yield folder_finding("cache folder", cache_folder)
    yield folder_finding("temporary folder", lambda: Path(tempfile.gettempdir()))
    yield data_finding()
    yield landmark_finding()
    yield online_finding()


def python_finding() -> Finding:
    """The interpreter: bpy exists for the Pythons inside Blender only."""
    version = sys.version_info[:2]
    wanted = " or ".join(f"{major}.{minor}" for major, minor in PYTHONS)
    return Finding(
        "Python",
        f"{platform.python_version()} ({sys.executable})",
        works=version in PYTHONS,
        remedy=f"Blender's Python module needs Python {wanted}: install one, remove .venv, and "
        "run: make setup",
    )


def package_finding(name: str, expected: str) -> Finding:
    """Whether a package is installed in a version that starts with ``expected``, without importing
    it.
    """
    try:
        version = metadata.version(name)
    except metadata.PackageNotFoundError:
        return Finding(name, "not installed", works=False, needed=True, remedy=INSTALL)
    if not version.startswith(expected):
        found = f"{version}, expected {expected}*"
        return Finding(name, found, works=False, needed=True, remedy=INSTALL)
    return Finding(name, version)


def import_finding(subject: str, module: str, *, needed: bool) -> Finding:
    """Whether a module can be imported, tried in a child process: shared libraries may be
    missing.
    """
    if importlib.util.find_spec(module) is None:
        return Finding(subject, "not installed", works=False, needed=needed, remedy=INSTALL)
    code = (
        f"import {module}; print(getattr({module}, '__version__', '') or "
        f"{module}.app.version_string)"
    )
    done = subprocess.run(
        python_code(code),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        encoding="utf-8",
        errors="replace",
    )
    if done.returncode == 0:
        return Finding(subject, done.stdout.strip().splitlines()[-1])
    reason = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
    return Finding(subject, reason, works=False, needed=needed, remedy=_library_remedy())


def opencv_finding() -> Finding:
    """Whether OpenCV is there, with all modules, and writes OpenEXR: other packages of it lack
    these.
    """
    finding = import_finding("OpenCV", "cv2", needed=True)
    if not finding.works:
        return finding
    code = (
        "import os; os.environ['OPENCV_IO_ENABLE_OPENEXR'] = '1'; import cv2; raise SystemExit("
        "3 if not hasattr(cv2, 'ximgproc') else not cv2.haveImageWriter('picture.exr'))"
    )
    done = subprocess.run(python_code(code), stdin=subprocess.DEVNULL, capture_output=True)
    if done.returncode == 0:
        return finding
    lack = (
        "lacks ximgproc, so it is not opencv-contrib-python-headless"
        if done.returncode == 3
        else "cannot write OpenEXR, which results are in"
    )
    found = f"{finding.found} {lack}"
    return Finding("OpenCV", found, works=False, needed=True, remedy=f"Run: {REMEDY}")


def renderer_findings() -> Iterator[Finding]:
    """Every libLLVM and CUDA; one that works is enough, and only their absence is a failure."""
    probes = [native.probe_llvm(library) for library in native.llvm_candidates()]
    for probe in probes:
        yield Finding("libLLVM", f"{probe.name}: {probe.reason or 'works'}", works=probe.works)
    cuda = native.probe_cuda()
    yield Finding("CUDA and OptiX", cuda.reason or "works", works=cuda.works)
    if any(probe.works for probe in probes):
        variant = native.choose_variant("auto")
        yield Finding(
            "renderer", variant if cuda.works else f"{variant}, {os.environ[native.LLVM_VARIABLE]}"
        )
    elif cuda.works:
        yield Finding("renderer", native.CUDA_VARIANT)
    else:
        yield Finding(
            "renderer", "none works", works=False, needed=True, remedy=native.llvm_remedy()
        )


def folder_finding(subject: str, place: Callable[[], Path]) -> Finding:
    """Whether there is such a folder, and it can be written."""
    try:
        folder = place()
    except (InputError, OSError) as error:
        return Finding(subject, str(error), works=False)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        found = f"{folder} cannot be written ({error.strerror or error})"
        remedy = (
            "Make it writable, or set FACESTAGE_CACHE (the cache) or TMPDIR (the "
            "temporary folder) to one that is."
        )
        return Finding(subject, found, works=False, remedy=remedy)
    return Finding(subject, str(folder))


def data_finding() -> Finding:
    """Face models beside the built-in one, where the tests look for them too; nothing needs
    them.
    """
    archives = sorted(data_folder().glob("ict-facekit*"))
    others = [f"--model ict:{path}" for path in archives] or [
        "--model ict:PATH for ICT-FaceKit, not found here"
    ]
    return Finding("face models", f"default (built in); {'; '.join(others)}")


def landmark_finding() -> Finding:
    """The model that finds faces, which only photos without a landmark file need."""
    try:
        path = find_model()
    except InputError as error:
        return Finding("landmark model", str(error), works=False)
    if path is None:
        fetched = (
            "Downloads are off" if is_offline() else "A fit without --landmarks fetches it (3.7 MB)"
        )
        remedy = f"{fetched}; without a network put {URL} at {_place()}"
        return Finding("landmark model", "not on this machine yet", works=False, remedy=remedy)
    return Finding("landmark model", str(path))


def _place() -> str:
    """Where a landmark model may be put by hand."""
    try:
        return str(cached_path())
    except InputError:
        return f"a place that ${VARIABLE} names"


def online_finding() -> Finding:
    """Whether the backend may fetch what it lacks."""
    if is_offline():
        return Finding("online access", f"off (${OFFLINE_VARIABLE}): nothing is downloaded")
    return Finding(
        "online access",
        f"allowed, for the landmark model alone ({OFFLINE_VARIABLE}=1 turns it off)",
    )


def _library_remedy() -> str:
    """What to do when an installed module does not import."""
    if Path("/etc/debian_version").exists():
        sudo = "" if hasattr(os, "geteuid") and os.geteuid() == 0 else "sudo "
        return f"Run: {sudo}apt-get install {' '.join(DESKTOP_LIBRARIES)}"
    if platform.system() == "Windows":
        return "Run: winget install Microsoft.VCRedist.2015+.x64"
    if platform.system() == "Darwin":
        return "Run: make clean setup"
    return "Install the library it names with your package manager."


if __name__ == "__main__":
    sys.exit(run_doctor(sys.stdout))

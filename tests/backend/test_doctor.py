"""The report: complete, with a remedy for what does not work, and an exit code that programs can
use.
"""

from __future__ import annotations

import io
import os
import sys
from pathlib import Path

import pytest

from facestage import doctor
from facestage.system import native
from facestage.system.child import python_code

REPOSITORY = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache folder of the test's own."""
    monkeypatch.setenv("FACESTAGE_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv(native.LLVM_VARIABLE, "")
    return tmp_path / "cache"


@pytest.fixture
def no_renderer(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine with LLVM 15 and no GPU."""
    monkeypatch.setattr(native, "llvm_candidates", lambda: [Path("/usr/lib/libLLVM-15.so.1")])
    monkeypatch.setattr(
        native,
        "probe_llvm",
        lambda path: native.Probe(str(path), "the renderer crashed with signal 6"),
    )
    monkeypatch.setattr(
        native, "probe_cuda", lambda: native.Probe("CUDA", "no NVIDIA driver is installed")
    )


def test_report_names_everything_a_user_may_be_asked_about(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(native, "probe_llvm", lambda path: native.Probe(str(path), ""))
    monkeypatch.setattr(native, "llvm_candidates", lambda: [Path("/opt/libLLVM.so.19.1")])
    stream = io.StringIO()
    code = doctor.run_doctor(stream)
    text = stream.getvalue()
    for subject in (
        "Python",
        "mitsuba",
        "drjit",
        "numpy",
        "OpenCV",
        "libLLVM",
        "CUDA and OptiX",
        "Blender (bpy)",
        "cache folder",
        "face models",
    ):
        assert subject in text
    assert code == 0, text
    assert text.endswith("This machine can fit.\n")


@pytest.mark.usefixtures("no_renderer")
def test_no_renderer_is_exit_code_four_with_the_remedy() -> None:
    stream = io.StringIO()
    assert doctor.run_doctor(stream) == 4
    assert "crashed with signal 6" in stream.getvalue()
    assert native.llvm_remedy() in stream.getvalue()
    assert "cannot fit yet" in stream.getvalue()


def test_missing_package_is_needed_and_has_a_remedy() -> None:
    finding = doctor.package_finding("no-such-distribution", "")
    assert (finding.works, finding.needed) == (False, True)
    assert "make setup" in str(finding)


def test_wrong_version_of_a_package_is_a_failure() -> None:
    finding = doctor.package_finding("numpy", "0.1.")
    assert not finding.works
    assert "expected 0.1.*" in finding.found


def test_module_that_crashes_on_import_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "needs_a_library.py").write_text(
        "raise ImportError('libX11.so.6: cannot open shared object file')\n"
    )
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    finding = doctor.import_finding("module", "needs_a_library", needed=True)
    assert not finding.works
    assert "libX11.so.6" in finding.found
    assert finding.remedy


@pytest.mark.parametrize(
    ("has", "words"),
    [
        ("ximgproc = None", "5.0.0 cannot write OpenEXR"),
        ("", "5.0.0 lacks ximgproc, so it is not opencv-contrib-python-headless"),
    ],
)
def test_another_opencv_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, has: str, words: str
) -> None:
    assert doctor.opencv_finding().works
    other = "__version__ = '5.0.0'\ndef haveImageWriter(name): return not name.endswith('.exr')\n"
    (tmp_path / "cv2.py").write_text(f"{other}{has}\n")
    before = f"import sys; sys.path.insert(0, {str(tmp_path)!r})"
    monkeypatch.setattr(doctor, "python_code", lambda code: python_code(f"{before}\n{code}"))
    finding = doctor.opencv_finding()
    assert (finding.works, finding.needed) == (False, True)
    assert words in finding.found and "pip uninstall" in finding.remedy


def test_folder_that_cannot_be_written_is_reported(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    finding = doctor.folder_finding("cache folder", lambda: tmp_path / "file")
    assert not finding.works
    assert "FACESTAGE_CACHE" in finding.remedy


def test_data_folder_is_listed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FACESTAGE_DATA", str(tmp_path))
    assert "not found here" in doctor.data_finding().found
    (tmp_path / "ict-facekit.tar.xz").write_bytes(b"")
    assert f"--model ict:{tmp_path / 'ict-facekit.tar.xz'}" in doctor.data_finding().found


def test_setup_and_doctor_name_the_same_system_libraries(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(REPOSITORY / "tools"))
    import setup_native

    assert tuple(setup_native.PACKAGES) == doctor.DESKTOP_LIBRARIES
    assert setup_native.LLVM_PACKAGES[0] == f"libllvm{native.PREFERRED_LLVM}"


def test_report_leaves_the_environment_of_this_process_usable() -> None:
    doctor.run_doctor(io.StringIO())
    chosen = os.environ[native.LLVM_VARIABLE]
    assert not chosen or Path(chosen).is_file()

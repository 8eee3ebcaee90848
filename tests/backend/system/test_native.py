"""Choosing a libLLVM: candidates, the child process that tries one, and the memory of what
worked.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from facestage.contract.errors import BackendUnavailableError, InputError
from facestage.system import native


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache folder, and no libLLVM chosen by the user."""
    monkeypatch.setenv("FACESTAGE_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv(native.LLVM_VARIABLE, "")  # so that what a test leaves there is undone
    monkeypatch.delenv(native.LLVM_VARIABLE)
    return tmp_path / "cache"


@pytest.fixture
def only_broken(cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A machine whose one libLLVM is not a library at all."""
    broken = tmp_path / "libLLVM.so.19.1"
    broken.write_text("not a library\n")
    monkeypatch.setattr(native, "llvm_candidates", lambda: [broken])
    return broken


def working_library() -> Path:
    """A libLLVM of this machine that works, or a skip."""
    for library in native.llvm_candidates():
        if native.probe_llvm(library).works:
            return library
    pytest.skip("this machine has no libLLVM that works")


def test_missing_library_is_named_without_starting_anything(tmp_path: Path) -> None:
    probe = native.probe_llvm(tmp_path / "libLLVM.so")
    assert not probe.works
    assert probe.reason == "the file does not exist"


def test_file_that_is_no_library_is_rejected(only_broken: Path) -> None:
    probe = native.probe_llvm(only_broken)
    assert not probe.works
    assert probe.reason


@pytest.mark.parametrize("version", [14, 15])
def test_old_llvm_is_rejected_and_this_process_lives(version: int) -> None:
    old = [path for path in native.llvm_candidates() if native.llvm_version(path) == version]
    if not old:
        pytest.skip(f"LLVM {version} is not on this machine")
    probe = native.probe_llvm(old[0])
    assert not probe.works
    assert ("too old" in probe.reason) == (version == 14)
    assert ("crashed" in probe.reason) == (version == 15)


def test_no_usable_library_is_one_sentence_with_the_remedy(only_broken: Path) -> None:
    with pytest.raises(BackendUnavailableError) as caught:
        native.ensure_llvm()
    assert str(only_broken) in str(caught.value)
    assert native.llvm_remedy() in str(caught.value)
    assert caught.value.exit_code == 4
    assert native.LLVM_VARIABLE not in os.environ


def test_broken_choice_of_the_user_does_not_hide_a_library_that_works(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    library = working_library()
    broken = tmp_path / "libLLVM.so"
    broken.write_text("not a library\n")
    monkeypatch.setenv(native.LLVM_VARIABLE, str(broken))
    assert native.llvm_candidates()[0] == broken
    assert native.ensure_llvm() == library
    assert os.environ[native.LLVM_VARIABLE] == str(library)


def test_second_start_tries_nothing(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    working_library()
    monkeypatch.setattr(native, "probe_cuda", lambda: native.Probe("CUDA", "none"))
    first = native.ensure_llvm()

    def refuse(library: Path) -> native.Probe:
        raise AssertionError(f"tried {library} although its answer is known")

    monkeypatch.setattr(native, "probe_llvm", refuse)
    assert native.ensure_llvm() == first
    assert native.choose_variant("auto") == native.LLVM_VARIANT


def test_changed_library_is_tried_again(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    library = tmp_path / "libLLVM.so.19.1"
    library.write_text("stands for a library\n")
    tried = []
    monkeypatch.setattr(native, "llvm_candidates", lambda: [library])

    def probe(path: Path) -> native.Probe:
        tried.append(path)
        return native.Probe(str(path), "")

    monkeypatch.setattr(native, "probe_llvm", probe)
    monkeypatch.setenv(native.LLVM_VARIABLE, "")
    native.ensure_llvm()
    native.ensure_llvm()
    assert tried == [library]
    os.utime(library, ns=(1, 1))
    native.ensure_llvm()
    assert tried == [library, library]


@pytest.mark.parametrize("content", ["", "{", "[]", '{"works": 3}', "null"])
def test_damaged_memory_is_ignored(cache: Path, only_broken: Path, content: str) -> None:
    cache.mkdir()
    (cache / "native.json").write_text(content)
    with pytest.raises(BackendUnavailableError):
        native.ensure_llvm()


def test_unwritable_memory_only_costs_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, only_broken: Path
) -> None:
    file = tmp_path / "file"
    file.write_text("a file where the cache folder should be")
    monkeypatch.setenv("FACESTAGE_CACHE", str(file))
    monkeypatch.setenv(native.LLVM_VARIABLE, "")
    monkeypatch.setattr(native, "probe_llvm", lambda path: native.Probe(str(path), ""))
    assert native.ensure_llvm() == only_broken


def test_unknown_device_is_an_input_error() -> None:
    with pytest.raises(InputError, match="expected one of auto, cpu, cuda"):
        native.choose_variant("tpu")


def test_cuda_on_demand_is_refused_where_it_does_not_work(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(native, "probe_cuda", lambda: native.Probe("CUDA", "no driver"))
    with pytest.raises(BackendUnavailableError, match=r"no driver.*--device cpu"):
        native.choose_variant("cuda")


@pytest.mark.parametrize(
    ("device", "variant"),
    [("auto", "cuda_ad_rgb"), ("cuda", "cuda_ad_rgb"), ("cpu", "llvm_ad_rgb")],
)
def test_cuda_is_chosen_when_it_works_unless_the_cpu_is_asked_for(
    cache: Path, only_broken: Path, monkeypatch: pytest.MonkeyPatch, device: str, variant: str
) -> None:
    monkeypatch.setenv(native.LLVM_VARIABLE, "")
    monkeypatch.setattr(native, "probe_cuda", lambda: native.Probe("CUDA", ""))
    monkeypatch.setattr(native, "probe_llvm", lambda path: native.Probe(str(path), ""))
    assert native.choose_variant(device) == variant


def test_renderer_gets_the_library_chosen_and_not_what_it_finds_itself(
    cache: Path, tmp_path: Path
) -> None:
    library = working_library()
    code = (
        "from facestage.render.variant import start_renderer; start_renderer('cpu'); import drjit, "
        "os\nprint(os.environ['DRJIT_LIBLLVM_PATH'], drjit.sin(drjit.arange(drjit.llvm.Float, "
        "3))[0])"
    )
    # A choice of the user's that does not exist: Dr.Jit would take no other.
    settings = {
        native.LLVM_VARIABLE: str(tmp_path / "libLLVM.so"),
        "DRJIT_CACHE_DIR": str(tmp_path / "kernels"),
    }
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, **settings},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
    )
    assert done.stdout == f"{library} 0.0\n", done.stderr


@pytest.mark.parametrize(
    ("name", "version"),
    [
        ("libLLVM.so.19.1", 19),
        ("libLLVM-14.so.1", 14),
        ("libLLVM.21.dylib", 21),
        ("LLVM-C.dll", None),
    ],
)
def test_version_is_read_from_the_file_name(tmp_path: Path, name: str, version: int | None) -> None:
    assert native.llvm_version(tmp_path / name) == version


def test_the_tested_version_comes_first_and_old_ones_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in (
        "libLLVM-14.so.1",
        "libLLVM-15.so",
        "libLLVM.so.20.1",
        "libLLVM.so.19.1",
        "libLLVM-17.so.1",
    ):
        (tmp_path / name).write_text(name)
    monkeypatch.delenv(native.LLVM_VARIABLE, raising=False)
    monkeypatch.setattr(native, "_system_folders", lambda: iter([tmp_path]))
    monkeypatch.setattr(sys, "prefix", str(tmp_path / "nowhere"))
    monkeypatch.setattr("platform.system", lambda: "Linux")
    versions = [native.llvm_version(path) for path in native.llvm_candidates()]
    assert versions == [19, 20, 17, 15, 14]


@pytest.mark.parametrize(
    ("system", "command"),
    [("Darwin", "brew install llvm"), ("Windows", "winget install LLVM.LLVM")],
)
def test_each_system_has_its_command(
    monkeypatch: pytest.MonkeyPatch, system: str, command: str
) -> None:
    monkeypatch.setattr("platform.system", lambda: system)
    assert command in native.llvm_remedy()


def test_command_says_which_renderer_works(cache: Path) -> None:
    working_library()
    done = subprocess.run(
        [sys.executable, "-m", "facestage.system.native"],
        capture_output=True,
        text=True,
        timeout=300,
        stdin=subprocess.DEVNULL,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(("llvm_ad_rgb", "cuda_ad_rgb"))
    assert json.loads((cache / "native.json").read_text())["works"]

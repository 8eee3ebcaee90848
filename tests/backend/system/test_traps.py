"""Nothing in the folder that the user happens to be in is run: neither Python modules nor libraries
nor settings.
"""

from __future__ import annotations

import importlib
import multiprocessing
import os
import shutil
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

from facestage.system import child

# What the backend, its libraries or the probes import, and what Python itself needs to start a
# module.
MODULES = (
    "multiprocessing",
    "pickle",
    "resource",
    "json",
    "runpy",
    "site",
    "sitecustomize",
    "usercustomize",
    "drjit",
    "mitsuba",
    "cv2",
    "bpy",
    "numpy",
    "scipy",
    "h5py",
    "skimage",
    "matplotlib",
    "PIL",
    "pooch",
    "marshmallow",
    "filelock",
    "facestage",
    "facestage_preload",
)
TRAP = (
    "import os\nopen(os.environ['TRAP_MARKER'], 'a').write(__name__ + '\\n')\nraise "
    "SystemExit(77)\n"
)
PLUGINS = (
    "sphere",
    "diffuse",
    "area",
    "rectangle",
    "prb",
    "prb_basic",
    "hdrfilm",
    "independent",
    "box",
    "scene",
)


@pytest.fixture
def trapped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A current folder full of traps, each of which leaves its name in the file ``trapped.parent /
    'marker'``.
    """
    folder = tmp_path / "photos"
    (folder / "plugins").mkdir(parents=True)
    for name in MODULES:
        (folder / f"{name}.py").write_text(TRAP)
    # Not by its spec, which is another one once it was imported.
    constant = Path(
        str(metadata.distribution("mitsuba").locate_file("mitsuba")), "plugins", "constant.so"
    )
    for name in PLUGINS if constant.is_file() else ():
        # A plugin of another kind: an object made of it would be a lamp.
        shutil.copyfile(constant, folder / "plugins" / f"{name}.so")
    (folder / "matplotlibrc").write_bytes(b"\xff\xfe no text at all")
    monkeypatch.chdir(folder)
    monkeypatch.setenv("TRAP_MARKER", str(tmp_path / "marker"))
    monkeypatch.setenv("FACESTAGE_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("DRJIT_CACHE_DIR", str(tmp_path / "kernels"))
    return folder


def sprung(trapped: Path) -> str:
    """The names of the traps that were run."""
    marker = trapped.parent / "marker"
    return marker.read_text() if marker.exists() else ""


def run(command: list[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command, capture_output=True, text=True, timeout=300, stdin=subprocess.DEVNULL, check=False
    )


def facestage(*arguments: str) -> subprocess.CompletedProcess[str]:
    """The command as its console script runs it: with the script's folder on the path, not the
    current one.
    """
    return run([sys.executable, "-P", "-m", "facestage.cli", *arguments])


@pytest.mark.parametrize(
    ("command", "code", "says"),
    [
        (["doctor"], 0, "This machine can fit."),
        (["fit", "none.png", "--out", "out"], 2, "none.png"),
        (["render", "none", "--out", "out.png"], 2, "none"),
        (["detect", "none.png", "--out", "out.json"], 2, "none.png"),
        (["stress", "--case", "one-pixel"], 0, "1 refused"),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else None,
)
def test_a_command_runs_nothing_of_the_current_folder(
    trapped: Path, command: list[str], code: int, says: str
) -> None:
    done = facestage(*command)
    assert sprung(trapped) == ""
    assert done.returncode == code, done.stdout + done.stderr
    assert says in done.stdout + done.stderr
    if command[0] in ("doctor", "fit", "render"):
        assert (trapped.parent / "cache" / "native.json").is_file(), (
            "the probe was run, and found a renderer"
        )


@pytest.mark.parametrize("python_path", [os.pathsep, f"{os.pathsep}/nowhere", ".", "../photos"])
def test_a_child_believes_no_relative_python_path(
    trapped: Path, monkeypatch: pytest.MonkeyPatch, python_path: str
) -> None:
    monkeypatch.setattr(sys, "path", ["", str(trapped), *sys.path])
    monkeypatch.setenv("PYTHONPATH", python_path)
    done = run(
        child.python_code(
            "import json, numpy, facestage; print(sys.argv[1:], facestage.__file__)", "a", "b c"
        )
    )
    assert sprung(trapped) == ""
    assert done.stdout.startswith("['a', 'b c'] ") and str(trapped) not in done.stdout, done.stderr


@pytest.mark.parametrize("python_path", [os.pathsep, ".", "../photos"])
def test_what_is_spawned_runs_nothing_of_the_current_folder(
    trapped: Path, monkeypatch: pytest.MonkeyPatch, python_path: str
) -> None:
    monkeypatch.setattr(sys, "path", ["", str(trapped), *sys.path])
    monkeypatch.setenv("PYTHONPATH", python_path)
    before = dict(os.environ), sys.path, sys.modules["__main__"]
    spawn = multiprocessing.get_context("spawn")
    for module, code in (("json", 0), ("only_in_a_dream", 1)):
        process = spawn.Process(target=importlib.import_module, args=(module,))
        with child.apart(SAID="1"):
            process.start()
        process.join()
        assert process.exitcode == code
    assert sprung(trapped) == ""
    assert (dict(os.environ), sys.path, sys.modules["__main__"]) == before


def test_a_script_that_spawns_is_not_run_twice(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "import os\n"
        "from multiprocessing import get_context\n"
        "from facestage.system.child import apart\n"
        "print('once', flush=True)\n"
        "process = get_context('spawn').Process(target=print, args=('child',))\n"
        "with apart():\n"
        "    process.start()\n"
        "process.join()\n"
    )
    assert run([sys.executable, str(script)]).stdout == "once\nchild\n"


def test_a_child_finds_what_python_path_names_by_its_whole_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "only_on_the_path.py").write_text("FOUND = 'found'\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    assert (
        run(child.python_code("import only_on_the_path as it; print(it.FOUND)")).stdout == "found\n"
    )


def test_a_child_runs_a_module_with_its_arguments(tmp_path: Path) -> None:
    (tmp_path / "whole.py").write_text("import sys\nprint(__name__, sys.argv[1:])\n")
    command = child.python_module("whole", "x")
    command[3] = f"import sys; sys.path.append({str(tmp_path)!r})\n{command[3]}"
    assert run(command).stdout == "__main__ ['x']\n"


def test_a_child_starts_where_the_current_folder_was_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert run(child.python_code("import facestage; print('alive')")).stdout == "alive\n"


def test_mitsuba_loads_no_library_of_the_current_folder(trapped: Path) -> None:
    code = (
        "from facestage.render.variant import load_dict, start_renderer; start_renderer('cpu')\n"
        "print([type(load_dict({'type': name})).__name__ for name in ('sphere', 'prb_basic', "
        "'prb', 'independent')])\n"
        "import mitsuba; print(mitsuba.file_resolver())"
    )
    done = run(child.python_code(code))
    assert done.returncode == 0, done.stderr
    assert "['Shape', 'BasicPRBIntegrator', 'PRBIntegrator', 'Sampler']" in done.stdout
    assert str(trapped) not in done.stdout + done.stderr


def test_matplotlib_reads_no_settings_of_the_current_folder(trapped: Path) -> None:
    done = run(
        child.python_code(
            "from facestage.report.figure import DARK, Canvas; Canvas(9, 9, DARK); print('drawn')"
        )
    )
    assert (done.stdout, done.stderr) == ("drawn\n", "")

"""However a command ends: one sentence, the right exit code, nothing half written."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from facestage import cli
from facestage.cli.signals import Cancellation
from facestage.contract.errors import BackendUnavailableError
from facestage.contract.files.temporaries import PREFIX
from facestage.system import child
from reference.command_line import fit_arguments, one_sentence
from reference.synthetic_case import Case

POSIX = pytest.mark.skipif(os.name != "posix", reason="needs the devices and limits of a Unix")
# Starts the command line in a process of its own, after BEFORE was run there.
START = (
    "{before}\nimport sys\nsys.argv = ['facestage', *sys.argv[1:]]\nfrom facestage.cli "
    "import main\nsys.exit(main())"
)


def start(before: str, *arguments: object, **options: Any) -> subprocess.CompletedProcess[str]:
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    settings: dict[str, Any] = {
        "stdout": subprocess.PIPE,
        "stderr": subprocess.PIPE,
        "env": environment,
        **options,
    }
    command = child.python_code(START.format(before=before), *map(str, arguments))
    return subprocess.run(
        command, stdin=subprocess.DEVNULL, text=True, timeout=240, check=False, **settings
    )


@POSIX
@pytest.mark.parametrize(
    "arguments", [["stress", "--list"], ["fit", "--help"], ["model", "MODEL"], ["--version"]]
)
def test_a_full_standard_output_is_one_sentence(case: Case, arguments: list[str]):
    with Path("/dev/full").open("w") as full:
        done = start(
            "", *[case.model_option if word == "MODEL" else word for word in arguments], stdout=full
        )
    assert done.returncode == 2 and "No space left" in one_sentence(done.stderr)


@POSIX
def test_a_fit_whose_events_cannot_be_written_stops(case: Case, tmp_path: Path):
    with Path("/dev/full").open("w") as full:
        done = start("", *fit_arguments(case, tmp_path / "out"), stdout=full)
    assert done.returncode == 2 and "No space left" in one_sentence(done.stderr)
    assert list(tmp_path.iterdir()) == []


@POSIX
def test_a_full_standard_error_changes_no_exit_code():
    with Path("/dev/full").open("w") as full:
        assert start("", "render", "none", stderr=full).returncode == 2


@POSIX
def test_a_file_does_not_become_the_closed_standard_output(tmp_path: Path):
    before = f"""
import os, sys
os.close(0); os.close(1); os.close(2)
sys.stdin = sys.stdout = sys.stderr = None
import facestage.cli.model
def run(_options):
    files = [open({str(tmp_path)!r} + f"/{{number}}", "w") for number in range(3)]
    os.write(1, b"what a library prints"), os.write(2, b"what a library prints")
    return 0
facestage.cli.model.run = run
"""
    assert start(before, "model", "default").returncode == 0
    assert [(tmp_path / str(number)).read_text() for number in range(3)] == ["", "", ""]


HOMELESS = """
import os, pwd
def nobody(_number):
    raise KeyError("uid not found")
pwd.getpwuid = nobody
for name in list(os.environ):
    if name in ("HOME", "MPLCONFIGDIR") or name.startswith(("XDG_", "FACESTAGE_", "DRJIT_CACHE")):
        del os.environ[name]
os.environ["FACESTAGE_DATA"] = "/nowhere"
"""


@POSIX
def test_a_user_without_home_and_passwd_entry_can_work(case: Case, tmp_path: Path):
    done = start(HOMELESS, "model", case.model_option, "--out", tmp_path / "m.npz")
    assert (done.returncode, done.stderr) == (0, "") and (tmp_path / "m.npz").is_file()
    done = start(HOMELESS, "detect", case.photo, "--out", tmp_path / "points.json")
    assert done.returncode == 2 and "FACESTAGE_CACHE" in one_sentence(done.stderr)
    # Far enough to have tried the renderer, which no cache remembers.
    done = start(HOMELESS, "fit", "none.png", "--out", tmp_path / "out")
    assert done.returncode == 2 and "none.png" in one_sentence(done.stderr)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["m.npz"]


@POSIX
def test_a_cache_that_cannot_be_used_leaves_the_libraries_silent(tmp_path: Path):
    (tmp_path / "home").write_text("a file where the home folder should be")
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in ("DRJIT_CACHE_DIR", "MPLCONFIGDIR")
    }
    done = start(
        "import os\nfrom facestage.system.folders import shelter_caches; shelter_caches()\n"
        "from facestage.render.variant import start_renderer; start_renderer('cpu')\n"
        "from facestage.report.figure import DARK, Canvas; Canvas(9, 9, DARK)\n"
        "print(os.environ['DRJIT_CACHE_DIR'], os.environ['MPLCONFIGDIR'])",
        "--version",
        env={**environment, "HOME": str(tmp_path / "home")},
    )
    assert (done.returncode, done.stderr) == (0, "")
    for folder in done.stdout.splitlines()[0].split():
        assert "facestage-cache-" in folder and not Path(folder).exists(), (
            "it is removed when the process ends"
        )


LIMIT = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({size}, {size}))"


@POSIX
@pytest.mark.parametrize("size", [1000, 20_000])
def test_a_disk_that_fills_while_a_model_is_written(case: Case, tmp_path: Path, size: int):
    (tmp_path / "m.npz").write_bytes(b"what was there")
    done = start(LIMIT.format(size=size), "model", case.model_option, "--out", tmp_path / "m.npz")
    assert done.returncode == 2 and "File too large" in one_sentence(done.stderr)
    assert [path.name for path in tmp_path.iterdir()] == ["m.npz"]
    assert (tmp_path / "m.npz").read_bytes() == b"what was there"


@POSIX
@pytest.mark.parametrize(
    "size", [2000, pytest.param(90_000, marks=pytest.mark.slow)], ids=["checkpoint", "result"]
)
def test_a_disk_that_fills_during_a_fit(case: Case, tmp_path: Path, size: int):
    done = start(LIMIT.format(size=size), *fit_arguments(case, tmp_path / "out"))
    assert done.returncode == 2, done.stderr
    assert "File too large" in one_sentence(done.stderr) or "disk full" in one_sentence(done.stderr)
    assert {path.name for path in tmp_path.iterdir()} <= {"out.partial"}, (
        "no result, nor half of one"
    )
    assert not list((tmp_path / "out.partial").glob(f"{PREFIX}*")), "nothing half written"


SIGNAL = """
import os, signal, sys
sent = []
def hook(event, arguments):
    if event == "import" and arguments[0] == {module!r} and not sent:
        sent.append(True)
        os.kill(os.getpid(), signal.{name})
sys.addaudithook(hook)
"""


@POSIX
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
@pytest.mark.parametrize(
    "module",
    [
        "facestage.cli.run",
        "argparse",
        "numpy",
        "mitsuba",
        "scipy.linalg",
        "facestage.fit.result.run",
    ],
)
def test_a_signal_during_an_import(case: Case, tmp_path: Path, module: str, name: str):
    done = start(SIGNAL.format(module=module, name=name), *fit_arguments(case, tmp_path / "out"))
    assert done.returncode == 3, done.stderr
    sentence = one_sentence(done.stderr)
    assert "cancelled" in sentence and "--resume" not in sentence, "there is no checkpoint yet"
    assert list(tmp_path.iterdir()) == []


@POSIX
def test_a_signal_in_a_destructor_is_not_lost():
    before = """
import os, signal, time
import facestage.cli.model
class Dying:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)
def run(_options):
    Dying()
    time.sleep(200)
facestage.cli.model.run = run
"""
    done = start(before, "model", "default")
    assert done.returncode == 3 and "cancelled" in one_sentence(done.stderr)


def test_a_listener_that_left_is_no_fault():
    reading, writing = os.pipe()
    os.close(reading)
    try:
        done = start("", "stress", "--list", stdout=writing)
    finally:
        os.close(writing)
    assert (done.returncode, done.stderr) == (3, "")


def failing(error: BaseException) -> Callable[[object], int]:
    def run(_options: object) -> int:
        raise error

    return run


def hidden() -> BaseException:
    """What a library may make of a full disk while it closes its file."""
    error = ValueError("write to closed file")
    error.__context__ = OSError(errno.ENOSPC, "No space left on device")
    return error


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (
            OSError(errno.ENOSPC, "No space left on device", "a/b.npz"),
            ["Cannot write 'a/b.npz'", "free some space"],
        ),
        (OSError(errno.EDQUOT, "Disk quota exceeded"), ["Disk quota exceeded", "free some space"]),
        (OSError(errno.EROFS, "Read-only file system", "a"), ["'a'", "Read-only", "who may"]),
        (PermissionError(errno.EACCES, "Permission denied", "a"), ["'a'", "Permission denied"]),
        (OSError("4 requested and 0 written"), ["0 written", "disk"]),
        (MemoryError("Unable to allocate 57 GiB"), ["57 GiB", "memory"]),
        (MemoryError(), ["memory"]),
        (hidden(), ["No space left"]),
    ],
)
def test_what_the_machine_cannot_do_is_one_sentence(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    error: BaseException,
    words: list[str],
):
    monkeypatch.setattr("facestage.cli.model.run", failing(error))
    assert cli.main(["model", "default"]) == 2
    sentence = one_sentence(capsys.readouterr().err)
    assert all(word in sentence for word in words), sentence


def test_a_fault_of_the_program_keeps_its_traceback(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("facestage.cli.model.run", failing(KeyError("no such thing")))
    with pytest.raises(KeyError):
        cli.main(["model", "default"])


def test_a_call_leaves_the_signals_as_they_were(monkeypatch: pytest.MonkeyPatch):
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    monkeypatch.setattr("facestage.cli.model.run", failing(KeyboardInterrupt()))
    assert cli.main(["model", "default"]) == 3
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before


def test_an_ignored_signal_stays_ignored():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with Cancellation():
            assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_another_package_of_opencv_ends_a_fit_in_a_sentence(case: Case, tmp_path: Path):
    other, out = tmp_path / "other", tmp_path / "out"
    other.mkdir()
    (other / "cv2.py").write_text("__version__ = '5.0.0'\n")
    before = f"import sys; sys.path.insert(0, {str(other)!r})"
    done = start(before, *fit_arguments(case, out))
    assert done.returncode == BackendUnavailableError.exit_code, done.stderr
    assert one_sentence(done.stderr).startswith("facestage: OpenCV 5.0.0 at ")
    assert list(tmp_path.iterdir()) == [other]

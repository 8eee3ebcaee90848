"""Files and folders appear whole or not at all; what is not Facestage's stays; a kill leaves
nothing for long.
"""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.files import atomic, durable, storage, temporaries
from facestage.contract.files.atomic import atomic_file, atomic_folder, read_consistently
from facestage.contract.files.storage import read_json, write_json
from facestage.contract.result import Result
from facestage.contract.result_files import is_result_file


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def write_folder(target: Path, **contents: str) -> None:
    with atomic_folder(target, is_result_file) as folder:
        for name, content in contents.items():
            (folder / f"{name}.json").write_text(content)


@pytest.fixture(params=["in one step", "in two"])
def exchanged(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the system's exchange of two names, where it has one, and as if it had none."""
    if request.param == "in two":
        monkeypatch.setattr(durable, "_exchange_call", lambda: None)


def test_folder_appears_whole(tmp_path: Path):
    with atomic_folder(tmp_path / "deep" / "out") as folder:
        (folder / "a").write_text("1")
        assert not (tmp_path / "deep" / "out").exists()
    assert names(tmp_path / "deep") == ["out"]
    assert (tmp_path / "deep" / "out" / "a").read_text() == "1"


@pytest.mark.usefixtures("exchanged")
def test_folder_replaces_the_old_one_entirely(tmp_path: Path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "stale").touch()
    with atomic_folder(tmp_path / "out") as folder:
        (folder / "fresh").touch()
    assert names(tmp_path) == ["out"] and names(tmp_path / "out") == ["fresh"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_folder_keeps_the_old_one_on_failure(tmp_path: Path, error: type[BaseException]):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "old").touch()

    def write() -> None:
        with atomic_folder(tmp_path / "out") as folder:
            (folder / "half").touch()
            raise error

    with pytest.raises(error):
        write()
    assert names(tmp_path) == ["out"] and names(tmp_path / "out") == ["old"]


@pytest.mark.usefixtures("exchanged")
def test_folder_keeps_the_old_one_when_the_last_rename_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    write_folder(tmp_path / "out", result="old")
    real = Path.rename

    def failing(self: Path, target: Path) -> Path:
        if Path(target) == tmp_path / "out" and self.name == temporaries.CONTENT:
            raise PermissionError(13, "another program holds it")
        return real(self, target)

    def held(_one: Path, _other: Path) -> bool:
        raise PermissionError(13, "another program holds it")

    monkeypatch.setattr(Path, "rename", failing)
    if durable._exchange_call() is not None:
        monkeypatch.setattr(atomic, "exchange", held)
    with pytest.raises(InputError, match="holds it"):
        write_folder(tmp_path / "out", result="new")
    assert names(tmp_path) == ["out"] and (tmp_path / "out" / "result.json").read_text() == "old"


@pytest.mark.usefixtures("exchanged")
def test_what_is_not_ours_goes_over_to_the_new_folder(tmp_path: Path):
    out = tmp_path / "out"
    write_folder(out, result="old", person="old")
    (out / "1-anna").mkdir()
    (out / "1-anna" / "report.html").touch()
    for mine in ("face.blend", "1-anna/notes.txt", "deep/er.png"):
        (out / mine).parent.mkdir(exist_ok=True)
        (out / mine).write_text("mine")
    (out / "link").symlink_to(tmp_path)
    write_folder(out, result="new")
    found = sorted(
        str(path.relative_to(out))
        for path in out.rglob("*")
        if not path.is_dir() or path.is_symlink()
    )
    assert found == ["1-anna/notes.txt", "deep/er.png", "face.blend", "link", "result.json"]
    assert (out / "face.blend").read_text() == "mine" and (out / "result.json").read_text() == "new"
    assert names(tmp_path) == ["out"]


def test_a_link_to_a_folder_stays_a_link(tmp_path: Path):
    write_folder(tmp_path / "real" / "out", result="old")
    (tmp_path / "link").symlink_to(tmp_path / "real" / "out")
    write_folder(tmp_path / "link", result="new")
    assert (tmp_path / "link").is_symlink() and (
        tmp_path / "real" / "out" / "result.json"
    ).read_text() == "new"


def test_file_appears_whole_and_keeps_its_suffix(tmp_path: Path):
    with atomic_file(tmp_path / "deep" / "a.exr") as path:
        assert path.suffix == ".exr" and path.parent == tmp_path / "deep"
        path.write_text("1")
        assert not (tmp_path / "deep" / "a.exr").exists()
    assert names(tmp_path / "deep") == ["a.exr"]


def test_what_is_written_is_as_readable_as_what_the_user_makes(tmp_path: Path):
    with atomic_file(tmp_path / "a") as path:
        path.touch()
    (tmp_path / "plain").touch()
    (tmp_path / "folder").mkdir()
    write_folder(tmp_path / "out")
    assert (tmp_path / "a").stat().st_mode == (tmp_path / "plain").stat().st_mode
    assert (tmp_path / "out").stat().st_mode == (tmp_path / "folder").stat().st_mode


def test_file_keeps_the_old_one_on_failure(tmp_path: Path):
    (tmp_path / "a.txt").write_text("old")

    def write() -> None:
        with atomic_file(tmp_path / "a.txt") as path:
            path.write_text("half")
            raise RuntimeError("stop")

    with pytest.raises(RuntimeError, match="stop"):
        write()
    assert names(tmp_path) == ["a.txt"] and (tmp_path / "a.txt").read_text() == "old"


def test_a_file_in_place_of_a_parent_is_an_input_error(tmp_path: Path):
    (tmp_path / "parent").touch()
    for write in (atomic_file, atomic_folder):
        with (
            pytest.raises(InputError, match=r"Cannot write .*parent.*may write"),
            write(tmp_path / "parent" / "x"),
        ):
            pytest.fail("the block must not run")


def test_a_folder_in_place_of_the_file_is_an_input_error(tmp_path: Path):
    (tmp_path / "a.json").mkdir()
    with pytest.raises(InputError, match=r"Cannot write .*a\.json"):
        write_json(tmp_path / "a.json", {})
    assert names(tmp_path) == ["a.json"]


@pytest.fixture
def order(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What was synced and what took another's place, in that order."""
    said: list[str] = []
    fsync, replace, rename = os.fsync, os.replace, Path.rename

    def name_of(handle: int) -> str:
        return Path(f"/proc/self/fd/{handle}").readlink().name

    def synced(handle: int) -> None:
        said.append(f"sync {name_of(handle)}")
        fsync(handle)

    def replaced(source: Path, target: Path) -> None:
        said.append(f"sees {Path(target).name}")
        replace(source, target)

    def renamed(self: Path, target: Path) -> Path:
        said.append(f"sees {target.name}")
        return rename(self, target)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(os, "replace", replaced)
    monkeypatch.setattr(Path, "rename", renamed)
    return said


@pytest.mark.skipif(
    not Path("/proc/self/fd").is_dir(), reason="asks Linux for the names of open files"
)
def test_a_file_is_on_the_disk_before_it_replaces_another_and_its_name_after(
    order: list[str], tmp_path: Path
):
    write_json(tmp_path / "a.json", {})
    assert order[0].startswith(f"sync {temporaries.PREFIX}")
    assert order[1:] == ["sees a.json", f"sync {tmp_path.name}"]


@pytest.mark.skipif(
    not Path("/proc/self/fd").is_dir(), reason="asks Linux for the names of open files"
)
def test_all_of_a_folder_is_on_the_disk_before_it_is_seen(order: list[str], tmp_path: Path):
    with atomic_folder(tmp_path / "out") as folder:
        (folder / "deep").mkdir()
        (folder / "deep" / "a").touch()
        (folder / "b").touch()
    seen = order.index("sees out")
    assert {"sync a", "sync b", "sync deep", f"sync {temporaries.CONTENT}"} <= set(order[:seen])
    assert order[seen + 1] == f"sync {tmp_path.name}"


def test_a_full_disk_leaves_the_old_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    write_json(tmp_path / "a.json", {"old": 1})
    write_folder(tmp_path / "out", result="old")

    def full(_handle: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(
        InputError, match=r"Cannot write '.*a\.json': No space left on device; make room"
    ):
        write_json(tmp_path / "a.json", {"new": 1})
    with pytest.raises(InputError, match=r"Cannot write the folder .*No space left"):
        write_folder(tmp_path / "out", result="new")
    assert names(tmp_path) == ["a.json", "out"]
    assert read_json(tmp_path / "a.json", "file") == {"old": 1}
    assert (tmp_path / "out" / "result.json").read_text() == "old"


# Starts to write a folder and a file beside each other, says so, and waits for its end.
WRITER = """
import sys
from contextlib import ExitStack
from pathlib import Path
from facestage.contract.files.atomic import atomic_file, atomic_folder
place = Path(sys.argv[1])
with ExitStack() as stack:
    folder = stack.enter_context(atomic_folder(place / "out"))
    (folder / "half").touch()
    (stack.enter_context(atomic_file(place / "a.txt"))).write_text("half")
    print("writing", flush=True)
    sys.stdin.read()
"""


def writer(place: Path) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-I", "-c", WRITER, str(place)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "writing\n"
    return process


def test_what_a_kill_leaves_is_swept_and_what_a_living_writer_holds_is_not(tmp_path: Path):
    with writer(tmp_path) as dead, writer(tmp_path) as living:
        dead.kill()
        dead.wait()
        (tmp_path / f"{temporaries.PREFIX}mine").write_text("the user's, whatever its name")
        assert len(names(tmp_path)) == 5
        write_folder(tmp_path / "out")
        (tmp_path / "out" / "result.json").touch()
        with atomic_file(tmp_path / "a.txt") as path:
            path.touch()
        assert len(names(tmp_path)) == 5, (
            "both of the living, the file of the user, and what was written"
        )
        living.communicate("")
        assert living.returncode == 0
    assert names(tmp_path) == [f"{temporaries.PREFIX}mine", "a.txt", "out"]
    assert (tmp_path / "a.txt").read_text() == "half" and names(tmp_path / "out") == ["half"]


def left_behind(place: Path) -> Path:
    """A marked folder of a dead writer of ``out``."""
    content, mark = temporaries.new_folder(place / "out")
    mark.let_go()
    return content.parent


def test_a_folder_that_was_moved_aside_goes_back(tmp_path: Path):
    """As a kill between the two renames leaves it, where a system cannot exchange names."""
    write_folder(tmp_path / "out", result="old")
    (tmp_path / "out").rename(left_behind(tmp_path) / temporaries.RETIRED)
    temporaries.sweep(tmp_path / "out", is_result_file)
    assert names(tmp_path) == ["out"] and (tmp_path / "out" / "result.json").read_text() == "old"


def test_the_users_files_come_out_of_what_a_kill_left(tmp_path: Path):
    write_folder(tmp_path / "out", result="new")
    retired = left_behind(tmp_path) / temporaries.RETIRED
    retired.mkdir()
    (retired / "result.json").write_text("old")
    (retired / "mine.txt").write_text("mine")
    temporaries.sweep(tmp_path / "out", is_result_file)
    assert names(tmp_path) == ["out"] and names(tmp_path / "out") == ["mine.txt", "result.json"]
    assert (tmp_path / "out" / "result.json").read_text() == "new"


def test_two_files_of_one_name_both_stay(tmp_path: Path):
    write_folder(tmp_path / "out", result="new")
    (tmp_path / "out" / "mine.txt").write_text("one")
    retired = left_behind(tmp_path) / temporaries.RETIRED
    retired.mkdir()
    (retired / "mine.txt").write_text("other")
    temporaries.sweep(tmp_path / "out", is_result_file)
    assert (retired / "mine.txt").read_text() == "other" and (
        tmp_path / "out" / "mine.txt"
    ).read_text() == "one"


def test_an_unmarked_folder_is_never_touched(tmp_path: Path):
    theirs = left_behind(tmp_path)
    (theirs / temporaries.MARK).unlink()
    (theirs / "mine").touch()
    temporaries.sweep(tmp_path / "out")
    assert (theirs / "mine").exists()


def write_pair(out: Path, number: int) -> None:
    """Two files that belong together."""
    with atomic_folder(out, is_result_file) as folder:
        write_json(folder / "result.json", {"number": number})
        write_json(folder / "job.json", {"number": number})


@pytest.mark.usefixtures("exchanged")
def test_a_reader_never_finds_the_folder_missing_or_mixed(tmp_path: Path):
    out, missing, writes = tmp_path / "out", [], 60
    write_pair(out, 0)

    def write() -> None:
        for number in range(1, writes + 1):
            write_pair(out, number)

    def read(folder: Path) -> tuple[int, int]:
        one = read_json(folder / "result.json", "result")["number"]
        return one, read_json(folder / "job.json", "job")["number"]

    thread = threading.Thread(target=write)
    thread.start()
    seen = []
    while thread.is_alive():
        missing += [not out.is_dir()]
        seen.append(read_consistently(out, read))
    thread.join()
    seen.append(read_consistently(out, read))
    assert all(one == other for one, other in seen)
    assert [one for one, _ in seen] == sorted(one for one, _ in seen) and seen[-1][0] == writes
    if durable._exchange_call() is not None:
        assert not any(missing)


def test_what_is_read_while_the_folder_is_replaced_is_read_again(tmp_path: Path):
    out = tmp_path / "out"
    write_pair(out, 1)
    reads = []

    def read(folder: Path) -> tuple[int, int]:
        one = read_json(folder / "result.json", "result")["number"]
        reads.append(one)
        if len(reads) == 1:
            write_pair(out, 2)
        return one, read_json(folder / "job.json", "job")["number"]

    assert read_consistently(out, read) == (2, 2) and reads == [1, 2]


def test_a_result_is_never_half_of_one_and_half_of_another(
    tmp_path: Path, result: Result, monkeypatch: pytest.MonkeyPatch
):
    out = tmp_path / "out"

    def write(seed: int) -> None:
        with atomic_folder(out, is_result_file) as folder:
            replace(result, seed=seed, albedo=np.full_like(result.albedo, seed)).write_into(folder)

    def read(path: Path, *arguments: Any) -> dict[str, np.ndarray]:
        monkeypatch.undo()
        # Between its result.json and its result.npz.
        write(2)
        return storage.read_arrays(path, *arguments)

    write(1)
    monkeypatch.setattr("facestage.contract.result.read_arrays", read)
    loaded = Result.load(out)
    assert loaded.seed == 2 and (loaded.albedo == 2).all()


def test_what_is_wrong_with_a_folder_is_said(tmp_path: Path):
    with pytest.raises(InputError, match="does not exist"):
        read_consistently(
            tmp_path / "none", lambda folder: read_json(folder / "result.json", "result")
        )

    def busy(folder: Path) -> None:
        (folder / "x").touch()
        (folder / "x").unlink()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(atomic, "READ_PAUSE", 0.0)
        with pytest.raises(InputError, match="replaced again and again"):
            read_consistently(tmp_path, busy)


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="asks Linux for the open files")
def test_no_file_stays_open_whether_it_was_written_or_not(tmp_path: Path):
    def failing() -> None:
        with atomic_file(tmp_path / "a.txt") as path:
            path.unlink()
            raise RuntimeError("stop")

    before = len(list(Path("/proc/self/fd").iterdir()))
    write_json(tmp_path / "a.json", {})
    write_folder(tmp_path / "out", result="new")
    # That the block has removed what it wrote does not hide why it stopped.
    with pytest.raises(RuntimeError, match="stop"):
        failing()
    assert len(list(Path("/proc/self/fd").iterdir())) == before


def test_what_is_wrong_is_said_at_once_and_what_is_replaced_is_read_again(tmp_path: Path):
    out = tmp_path / "out"
    write_pair(out, 1)
    reads: list[Path] = []

    def damaged(folder: Path) -> None:
        reads.append(folder)
        raise InputError("damaged")

    with pytest.raises(InputError, match="damaged"):
        read_consistently(out, damaged)
    assert reads == [out]

    def damaged_once(folder: Path) -> int:
        reads.append(folder)
        if len(reads) == 2:
            write_pair(folder, 2)
            raise InputError("half of one")
        return int(read_json(folder / "result.json", "result")["number"])

    assert read_consistently(out, damaged_once) == 2 and len(reads) == 3


def test_a_folder_that_never_comes_back_is_read_as_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    left_behind(tmp_path)
    monkeypatch.setattr(atomic, "READ_PAUSE", 0.0)
    assert read_consistently(tmp_path / "out", lambda folder: folder.name) == "out"

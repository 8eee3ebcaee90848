"""Files are read up to their limit and not a byte beyond, and no refusal leaves one open."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from facestage.contract.errors import InputError
from facestage.contract.files.reading import GIB, KIB, MIB, open_regular, read_bytes

OPEN = Path("/proc/self/fd")


def test_units_are_powers_of_1024():
    assert (KIB, MIB, GIB) == (1024, 1_048_576, 1_073_741_824)


@pytest.mark.parametrize("size", [0, 1, 5])
def test_a_file_may_be_as_large_as_its_limit(tmp_path: Path, size: int):
    path = tmp_path / "a"
    path.write_bytes(bytes(range(size)))
    for limit in (size, size + 1, 10**15):
        assert read_bytes(path, "camera file", limit) == bytes(range(size))


def test_a_file_one_byte_larger_is_refused(tmp_path: Path):
    path = tmp_path / "a"
    path.write_bytes(bytes(1025))
    with pytest.raises(InputError) as caught:
        read_bytes(path, "camera file", 1024)
    words = "has 1.001 KiB, expected at most 1 KiB; is it the right file?"
    assert str(caught.value) == f"The camera file '{path}' {words}"


def test_a_file_that_grows_while_it_is_read_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    path = tmp_path / "a"
    path.write_bytes(bytes(6))
    real = os.fstat

    def before_the_last_byte(handle: int) -> os.stat_result:
        found = list(real(handle))
        found[6] -= 1  # st_size
        return os.stat_result(found)

    monkeypatch.setattr(os, "fstat", before_the_last_byte)
    with pytest.raises(InputError) as caught:
        read_bytes(path, "camera file", 100)
    words = "grows while it is read; expected at most 5 bytes."
    assert str(caught.value) == f"The camera file '{path}' {words}"


def test_what_the_system_says_is_passed_on_without_its_number(tmp_path: Path):
    (tmp_path / "a").touch()
    for path, reason in ((tmp_path / "a" / "b", "Not a directory"), ("a\0b", "embedded null byte")):
        with pytest.raises(InputError, match=rf"cannot be read: {reason}; check the path\.$"):
            read_bytes(Path(path), "camera file", 10)


@pytest.mark.skipif(not OPEN.is_dir(), reason="asks Linux for the open files")
def test_what_is_refused_is_closed(tmp_path: Path):
    (tmp_path / "large").write_bytes(bytes(9))
    before = len(list(OPEN.iterdir()))
    for path, words in ((tmp_path, "is a folder"), (tmp_path / "large", "9 bytes")):
        with pytest.raises(InputError, match=words):
            open_regular(path, "camera file", 8)
    assert len(list(OPEN.iterdir())) == before
    with open_regular(tmp_path / "large", "camera file", 9) as stream:
        assert stream.read() == bytes(9)


@pytest.mark.skipif(not hasattr(os, "O_NONBLOCK"), reason="Windows has no such pipes")
def test_nobody_who_would_write_into_a_pipe_is_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    (tmp_path / "a").touch()
    asked, real = [], os.open

    def opened(path: Path, flags: int) -> int:
        asked.append(flags)
        return real(path, flags)

    monkeypatch.setattr(os, "open", opened)
    read_bytes(tmp_path / "a", "camera file", 1)
    assert asked == [os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC]

"""A reader that crashes, hangs, eats memory or talks nonsense ends as one clause, and what it read
comes back whole.
"""

from __future__ import annotations

import runpy
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.files.reading import GIB, MIB
from facestage.system.in_child import ChildLimits, ReaderFailedError, read_in_child

LIMITS = ChildLimits(memory=1 * GIB, seconds=2, array_bytes=1 * MIB)


def run_script(path: Path, names: Sequence[str]) -> Mapping[str, np.ndarray]:
    """Stands for a reader: the child finds runpy.run_path in its place, which gives what the script
    leaves behind.
    """
    raise AssertionError("only the child runs it")


run_script.__module__, run_script.__qualname__ = runpy.__name__, runpy.run_path.__qualname__
LEAVE = "\n[globals().pop(name) for name in list(globals()) if name not in ('a', 'b')]\n"


def in_child(folder: Path, script: str, limits: ChildLimits = LIMITS) -> dict[str, np.ndarray]:
    (folder / "script.py").write_text("import numpy as np\n" + script + LEAVE)
    return read_in_child(run_script, folder / "script.py", (), limits)


def test_arrays_come_back_as_they_are(tmp_path: Path):
    found = in_child(
        tmp_path, "a = np.arange(6, dtype='>f8').reshape(2, 3).T; b = np.zeros((0, 3), np.uint8)"
    )
    np.testing.assert_array_equal(found["a"], np.arange(6.0).reshape(2, 3).T)
    assert found["a"].dtype == np.float64 and found["a"].flags.writeable
    assert found["b"].shape == (0, 3) and found["b"].dtype == np.uint8


@pytest.mark.parametrize(
    ("script", "words"),
    [
        ("import os; os.abort()", r"crashes \(SIGABRT\)"),
        ("import ctypes; ctypes.string_at(0)", r"crashes \(SIGSEGV\)"),
        ("import os; os._exit(3)", "ended with code 3"),
        ("while True: pass", "takes more than 2 s"),
        ("a = np.ones(2**28)", "asks for more than 1 GiB of memory|Unable to allocate"),
        ("raise KeyError('first line\\nsecond')", r"^'first line\\nsecond'$"),
        ("a = np.ones(2**20)", "its arrays have 8 MiB, expected at most 1 MiB"),
        ("a = np.array([print])", "no sensible answer"),
        ("a = np.array(['text'])", "no sensible answer"),
        ("import os; os.write(3, b'{' * 100 + b'\\n'); os._exit(0)", "."),
    ],
)
def test_every_other_end_is_a_clause(tmp_path: Path, script: str, words: str):
    with pytest.raises(ReaderFailedError, match=words) as caught:
        in_child(tmp_path, script)
    assert "\n" not in str(caught.value)


def test_what_the_reader_says_is_passed_on(tmp_path: Path):
    script = (
        "from facestage.contract.errors import InputError\nraise InputError('The file is too old.')"
    )
    with pytest.raises(InputError, match=r"^The file is too old\.$"):
        in_child(tmp_path, script)


def test_what_a_library_prints_is_no_part_of_the_answer(tmp_path: Path):
    found = in_child(tmp_path, "import os\nprint('hello'); os.write(1, b'{}\\n'); a = np.arange(2)")
    np.testing.assert_array_equal(found["a"], [0, 1])


def test_the_current_folder_says_nothing_of_what_is_imported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    for name in ("numpy", "json", "h5py", "resource", "facestage"):
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w')")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    (tmp_path / "data").mkdir()
    assert in_child(tmp_path / "data", "a = np.arange(2)")["a"].tolist() == [0, 1]
    assert not (tmp_path / "ran").exists()


def test_a_large_file_gets_more_time():
    assert LIMITS.seconds_for(1000) == 2
    assert LIMITS.seconds_for(400 * MIB) == 27

"""A fit's place: marked as Facestage's, one run at a time, and nothing of the user's is taken or
removed.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.events import Event
from facestage.contract.files.partial import CHECKPOINT, LOCK, MARKER, partial_folder
from facestage.contract.job import Job
from facestage.contract.result import Result
from facestage.fit.result import person, run
from facestage.fit.runs.place import claimed
from reference.small_fit import SMALL, StopError
from reference.synthetic_case import Case

RESULT = "result.json"

fit_job = partial(run.fit_job, fineness=SMALL)
fit_person = partial(person.fit_person, fineness=SMALL)


@pytest.fixture
def job(case: Case) -> Job:
    """All but light is frozen: the quickest fit."""
    return case.job(
        truth=None, freeze=("albedo", "specular", "roughness", "identity", "expression")
    )


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def stop_at(words: str) -> Callable[[Event], None]:
    def listen(event: Event) -> None:
        if words in event.message:
            raise StopError

    return listen


def test_a_folder_of_the_user_is_neither_taken_nor_removed(job: Job, tmp_path: Path):
    mine = partial_folder(tmp_path / "out")
    mine.mkdir()
    (mine / "novel.txt").write_text("chapter 1")
    for resume in (False, True):
        with pytest.raises(
            InputError, match=r"out\.partial' holds 'novel\.txt'.*choose another --out"
        ):
            fit_job(job, tmp_path / "out", resume)
    with pytest.raises(InputError, match=r"novel\.txt"):
        fit_person([job, replace(job, image=tmp_path / "other.png")], tmp_path / "out")
    assert names(tmp_path) == ["out.partial"] and names(mine) == ["novel.txt"]


def test_nor_is_one_with_a_checkpoint_that_somebody_else_may_have_made(job: Job, tmp_path: Path):
    mine = partial_folder(tmp_path / "out")
    mine.mkdir()
    (mine / CHECKPOINT).write_bytes(b"of a neural network")
    with pytest.raises(InputError, match=r"not made by this version"):
        fit_job(job, tmp_path / "out")
    assert (mine / CHECKPOINT).read_bytes() == b"of a neural network"


def test_nor_a_file(job: Job, tmp_path: Path):
    partial_folder(tmp_path / "out").write_text("mine")
    with pytest.raises(InputError, match="which is a file"):
        fit_job(job, tmp_path / "out")
    assert partial_folder(tmp_path / "out").read_text() == "mine"


def test_what_the_user_puts_into_a_partial_folder_stays(job: Job, tmp_path: Path):
    with pytest.raises(StopError):
        fit_job(job, tmp_path / "out", emit=stop_at("step 1"))
    partial = partial_folder(tmp_path / "out")
    assert {MARKER, CHECKPOINT} <= set(names(partial)) and LOCK not in names(partial)
    (partial / "mine.txt").touch()
    fit_job(job, tmp_path / "out", resume=True)
    assert names(partial) == ["mine.txt"]


def test_what_the_user_keeps_in_a_result_stays_when_it_is_replaced(job: Job, tmp_path: Path):
    fit_job(job, tmp_path / "out")
    (tmp_path / "out" / "face.blend").write_text("mine")
    before = names(tmp_path / "out")
    fit_job(replace(job, seed=1), tmp_path / "out")
    assert names(tmp_path) == ["out"] and names(tmp_path / "out") == before
    assert (tmp_path / "out" / "face.blend").read_text() == "mine" and Result.load(
        tmp_path / "out"
    ).seed == 1


HOLDER = """
import sys
from pathlib import Path
from facestage.fit.runs.place import claimed
with claimed(Path(sys.argv[1]), "result.json"):
    print("held", flush=True)
    sys.stdin.read()
"""


def holder(out: Path) -> subprocess.Popen[str]:
    """Another process that writes into ``out``."""
    process = subprocess.Popen(
        [sys.executable, "-I", "-c", HOLDER, str(out)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    return process


def test_a_second_fit_is_refused_before_it_reads_anything(job: Job, tmp_path: Path):
    out = tmp_path / "out"
    with holder(out) as other:
        unread = replace(job, image=tmp_path / "none.png")
        for fit in (lambda: fit_job(unread, out), lambda: fit_person([job, unread], out)):
            with pytest.raises(
                InputError, match=r"Another fit is writing into .*out'; wait.*--out\.$"
            ):
                fit()
        assert LOCK in names(partial_folder(out)), "the other's"
        other.communicate("")
        assert other.returncode == 0
    assert names(tmp_path) == []


def test_a_lock_ends_with_its_process(tmp_path: Path):
    out = tmp_path / "out"
    with holder(out) as other:
        other.kill()
        other.wait()
    assert names(tmp_path) == ["out.partial"]
    with claimed(out, RESULT):
        pass
    assert names(tmp_path) == []


def test_many_runs_for_one_place_take_turns(tmp_path: Path):
    """Each goes in and out again and again; two within it at once would find each other's file."""
    script = (
        "import sys\nfrom pathlib import Path\nfrom facestage.contract.errors import "
        "InputError\nfrom facestage.fit.runs.place import claimed\nout, held = Path(sys.argv[1]), "
        "0\nwhile held < 20:\n    try:\n        with claimed(out, 'result.json') as partial:\n     "
        "       (partial / 'preview.png').open('x').close()\n            (partial / "
        "'preview.png').unlink()\n            held += 1\n    except InputError as error:\n        "
        "assert 'Another fit' in str(error), error\nprint(held)\n"
    )
    runs = [
        subprocess.Popen(
            [sys.executable, "-I", "-c", script, str(tmp_path / "out")],
            stdout=subprocess.PIPE,
            text=True,
        )
        for _ in range(3)
    ]
    assert [run.communicate(timeout=240)[0].strip() for run in runs] == ["20"] * 3
    assert names(tmp_path) == []


def test_a_bad_job_leaves_no_folder_behind(job: Job, tmp_path: Path):
    with pytest.raises(InputError):
        fit_job(replace(job, image=tmp_path / "none.png"), tmp_path / "deep" / "er" / "out")
    assert names(tmp_path) == []


def test_a_full_disk_leaves_no_lock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def full(_path: Path, _data: object) -> None:
        raise InputError("Cannot write: No space left on device; make room.")

    with monkeypatch.context() as patch:
        patch.setattr("facestage.contract.files.partial.write_json", full)
        with (
            pytest.raises(InputError, match="No space left"),
            claimed(tmp_path / "deep" / "out", RESULT),
        ):
            pytest.fail("the block must not run")
    assert names(tmp_path) == []
    with claimed(tmp_path / "deep" / "out", RESULT) as partial:
        assert MARKER in names(partial)


def test_a_fit_that_starts_anew_forgets_the_checkpoint_of_an_earlier_one(job: Job, tmp_path: Path):
    with pytest.raises(StopError):
        fit_job(job, tmp_path / "out", emit=stop_at("step 1"))
    with pytest.raises(StopError):
        fit_job(job, tmp_path / "out", emit=stop_at("Face model"))
    assert CHECKPOINT in names(partial_folder(tmp_path / "out")), "nothing had begun"
    fit_job(job, tmp_path / "out")
    assert names(tmp_path) == ["out"]


def test_a_checkpoint_of_another_version_is_refused_and_kept(job: Job, tmp_path: Path):
    with pytest.raises(StopError):
        fit_job(job, tmp_path / "out", emit=stop_at("step 1"))
    checkpoint = partial_folder(tmp_path / "out") / CHECKPOINT
    np.savez(checkpoint, meta=np.array('{"fingerprint": "x", "phase": 1, "step": 2}'))
    with pytest.raises(InputError, match=r"another version.*without --resume"):
        fit_job(job, tmp_path / "out", resume=True)
    assert checkpoint.is_file()

"""The folder of an unfinished fit: whose it is, what is forgotten, and what is never touched."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from facestage.contract.errors import InputError
from facestage.contract.files.partial import (
    CHECKPOINT,
    LOCK,
    MARKER,
    PERSON_CHECKPOINT,
    PREVIEW,
    forget_checkpoint,
    has_checkpoint,
    make_partial,
    mark_partial,
    partial_folder,
    remove_partial,
)
from facestage.contract.files.temporaries import PREFIX

WRITTEN = (CHECKPOINT, PERSON_CHECKPOINT, PREVIEW)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def fill(folder: Path, *added: str) -> None:
    for name in added:
        (folder / name).write_text(name)


@pytest.fixture
def partial(tmp_path: Path) -> Path:
    """A marked one, with all that a run keeps there and what a killed writer left."""
    made = make_partial(tmp_path / "face")
    mark_partial(made)
    fill(made, *WRITTEN, LOCK, f"{PREFIX}0-1.npz")
    return made


def test_it_lies_beside_the_output_and_may_be_made_twice(tmp_path: Path):
    out = tmp_path / "deep" / "face.v2"
    for _ in range(2):
        assert make_partial(out) == partial_folder(out) == tmp_path / "deep" / "face.v2.partial"
    assert names(tmp_path / "deep") == ["face.v2.partial"]


def test_only_a_marked_folder_may_hold_other_things(tmp_path: Path):
    made = make_partial(tmp_path / "face")
    fill(made, LOCK, f"{PREFIX}0-1")
    assert make_partial(tmp_path / "face") == made, "what another start left there is no obstacle"
    fill(made, "mine.txt")
    with pytest.raises(
        InputError, match=r"face\.partial' holds 'mine\.txt' and was not made by this version"
    ):
        make_partial(tmp_path / "face")
    mark_partial(made)
    assert make_partial(tmp_path / "face") == made
    assert names(made) == sorted([LOCK, MARKER, f"{PREFIX}0-1", "mine.txt"])


def test_a_file_of_that_name_is_named(tmp_path: Path):
    (tmp_path / "face.partial").write_text("mine")
    with pytest.raises(InputError, match=r"face\.partial', which is a file; move it"):
        make_partial(tmp_path / "face")
    assert (tmp_path / "face.partial").read_text() == "mine"


def test_the_mark_says_what_it_is_and_is_written_once(tmp_path: Path):
    made = make_partial(tmp_path / "face")
    mark_partial(made)
    assert json.loads((made / MARKER).read_text()) == {"facestage": "partial folder", "schema": 1}
    (made / MARKER).write_text("of another version")
    mark_partial(made)
    assert (made / MARKER).read_text() == "of another version"


@pytest.mark.parametrize("name", WRITTEN)
def test_a_run_goes_on_from_either_checkpoint_and_not_from_a_picture(tmp_path: Path, name: str):
    made = make_partial(tmp_path / "face")
    assert has_checkpoint(made) is False
    fill(made, name)
    assert has_checkpoint(made) is (name != PREVIEW)


def test_forgetting_takes_what_a_run_wrote_and_nothing_else(partial: Path):
    for _ in range(2):
        forget_checkpoint(partial)
        assert names(partial) == sorted([LOCK, MARKER, f"{PREFIX}0-1.npz"])


def test_it_is_removed_with_all_that_is_facestages(partial: Path):
    remove_partial(partial)
    assert not partial.exists()


def test_a_folder_that_was_never_locked_is_removed_too(partial: Path):
    (partial / LOCK).unlink()
    remove_partial(partial)
    assert not partial.exists()


def test_what_is_the_users_stays_and_the_folder_with_it(partial: Path):
    fill(partial, "mine.txt")
    remove_partial(partial)
    assert names(partial) == ["mine.txt"]


def test_the_lock_goes_last_so_that_nobody_comes_in_before(
    partial: Path, monkeypatch: pytest.MonkeyPatch
):
    gone: list[str] = []
    unlink = Path.unlink

    def seen(self: Path, missing_ok: bool = False) -> None:
        gone.append(self.name)
        unlink(self, missing_ok)

    monkeypatch.setattr(Path, "unlink", seen)
    remove_partial(partial)
    assert gone[-2:] == [MARKER, LOCK] and gone.count(LOCK) == 1


def test_an_unmarked_folder_is_not_touched(partial: Path):
    (partial / MARKER).unlink()
    before = names(partial)
    remove_partial(partial)
    assert names(partial) == before

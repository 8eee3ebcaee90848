"""Paths that no machine has are refused in a sentence, wherever one is given."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from facestage.contract.errors import InputError
from facestage.contract.files.paths import is_file, is_folder, user_path
from facestage.contract.job import Job

WRONG = {
    "~nosuchuser/a.png": "home of a user",
    "a\0b": "null character",
    "x" * 5000: "5000 characters long",
    "/tmp/" + "y" * 300: "longer name",
    "": "is empty",
}


@pytest.mark.parametrize("text", WRONG)
def test_a_path_that_no_machine_has_is_refused(text: str):
    with pytest.raises(InputError, match=rf"The photo .*{WRONG[text]}") as caught:
        user_path(text, "photo")
    assert str(caught.value).isprintable() and len(str(caught.value)) < 300
    if text:
        assert not is_file(Path(text)) and not is_folder(Path(text))


def test_home_is_expanded_and_what_is_missing_is_nobodys_concern(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("USERPROFILE", str(tmp_path))
    assert user_path("~/a/b", "photo") == tmp_path / "a" / "b"


@pytest.mark.parametrize("key", ["image", "truth", "model"])
@pytest.mark.parametrize("text", [text for text in WRONG if text])
def test_a_job_with_such_a_path_is_refused(tmp_path: Path, job: Job, key: str, text: str):
    import json

    job.save(tmp_path / "job")
    path = tmp_path / "job" / "job.json"
    value = f"npz:{text}" if key == "model" else text
    path.write_text(json.dumps(json.loads(path.read_text()) | {key: value}))
    if key == "image" and text.startswith("~"):
        # beside the job, as any other name
        assert Job.load(tmp_path / "job").image == tmp_path / "job" / text
        return
    with pytest.raises(InputError) as caught:
        Job.load(tmp_path / "job")
    assert str(caught.value).isprintable() and len(str(caught.value)) < 1000


@pytest.mark.skipif(sys.platform != "linux", reason="other systems take other lengths")
def test_a_path_as_long_as_linux_takes_is_nobodys_concern_and_one_longer_is():
    longest = "/".join([*["x" * 255] * 15, "x" * 255])
    assert len(longest) == 4095 and user_path(longest, "photo") == Path(longest)
    # Of 4096 the system takes none: it counts the null character at the end.
    for text, words in (
        (f"{longest[:-1]}/x", "has a longer name than this system takes"),
        (f"{longest[:-1]}/xx", "is 4097 characters long, a path has at most 4096"),
    ):
        with pytest.raises(InputError, match=words):
            user_path(text, "photo")


def test_what_lies_at_a_path_is_told_apart(tmp_path: Path):
    (tmp_path / "a").touch()
    asked = [
        (is_file(path), is_folder(path)) for path in (tmp_path / "a", tmp_path, tmp_path / "b")
    ]
    assert asked == [(True, False), (False, True), (False, False)]
    for path in (Path("a\0b"), tmp_path / "a" / "b", tmp_path / ("y" * 300)):
        assert is_file(path) is is_folder(path) is False

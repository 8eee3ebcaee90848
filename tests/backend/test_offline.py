"""Downloads that somebody forbade are not tried, and the sentence says who and what to do."""

from __future__ import annotations

from pathlib import Path
from typing import NoReturn

import pytest

from facestage import doctor
from facestage.contract.errors import InputError
from facestage.contract.face_model import FaceModel
from facestage.contract.online import is_offline, with_online_access
from facestage.landmarks import model_file
from facestage.models.cached import cached
from facestage.system import folders


@pytest.fixture(autouse=True)
def empty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine without the landmark model."""
    monkeypatch.setenv("FACESTAGE_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("FACESTAGE_DATA", str(tmp_path / "data"))
    monkeypatch.delenv(model_file.VARIABLE, raising=False)


@pytest.mark.parametrize(
    ("value", "offline"), [("1", True), ("yes", True), ("0", False), ("", False), (None, False)]
)
def test_the_variable(monkeypatch: pytest.MonkeyPatch, value: str | None, offline: bool) -> None:
    monkeypatch.delenv("FACESTAGE_OFFLINE", raising=False)
    if value is not None:
        monkeypatch.setenv("FACESTAGE_OFFLINE", value)
    assert is_offline() == offline


def test_nothing_is_asked_of_the_network(monkeypatch: pytest.MonkeyPatch) -> None:
    def forbidden(*_arguments: object, **_options: object) -> NoReturn:
        raise AssertionError("the network was used")

    monkeypatch.setattr("pooch.retrieve", forbidden)
    monkeypatch.setenv("FACESTAGE_OFFLINE", "1")
    with pytest.raises(InputError) as caught:
        model_file.open_model()
    sentence = str(caught.value)
    for word in (
        "FACESTAGE_OFFLINE",
        "Blender's Preferences",
        model_file.URL,
        "--landmarks",
        "--landmark-model",
    ):
        assert word in sentence
    assert "off ($FACESTAGE_OFFLINE)" in str(doctor.online_finding())
    assert "Downloads are off" in doctor.landmark_finding().remedy


def test_online_is_the_default_and_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("FACESTAGE_OFFLINE", raising=False)
    assert "landmark model alone" in doctor.online_finding().found
    assert with_online_access({"A": "b"}, allowed=True) == {"A": "b"}


@pytest.mark.parametrize("home", [None, "relative/home"])
def test_no_home_is_one_sentence_that_names_the_variable(
    monkeypatch: pytest.MonkeyPatch, home: str | None
) -> None:
    def nobody(*_arguments: object) -> Path:
        if home is None:
            raise RuntimeError("Could not determine home directory.")
        return Path(home)

    monkeypatch.setattr(Path, "home", nobody)
    monkeypatch.delenv("FACESTAGE_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", "relative/cache")
    with pytest.raises(InputError, match="set FACESTAGE_CACHE"):
        folders.cache_folder()
    assert not doctor.folder_finding("cache folder", folders.cache_folder).works
    assert model_file.VARIABLE in doctor.landmark_finding().remedy
    assert model_file.find_model() is None
    built: list[FaceModel] = []
    with pytest.raises(StopIteration):
        cached("any", "key", lambda: next(iter(built)))  # it is built, not refused


def test_a_model_named_by_an_unknown_home_is_one_sentence() -> None:
    with pytest.raises(InputError, match=r"nosuchuser.*write the whole path"):
        model_file.find_model(Path("~nosuchuser/face_landmarker.task"))

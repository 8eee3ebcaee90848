"""Where the model is looked for, in which order, and what is said when it is not there or is
another file.
"""

from __future__ import annotations

import hashlib
import io
import zipfile
from pathlib import Path
from typing import NoReturn

import pytest

from facestage import doctor
from facestage.contract.errors import InputError
from facestage.landmarks import model_file


@pytest.fixture(autouse=True)
def content(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> bytes:
    """The bytes that count as the model, with every place to look at in a folder of the test's own,
    and no network.
    """
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name in (model_file.DETECTOR, model_file.MESH, model_file.GEOMETRY):
            archive.writestr(name, f"content of {name}")
    monkeypatch.setenv("FACESTAGE_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("FACESTAGE_DATA", str(tmp_path / "data"))
    monkeypatch.delenv(model_file.VARIABLE, raising=False)
    monkeypatch.setattr(model_file, "SHA256", hashlib.sha256(stream.getvalue()).hexdigest())

    def offline(*_arguments: object, **_options: object) -> NoReturn:
        raise ConnectionError

    monkeypatch.setattr("pooch.retrieve", offline)
    return stream.getvalue()


def put(path: Path, data: bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path


def test_places_are_tried_in_order(tmp_path: Path, content: bytes, monkeypatch: pytest.MonkeyPatch):
    assert model_file.find_model() is None
    data = put(tmp_path / "data" / model_file.FILE_NAME, content)
    assert model_file.find_model() == data
    cached = put(model_file.cached_path(), content)
    assert model_file.find_model() == cached and tmp_path / "cache" in cached.parents
    named = put(tmp_path / "named.task", content)
    monkeypatch.setenv(model_file.VARIABLE, str(named))
    assert model_file.find_model() == named
    chosen = put(tmp_path / "chosen.task", content)
    assert model_file.find_model(chosen) == chosen


def test_the_members_are_read(tmp_path: Path, content: bytes):
    bundle = model_file.open_model(put(tmp_path / "m.task", content))
    assert bundle.mesh == f"content of {model_file.MESH}".encode()
    assert bundle.detector != bundle.geometry


@pytest.mark.parametrize(
    "damage", [lambda data: data[:-7], lambda data: data + b"x", lambda _: b""]
)
def test_another_file_is_refused(
    tmp_path: Path, content: bytes, monkeypatch: pytest.MonkeyPatch, damage
):
    wrong = put(tmp_path / "wrong.task", damage(content))
    for message in ("wrong.task", "not the expected file", "SHA-256", model_file.URL):
        with pytest.raises(InputError, match=message):
            model_file.open_model(wrong)
    monkeypatch.setenv(model_file.VARIABLE, str(wrong))
    with pytest.raises(InputError, match=model_file.VARIABLE):
        model_file.find_model()


def test_a_named_file_must_exist(tmp_path: Path):
    with pytest.raises(InputError, match=r"none\.task' does not exist"):
        model_file.open_model(tmp_path / "none.task")
    with pytest.raises(InputError, match="is a folder, expected a file"):
        model_file.open_model(tmp_path)


def test_damaged_copies_that_nobody_named_are_passed_over(tmp_path: Path, content: bytes):
    put(model_file.cached_path(), content[:-1])
    assert model_file.find_model() is None
    good = put(tmp_path / "data" / model_file.FILE_NAME, content)
    assert model_file.find_model() == good


def test_offline_says_what_to_fetch_and_where_to_put_it():
    with pytest.raises(InputError) as caught:
        model_file.open_model()
    for word in (
        model_file.URL,
        str(model_file.cached_path()),
        "--landmark-model",
        "--landmarks",
        "network",
    ):
        assert word in str(caught.value)
    assert not model_file.cached_path().exists()


def test_a_wrong_download_is_refused(monkeypatch: pytest.MonkeyPatch):
    def other(*_arguments: object, **_options: object) -> NoReturn:
        raise ValueError("SHA256 hash of downloaded file does not match")

    monkeypatch.setattr("pooch.retrieve", other)
    with pytest.raises(InputError, match="another file"):
        model_file.open_model()


def test_a_download_goes_to_the_cache(content: bytes, monkeypatch: pytest.MonkeyPatch):
    def retrieve(url: str, known_hash: str, fname: str, path: Path, downloader: object) -> str:
        assert url == model_file.URL and known_hash == f"sha256:{model_file.SHA256}" and downloader
        return str(put(Path(path) / fname, content))

    monkeypatch.setattr("pooch.retrieve", retrieve)
    assert model_file.open_model().path == model_file.cached_path()
    assert model_file.find_model() == model_file.cached_path()


def test_doctor_says_whether_it_is_there(
    content: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    finding = doctor.landmark_finding()
    assert (
        not finding.works and not finding.needed and str(model_file.cached_path()) in finding.remedy
    )
    path = put(model_file.cached_path(), content)
    assert doctor.landmark_finding().works and str(path) in doctor.landmark_finding().found
    monkeypatch.setenv(model_file.VARIABLE, str(tmp_path / "none.task"))
    assert "none.task" in doctor.landmark_finding().found

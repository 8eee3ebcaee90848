"""Model specifications, and the cache of converted models."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.face_model import FaceModel
from facestage.models import registry
from facestage.models.cached import KEPT
from facestage.models.registry import load_model
from facestage.system.folders import cache_folder
from reference.synthetic_face import synthetic_face


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache folder."""
    monkeypatch.setenv("FACESTAGE_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def built(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What is built instead of the default head and of ICT-FaceKit, and how often."""
    calls: list[str] = []

    def build(name: str) -> FaceModel:
        calls.append(name)
        return synthetic_face(12, 14)

    monkeypatch.setattr(registry, "_build_default", lambda: build("default"))
    monkeypatch.setattr(registry, "_load_ict", lambda path: build(f"ict {path.name}"))
    return calls


@pytest.mark.parametrize(
    "specification", ["", "flame", "smpl:x", "ict", "ict:", "npz:", "default:x", ":x", "DEFAULT"]
)
def test_unknown_specifications_are_named(specification: str):
    with pytest.raises(
        InputError, match=r"unknown; expected default, ict:PATH, flame:PATH, bfm:PATH"
    ) as caught:
        load_model(specification)
    assert f"'{specification}'" in str(caught.value)


@pytest.mark.parametrize("kind", ["ict", "flame", "bfm", "gnm", "rig"])
def test_a_path_that_is_not_there_is_named(tmp_path: Path, kind: str):
    with pytest.raises(InputError, match=r"none' does not exist"):
        load_model(f"{kind}:{tmp_path / 'none'}")


@pytest.mark.parametrize(
    "beside", ["landmark_embedding.npy", "head_sparse_68.txt", "FLAME_texture.npz"]
)
def test_a_file_beside_the_model_is_noticed(tmp_path: Path, built: list[str], beside: str):
    (tmp_path / "model.pkl").write_bytes(b"one")
    load_model(f"ict:{tmp_path / 'model.pkl'}")
    (tmp_path / "result.png").touch()
    load_model(f"ict:{tmp_path / 'model.pkl'}")
    assert len(built) == 1
    (tmp_path / beside).touch()
    load_model(f"ict:{tmp_path / 'model.pkl'}")
    assert len(built) == 2


def test_a_model_file(tmp_path: Path):
    model = synthetic_face(12, 14)
    model.save(tmp_path / "face.npz")
    np.testing.assert_array_equal(
        load_model(f"npz:{tmp_path / 'face.npz'}").vertices, model.vertices
    )
    with pytest.raises(InputError, match=r"none\.npz' does not exist"):
        load_model(f"npz:{tmp_path / 'none.npz'}")


def test_the_cache_follows_the_environment(cache: Path):
    assert cache_folder() == cache


def test_a_model_is_built_once(cache: Path, built: list[str]):
    first, second = load_model("default"), load_model("default")
    assert built == ["default"]
    np.testing.assert_array_equal(first.vertices, second.vertices)
    assert [path.suffix for path in (cache / "models").iterdir()] == [".npz"]


def test_a_damaged_cache_is_built_again(cache: Path, built: list[str]):
    load_model("default")
    file = next((cache / "models").iterdir())
    file.write_bytes(file.read_bytes()[:1000])
    load_model("default")
    assert built == ["default"] * 2
    load_model("default")
    assert built == ["default"] * 2


def test_a_changed_source_is_converted_again(tmp_path: Path, built: list[str]):
    source = tmp_path / "ict.zip"
    source.write_bytes(b"one")
    load_model(f"ict:{source}")
    load_model(f"ict:{source}")
    assert built == ["ict ict.zip"]
    source.write_bytes(b"other content")
    load_model(f"ict:{source}")
    assert built == ["ict ict.zip"] * 2


def test_of_many_models_those_used_last_stay(cache: Path, tmp_path: Path, built: list[str]):
    source = tmp_path / "ict.zip"
    load_model("default")
    default = next((cache / "models").iterdir())
    own = cache / "models" / "notes.txt"
    own.touch()
    for number in range(KEPT + 1):
        # Used long ago, the first made longest ago.
        for age, path in enumerate(sorted((cache / "models").iterdir(), key=_time)):
            os.utime(path, ns=(age, age))
        load_model("default")  # used again
        source.write_bytes(bytes(number))
        load_model(f"ict:{source}")
    left = set((cache / "models").iterdir())
    assert built == ["default"] + ["ict ict.zip"] * (KEPT + 1)
    assert len(left) == KEPT + 1 and {default, own} < left
    load_model(f"ict:{source}")
    assert len(built) == KEPT + 2, "the last is among them"


def _time(path: Path) -> int:
    return path.stat().st_mtime_ns


def test_an_unwritable_cache_costs_only_time(
    tmp_path: Path,
    built: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    (tmp_path / "file").touch()
    monkeypatch.setenv("FACESTAGE_CACHE", str(tmp_path / "file"))
    assert load_model("default").name == "synthetic"
    assert "not cached" in capsys.readouterr().err
    assert built == ["default"]

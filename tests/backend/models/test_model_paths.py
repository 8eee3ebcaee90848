"""Face models named by paths that cannot be, or by files whose numbers are no face's: one sentence
each.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.files.reading import MIB
from facestage.landmarks import model_file
from facestage.models import registry
from facestage.models.files.published_file import MODEL_LIMIT, PICKLE_LIMIT
from facestage.models.files.restricted_pickle import read_pickle
from facestage.models.registry import load_model
from reference.published.flame import embedding, flame_arrays, write_embedding, write_flame
from reference.published.loaded import load_flame, load_gnm
from reference.synthetic_face import synthetic_face

KINDS = ("ict", "flame", "bfm", "gnm", "rig", "npz")


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache folder."""
    monkeypatch.setenv("FACESTAGE_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def refusal(specification: str) -> str:
    with pytest.raises(InputError) as caught:
        load_model(specification)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("kind", KINDS)
def test_pipes_and_devices_are_refused_unread(tmp_path: Path, kind: str):
    for name in ("a.pkl", "a.npz", "a.h5", "a.mat"):
        os.mkfifo(tmp_path / name)
        assert "is a pipe or a device" in refusal(f"{kind}:{tmp_path / name}")
    assert "is a pipe or a device" in refusal(f"{kind}:/dev/zero")


@pytest.mark.parametrize("kind", KINDS)
def test_paths_that_cannot_be_are_refused(kind: str):
    assert "nosuchuser" in refusal(f"{kind}:~nosuchuser/model")
    assert len(refusal(f"{kind}:{'x' * 5000}")) < 5500
    assert len(refusal(f"{kind}:{'x' * 300}")) < 1000
    refusal(f"{kind}:a\0b")
    refusal(f"{kind}:{'x/' * 3000}")


@pytest.mark.parametrize(
    ("kind", "name"), [("bfm", "a.h5"), ("bfm", "a.mat"), ("gnm", "a.npz"), ("flame", "a.pkl")]
)
def test_files_larger_than_any_model_are_refused_unread(tmp_path: Path, kind: str, name: str):
    with (tmp_path / name).open("wb") as stream:
        stream.truncate(MODEL_LIMIT + 1)
    assert "expected at most" in refusal(f"{kind}:{tmp_path / name}")


def test_a_pickle_larger_than_any_is_refused_unread(tmp_path: Path):
    with (tmp_path / "a.pkl").open("wb") as stream:
        stream.truncate(PICKLE_LIMIT + 1)
    with pytest.raises(InputError, match=r"expected at most 256 MiB"):
        read_pickle(tmp_path / "a.pkl", "model")


def test_numbers_that_are_no_face_are_a_sentence(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    def load(path: Path) -> None:
        np.linalg.inv(np.zeros((2, 2)))

    monkeypatch.setattr(registry, "_load_bfm", load)
    assert "is damaged, its numbers are no face's (Singular matrix)" in refusal(f"bfm:{tmp_path}")


@pytest.fixture(scope="module")
def flame() -> dict[str, object]:
    return flame_arrays()


@pytest.mark.parametrize(
    ("name", "scale", "words"),
    [
        ("v_template", 1e30, "v_template holds numbers beyond 1e"),
        ("v_template", 0.0, "its face is 0 mm high"),
        ("v_template", 1e3, "mm high"),
        ("shapedirs", 1e200, "shapedirs holds numbers beyond"),
        ("posedirs", np.nan, "posedirs holds NaN"),
    ],
)
def test_absurd_flame_arrays_are_a_sentence(
    tmp_path: Path, flame: dict[str, object], name: str, scale: float, words: str
):
    write_flame(tmp_path / "generic_model.pkl", flame | {name: np.asarray(flame[name]) * scale})
    assert words in refusal(f"flame:{tmp_path}")


@pytest.mark.parametrize(
    "change",
    [
        {"full_lmk_bary_coords": np.full((1, 68, 3), 1e30)},
        {"full_lmk_bary_coords": np.zeros((1, 67, 3))},
        {"full_lmk_bary_coords": np.zeros(5)},
        {"full_lmk_bary_coords": [[1.0, 0.0, 0.0]] * 68},
        {"full_lmk_faces_idx": np.zeros((0,), np.int64)},
        {"full_lmk_faces_idx": np.array(["a"] * 3)},
        {"full_lmk_bary_coords": np.full((1, 68, 3), np.nan)},
    ],
)
def test_damaged_landmarks_beside_flame_are_a_sentence(
    tmp_path: Path, flame: dict[str, object], change: dict[str, object]
):
    write_flame(tmp_path / "generic_model.pkl", flame)
    write_embedding(tmp_path / "landmark_embedding.npy", embedding() | change)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"landmark_embedding\.npy'") as caught:
        load_flame(tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "change", [{"vt": np.full((10, 2), np.nan)}, {"ft": np.full((9976, 3), 0.5)}]
)
def test_damaged_textures_beside_flame_are_a_sentence(
    tmp_path: Path, flame: dict[str, object], change: dict[str, np.ndarray]
):
    write_flame(tmp_path / "generic_model.pkl", flame)
    write_embedding(tmp_path / "landmark_embedding.npy", embedding())
    texture: dict[str, np.ndarray] = {"vt": np.zeros((5, 2)), "ft": np.zeros((9976, 3), np.int32)}
    np.savez(tmp_path / "FLAME_texture.npz", **(texture | change))
    with pytest.raises(InputError, match=r"FLAME_texture\.npz' has no UV layout"):
        load_flame(tmp_path)


@pytest.mark.parametrize(
    "name", ["joint_names", "quads", "template_vertex_positions", "identity_names", "version"]
)
def test_gnm_arrays_of_other_dimensions_are_a_sentence(tmp_path: Path, name: str):
    entries = {
        key: np.zeros((1, 1, 1))
        for key in (
            "template_vertex_positions",
            "template_joint_positions",
            "vertex_identity_basis",
            "expression_basis",
            "joint_parent_indices",
            "skinning_weights",
            "quads",
            "quad_uvs",
            "pose_correctives_regressor",
            "vertex_groups",
        )
    }
    entries |= {
        key: np.array(["a"]) for key in ("identity_names", "joint_names", "expression_names")
    }
    entries |= {
        "vertex_group_names": np.array(["a"]),
        "version": np.array("3.0"),
        "variant": np.array("head"),
    }
    entries["joint_parent_indices"] = np.zeros(1, int)
    np.savez(tmp_path / "gnm_head.npz", **(entries | {name: np.array(1.0)}))
    with pytest.raises(InputError, match=r"gnm_head\.npz' is") as caught:
        load_gnm(tmp_path)
    assert "\n" not in str(caught.value)


def test_a_cache_that_cannot_be_entered_costs_only_time(
    cache: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(registry, "_build_default", lambda: synthetic_face(12, 14))
    (cache / "models").mkdir(parents=True)
    key = hashlib.sha256(registry._source_fingerprint().encode()).hexdigest()[:16]
    # A folder where the file should be can neither be read nor replaced.
    (cache / "models" / f"default-{key}.npz" / "x").mkdir(parents=True)
    assert load_model("default").name == "synthetic"
    assert "not cached" in capsys.readouterr().err
    monkeypatch.setenv("FACESTAGE_CACHE", "x" * 5000)
    assert load_model("default").name == "synthetic"


def test_only_the_very_landmark_model_is_read(
    tmp_path: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("FACESTAGE_DATA", str(tmp_path / "data"))
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", Path("/dev/zero")):
        with pytest.raises(InputError, match="is a pipe or a device"):
            model_file.open_model(path)
    with (tmp_path / "large").open("wb") as stream:
        stream.truncate(17 * MIB)
    with pytest.raises(InputError, match="expected at most 16 MiB"):
        model_file.open_model(tmp_path / "large")
    with pytest.raises(InputError, match="nosuchuser"):
        model_file.open_model(Path("~nosuchuser/model"))
    # What lies in the cache and is not the model is passed over.
    model_file.cached_path().parent.mkdir(parents=True)
    os.mkfifo(model_file.cached_path())
    assert model_file.find_model() is None

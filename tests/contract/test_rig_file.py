"""The file of a user's own mesh: round trip, marked places, and messages."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.files.storage import read_arrays, write_arrays
from facestage.contract.rig_file import MARKS, RigFile
from reference.synthetic_face import synthetic_face
from reference.tampering import ARRAY_CHANGES, GONE


@pytest.fixture(scope="module")
def rig() -> RigFile:
    model = synthetic_face(12, 14)
    return RigFile(
        name="Alice",
        license="yours",
        vertices=model.vertices.astype(float),
        polygons=model.polygons,
        polygon_uvs=model.polygon_uvs,
        polygon_part=model.polygon_part,
        uvs=model.uvs,
        expression_names=model.expression_names,
        expression_offsets=model.expression_basis,
        identity_names=model.identity_names,
        identity_offsets=model.identity_basis,
        scale=(0.01, 0.01, 0.02),
        borrow_identity=False,
        marks={"chin": np.array([3, 5], np.int32)},
    )


def test_round_trip_keeps_everything(tmp_path: Path, rig: RigFile):
    rig.save(tmp_path / "a.npz")
    loaded = RigFile.load(tmp_path / "a.npz")
    for item in fields(rig):
        first, second = getattr(rig, item.name), getattr(loaded, item.name)
        if isinstance(first, np.ndarray):
            np.testing.assert_array_equal(first, second)
        elif isinstance(first, dict):
            np.testing.assert_array_equal(first["chin"], second["chin"])
        else:
            assert first == second, item.name


def test_a_mark_is_the_middle_of_its_vertices(rig: RigFile):
    assert list(rig.known_points()) == [MARKS["chin"][1]]
    np.testing.assert_allclose(rig.known_points()[8], (rig.vertices[3] + rig.vertices[5]) / 2)


def test_marks_are_distinct_landmarks():
    indices = [index for _, index in MARKS.values()]
    assert len(set(indices)) == len(indices)
    assert all(0 <= index < 68 for index in indices)


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("vertices", lambda a: a * np.nan, "vertices holds NaN"),
        ("vertices", lambda a: a[:50], "has shape"),
        ("polygons", lambda a: a + 10**6, "polygons refers to a point outside"),
        ("polygon_uvs", lambda a: a[:-1], "polygon_uvs has shape"),
        ("polygon_part", lambda a: a + 100, "polygon_part holds values"),
        ("expression_offsets", lambda a: a[:, :-1], "expression_offsets has shape"),
        ("expression_names", lambda a: (a[0],) * len(a), "same name"),
        ("scale", lambda _: (1.0, 0.0, 1.0), "scale"),
        ("marks", lambda _: {"elbow": np.array([0])}, "'elbow' is unknown"),
        ("marks", lambda _: {"chin": np.array([10**6])}, "'chin' refers to a vertex outside"),
    ],
)
def test_what_is_wrong_is_named(rig: RigFile, name: str, change, words: str):
    with pytest.raises(InputError, match=words) as caught:
        replace(rig, **{name: change(getattr(rig, name))})
    assert "Alice" in str(caught.value)


@pytest.mark.parametrize(
    "meta", ["not JSON", json.dumps([1]), json.dumps({"schema": 9}), json.dumps({"schema": 1})]
)
def test_a_damaged_file_is_refused(tmp_path: Path, rig: RigFile, meta: str):
    path = tmp_path / "a.npz"
    rig.save(path)
    write_arrays(path, read_arrays(path, "mesh") | {"meta": np.array(meta)})
    with pytest.raises(InputError, match=r"a\.npz.*Use My Mesh"):
        RigFile.load(path)


def test_another_file_is_refused(tmp_path: Path):
    np.savez(tmp_path / "x.npz", a=np.zeros(3))
    with pytest.raises(InputError, match="lacks vertices"):
        RigFile.load(tmp_path / "x.npz")


# To the places of points, and to materials that are not known yet.
HARMLESS = {
    ("vertices", "zero"),
    ("vertices", "negative"),
    ("uvs", "zero"),
    ("expression_offsets", "zero"),
    ("expression_offsets", "negative"),
    ("uvs", "one row more"),
}


@pytest.mark.parametrize(
    "name", ["vertices", "polygons", "polygon_uvs", "polygon_part", "uvs", "expression_offsets"]
)
@pytest.mark.parametrize("change", ARRAY_CHANGES)
def test_every_array_is_checked(tmp_path: Path, rig: RigFile, name: str, change: str):
    path = tmp_path / "a.npz"
    rig.save(path)
    arrays = read_arrays(path, "mesh")
    changed = ARRAY_CHANGES[change](arrays.pop(name))
    np.savez(path, **(arrays if changed is GONE else arrays | {name: changed}))
    if (name, change) in HARMLESS:
        RigFile.load(path)
        return
    with pytest.raises(InputError) as caught:
        RigFile.load(path)
    assert str(caught.value).isprintable() and len(str(caught.value)) < 500

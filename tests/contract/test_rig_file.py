"""The file of a user's own mesh: round trip, marked places, and messages."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.files.storage import read_arrays, write_arrays
from facestage.contract.rig_file import MARKS, RigFile
from reference.contract_files import full_rig
from reference.synthetic_face import synthetic_face
from reference.tampering import ARRAY_CHANGES, GONE


@pytest.fixture(scope="module")
def rig() -> RigFile:
    return full_rig(synthetic_face(12, 14), scale=(0.01, 0.01, 0.02))


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


def test_marks_stand_at_the_places_of_the_published_scheme():
    """ibug68: 0-16 jaw, 27-35 nose, 36-47 eyes, 48-67 lips, from the picture's left."""
    assert {name: index for name, (_, index) in MARKS.items()} == {
        "chin": 8,
        "nose_bridge": 27,
        "nose_tip": 30,
        "nose_base": 33,
        "eye_right_outer": 36,
        "eye_right_inner": 39,
        "eye_left_inner": 42,
        "eye_left_outer": 45,
        "mouth_right": 48,
        "lip_upper": 51,
        "mouth_left": 54,
        "lip_lower": 57,
    }


def small(rig: RigFile, vertices: int, polygons: int) -> RigFile:
    """With the first of its vertices, and of the polygons among them, again and again."""
    within = (rig.polygons < vertices).all(axis=1)
    rows = np.resize(np.flatnonzero(within), polygons)
    return replace(
        rig,
        vertices=rig.vertices[:vertices],
        polygons=rig.polygons[rows],
        polygon_uvs=rig.polygon_uvs[rows],
        polygon_part=rig.polygon_part[rows],
        expression_offsets=rig.expression_offsets[:, :vertices],
        identity_offsets=rig.identity_offsets[:, :vertices],
    )


def test_a_face_has_a_hundred_vertices_and_polygons(tmp_path: Path, rig: RigFile):
    small(rig, 100, 100).save(tmp_path / "a.npz")
    assert len(RigFile.load(tmp_path / "a.npz").vertices) == 100
    for vertices, polygons in ((99, 100), (100, 99)):
        with pytest.raises(
            InputError, match=f"has {vertices} vertices and {polygons} polygons; .* 100 of each"
        ):
            small(rig, vertices, polygons)


def corner(array: np.ndarray, row: int, column: int, value: int) -> Any:
    """The array with one other entry."""
    changed = array.copy()
    changed[row, column] = value
    return changed


@pytest.mark.parametrize("name", ["polygons", "polygon_uvs"])
def test_a_corner_is_a_point_of_the_mesh_and_only_the_fourth_may_be_none(rig: RigFile, name: str):
    array, count = getattr(rig, name), len(rig.vertices)
    for column, value, right in (
        (0, count - 1, True),
        (0, count, False),
        (2, 0, True),
        (2, -1, False),
        (3, -1, True),
        (3, -2, False),
    ):
        changed = {name: corner(array, 5, column, value)}
        if right:
            replace(rig, **changed)
            continue
        with pytest.raises(InputError, match=f"{name} refers to a point outside 0..{count - 1};"):
            replace(rig, **changed)


def test_parts_are_those_of_faces_or_unknown(rig: RigFile):
    for value in (0, 4, 255):
        replace(rig, polygon_part=np.full(len(rig.polygons), value, np.uint8))
    for value in (5, 254, -1):
        with pytest.raises(InputError, match=r"values other than 0\.\.4 and 255"):
            replace(rig, polygon_part=np.full(len(rig.polygons), value))


def test_shapes_have_names_of_their_own(rig: RigFile):
    # An expression and an identity shape may share one.
    replace(rig, identity_names=(rig.expression_names[0], *rig.identity_names[1:]))
    for names in ((*rig.identity_names[:3], ""), (*rig.identity_names[:3], rig.identity_names[0])):
        with pytest.raises(
            InputError, match="two of its shapes have the same name, or one has none"
        ):
            replace(rig, identity_names=names)


@pytest.mark.parametrize(
    ("scale", "right"),
    [
        ((1.0, 1.0, 1.0), True),
        ((-1.0, 2e-12, 1e9), True),
        ((1.0, 1.0, 1e-13), False),
        ((1.0, float("inf"), 1.0), False),
        ((1.0, 1.0), False),
    ],
)
def test_a_scale_is_three_numbers_that_are_not_zero(rig: RigFile, scale: tuple, right: bool):
    if right:
        assert replace(rig, scale=scale).scale == scale
        return
    with pytest.raises(InputError, match="expected three numbers that are not 0"):
        replace(rig, scale=scale)


def test_a_mesh_is_in_metres_and_borrows_shapes_unless_it_says_otherwise(rig: RigFile):
    given = {item.name: getattr(rig, item.name) for item in fields(rig)}
    for name in ("scale", "borrow_identity", "marks"):
        del given[name]
    plain = RigFile(**given)
    assert plain.scale == (1.0, 1.0, 1.0) and plain.borrow_identity is True and plain.marks == {}


def test_a_mark_lies_on_vertices_of_the_mesh(rig: RigFile):
    count = len(rig.vertices)
    replace(rig, marks={"chin": np.array([0, count - 1])})
    for indices in ([], [-1, 0], [count]):
        with pytest.raises(InputError, match=f"'chin' refers to a vertex outside 0..{count - 1}"):
            replace(rig, marks={"chin": np.array(indices, int)})


@pytest.mark.parametrize(
    ("name", "right", "wrong"),
    [
        ("vertices", [-1e9, 1e9], [-1.1e9, 1.1e9]),
        ("uvs", [-1.0, 2.0], [-1.01, 2.01]),
        ("expression_offsets", [-1e9, 1e9], [-1.1e9, 1.1e9]),
        ("identity_offsets", [-1e9, 1e9], [-1.1e9, 1.1e9]),
    ],
)
def test_limits_of_places(
    tmp_path: Path, rig: RigFile, name: str, right: list[float], wrong: list[float]
):
    for value in (*right, *wrong):
        array = getattr(rig, name).copy()
        array.flat[7] = value
        replace(rig, **{name: array}).save(tmp_path / "a.npz")
        if value in right:
            RigFile.load(tmp_path / "a.npz")
            continue
        with pytest.raises(InputError, match=f"{name} holds "):
            RigFile.load(tmp_path / "a.npz")

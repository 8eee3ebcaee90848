"""The file about a person comes back as it was."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.person import Person, PersonPhoto


@pytest.fixture
def person() -> Person:
    photos = (
        PersonPhoto(
            1, "/photos/a.png", "1-a", "converged", "Converged: fine.", True, {"psnr": 39.5}
        ),
        PersonPhoto(2, "/photos/b.png", "2-b", "stopped", "Not fine; do this.", False, {}),
    )
    return Person(
        "stopped",
        "Photo 2 (b.png): Not fine; do this.",
        "default",
        photos,
        np.array([0.5, -1.25]),
        np.array([0.125]),
        np.full((2, 2), 0.75),
        0.4,
        {"optimisation": 12.5},
    )


def test_round_trip(person: Person, tmp_path: Path):
    person.write_into(tmp_path)
    loaded = Person.load(tmp_path)
    assert loaded.folder == tmp_path and loaded.photos == person.photos
    for name in ("identity", "albedo", "specular"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(person, name))
    for name in ("status", "advice", "model", "roughness", "timings"):
        assert getattr(loaded, name) == getattr(person, name)


def test_no_file_is_said(tmp_path: Path):
    with pytest.raises(InputError, match="person file"):
        Person.load(tmp_path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"schema": 2}, "schema 2, expected 1"),
        ({"schema": None}, "schema null, expected 1"),
        ({"status": "fine"}, "status is 'fine', expected one of converged"),
        ({"photos": []}, "photos has 0 entries"),
        ({"photos": [5]}, r"photos\[0\] is 5, expected a photo"),
        ({"photos": [{"number": 1}]}, r"lacks photos\[0\]\.image"),
        ({"identity": "wide"}, "identity is 'wide'"),
        ({"identity": [1, None]}, r"identity\[1\] is null"),
        ({"identity": [1e300]}, "identity holds 1e\\+300"),
        ({"specular": [[1, 2], [3]]}, "specular has rows of 1 and of 2"),
        ({"specular": [[1, 2]]}, r"specular has shape \(1, 2\)"),
        ({"specular": []}, "specular has shape"),
        ({"roughness": -1}, "roughness is -1"),
        ({"timings": {"a": "long"}}, "timings.a is 'long'"),
    ],
)
def test_what_is_wrong_is_named(person: Person, tmp_path: Path, change: dict, words: str):
    person.write_into(tmp_path)
    path = tmp_path / "person.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(
        InputError, match=rf"The person file '.*person\.json'.*{words}.*; fit the photos again"
    ):
        Person.load(tmp_path)


@pytest.mark.parametrize(
    ("change", "right", "wrong"),
    [
        ("roughness", [0, 1], [-0.01, 1.01]),
        ("specular", [[[0]], [[100]]], [[[-0.01]], [[100.1]]]),
        ("identity", [[], [1e6], [-1e6]], [[1.1e6], [-1.1e6]]),
        ("albedo", [[], [1e6], [-1e6]], [[1.1e6], [-1.1e6]]),
        ("photos", [1, 8], [0, 9]),
    ],
)
def test_limits(person: Person, tmp_path: Path, change: str, right: list, wrong: list):
    """Of what a fit can reach, and of how many photos are fitted together."""
    person.write_into(tmp_path)
    path = tmp_path / "person.json"
    data = json.loads(path.read_text())
    for values, refused in ((right, False), (wrong, True)):
        for value in values:
            given = data["photos"][:1] * value if change == "photos" else value
            path.write_text(json.dumps(data | {change: given}))
            if not refused:
                Person.load(tmp_path)
                continue
            with pytest.raises(InputError, match=f"person.json': {change} (has|holds|is) "):
                Person.load(tmp_path)


def test_photos_are_numbered_from_1_to_8(person: Person, tmp_path: Path):
    person.write_into(tmp_path)
    path = tmp_path / "person.json"
    data = json.loads(path.read_text())
    for number in (1, 8, 0, 9):
        data["photos"][0]["number"] = number
        path.write_text(json.dumps(data))
        if 1 <= number <= 8:
            assert Person.load(tmp_path).photos[0].number == number
            continue
        with pytest.raises(
            InputError, match=rf"photos\[0\]\.number is {number}, expected .* 1 to 8"
        ):
            Person.load(tmp_path)

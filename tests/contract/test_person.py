"""The file about a person comes back as it was."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.person import Person, PersonPhoto


@pytest.fixture
def person() -> Person:
    photos = (
        PersonPhoto(1, "/photos/a.png", "1-a", "converged", "Converged: fine.", True, {"psnr": 39.5}),
        PersonPhoto(2, "/photos/b.png", "2-b", "stopped", "Not fine; do this.", False, {}),
    )
    return Person(
        "stopped", "Photo 2 (b.png): Not fine; do this.", "default", photos, np.array([0.5, -1.25]),
        np.array([0.125]), np.full((2, 2), 0.75), 0.4, {"optimisation": 12.5},
    )  # fmt: skip


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

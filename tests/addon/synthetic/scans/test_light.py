"""Surroundings by name, by file, and turned."""

from __future__ import annotations

from pathlib import Path

import pytest

from facestage.contract.errors import InputError


def test_blenders_own_surroundings_are_known() -> None:
    from facestage_blender.synthetic.scans.light import read_surroundings, shipped

    assert {"interior", "courtyard", "sunset"} <= set(shipped())
    found = read_surroundings("sunset@-20.5")
    assert (found.name, found.turn, found.file) == ("sunset", -20.5, shipped()["sunset"])
    assert read_surroundings("night").turn == 0.0


def test_a_file_is_taken_by_its_name() -> None:
    from facestage_blender.synthetic.scans.light import read_surroundings

    found = read_surroundings("/some/where@home/my.hdr@90")
    assert (found.file, found.name, found.turn) == (Path("/some/where@home/my.hdr"), "my", 90.0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("moon", "no light 'moon'; expected one of city, "),
        ("photo.jpg", "no light 'photo.jpg'"),
        ("interior@left", "turned by 'left'"),
        ("interior@nan", "turned by 'nan'"),
    ],
)
def test_what_lights_nothing_is_refused(text: str, words: str) -> None:
    from facestage_blender.synthetic.scans.light import read_surroundings

    with pytest.raises(InputError, match=words):
        read_surroundings(text)


def test_a_picture_that_is_none_is_refused(scene, tmp_path: Path) -> None:
    from facestage_blender.synthetic.scans.light import light_world, read_surroundings

    (tmp_path / "my.exr").write_bytes(b"no picture")
    with pytest.raises(InputError, match=r"my\.exr"):
        light_world(scene, read_surroundings(str(tmp_path / "my.exr")))

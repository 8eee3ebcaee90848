"""Tables of photos, folders and patterns: every row gets a name of its own, or a sentence."""

from __future__ import annotations

from pathlib import Path

import pytest

from facestage.batch.manifest import find_photos, read_manifest
from facestage.contract.errors import InputError

COLUMNS = ("camera", "focal_px")


def manifest(folder: Path, text: str) -> Path:
    path = folder / "photos.csv"
    path.write_bytes(text.encode())
    return path


def test_rows_have_photos_names_and_the_cells_that_are_not_empty(tmp_path: Path):
    text = (
        "\ufeffname,photo,camera,focal_px\r\n"
        "me,left.png; right.png,a.json;b.json,\r\n"
        "\r\n"
        ',"x, y.png",,300\r\n'
        ",sub/me.png,,\r\n"
        ",ME.jpg\r\n"
    )
    rows = read_manifest(manifest(tmp_path, text), COLUMNS)
    assert [row.name for row in rows] == ["me", "x__y", "me-2", "ME-3"]
    assert [row.line for row in rows] == [2, 4, 5, 6]
    assert rows[0].photos == ("left.png", "right.png")
    assert rows[0].values == {"camera": ("a.json", "b.json")}
    assert rows[1].photos == ("x, y.png",) and rows[1].values == {"focal_px": ("300",)}
    assert rows[2].values == rows[3].values == {}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        ("photo\n", "has no rows"),
        (
            "photo,lens\na.png,1\n",
            "has a column 'lens'; expected photo, film, name, camera, focal_px",
        ),
        ("photo;camera\na.png;b\n", "has a column 'photo;camera'"),
        ("camera\na.json\n", "has no column 'photo', and none 'film'"),
        ("photo,film\na.png,b.mp4\n", "Line 2 of .* names both a photo and a film"),
        ("photo,film,name\n,,x\n", "Line 2 of .* names no photo and no film"),
        ("film\na.mp4;b.mp4\n", "Line 2 of .* names 2 films"),
        ("photo\na.MP4\n", "Line 2 of .* names the video 'a.MP4' as a photo"),
        ("photo,photo\na,b\n", "the column 'photo' twice"),
        ("photo,camera\na.png,b.json\n,c.json\n", "Line 3 of .* names no photo"),
        ("photo\na.png;;b.png\n", "Line 2 of .* names no photo"),
        ("photo\na.png,b.png\n", "Line 2 of .* has 2 cells for 1 columns"),
        ("photo,name\na.png,../b\n", r"Line 2 of .* has the name '\.\./b'; expected letters"),
        ("photo,name\na.png,..\n", "has the name"),
        ("photo,name\na.png,x\nb.png,X\n", "the name 'x' more than once"),
        ('photo\n"a.png\n', "no table of comma-separated values"),
    ],
)
def test_a_bad_manifest_gets_one_sentence(tmp_path: Path, text: str, words: str):
    with pytest.raises(InputError, match=words):
        read_manifest(manifest(tmp_path, text), COLUMNS)


def test_photos_folders_and_patterns(tmp_path: Path):
    folder = tmp_path / "some"
    (folder / "deep").mkdir(parents=True)
    for name in ("b.jpg", "a.PNG", "notes.txt", "deep/c.png", "deep/a.png"):
        (folder / name).touch()
    rows = find_photos([folder, tmp_path / "gone.png", folder / "**" / "[ac].png"])
    assert [Path(row.photos[0]).name for row in rows] == [
        "a.PNG",
        "b.jpg",
        "gone.png",
        "a.png",
        "c.png",
    ]
    assert [row.name for row in rows] == ["a", "b", "gone", "a-2", "c"]
    with pytest.raises(InputError, match="No file fits"):
        find_photos([tmp_path / "*.png"])
    with pytest.raises(InputError, match="holds no photos"):
        find_photos([tmp_path])


def test_films_are_videos_and_what_the_column_says(tmp_path: Path):
    rows = read_manifest(manifest(tmp_path, "photo,film\na.png,\n,take\n,take.mov\n"), COLUMNS)
    assert [(row.photos, row.film) for row in rows] == [
        (("a.png",), False),
        (("take",), True),
        (("take.mov",), True),
    ]
    assert [row.name for row in rows] == ["a", "take", "take-2"]
    # A folder that is named holds photos; its videos are named themselves, or fit a pattern.
    for name in ("a.png", "b.mp4"):
        (tmp_path / name).touch()
    assert [row.film for row in find_photos([tmp_path])] == [False]
    assert [row.film for row in find_photos([tmp_path / "?.*"])] == [False, True]

"""Which photos and films a batch is about: a table (.csv), or files, folders and patterns."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from facestage.contract.batch import ROWS_MAX
from facestage.contract.errors import InputError
from facestage.contract.files.paths import is_folder
from facestage.contract.files.reading import MIB, read_bytes
from facestage.contract.job import PHOTO_SUFFIXES
from facestage.contract.sequence import VIDEO_SUFFIXES
from facestage.contract.wording import quoted

PHOTO, FILM, NAME = "photo", "film", "name"
SEPARATOR = ";"  # of several photos of one person, and of their cameras, ...
MANIFEST_MAX = 64 * MIB
NAME_LENGTH_MAX = 100
_PATTERN = re.compile(r"[*?\[]")


@dataclass(frozen=True)
class ManifestRow:
    """A row: its line in the file, its photos or film, and what it says beside them, by column."""

    line: int
    name: str
    photos: tuple[str, ...]  # of a film: its video or folder
    values: dict[str, tuple[str, ...]]  # only of cells that are not empty
    film: bool = False


def read_manifest(path: Path, columns: Collection[str]) -> list[ManifestRow]:
    """The rows of a table whose first line names its columns: PHOTO or FILM or both, perhaps NAME,
    and any of ``columns``. Raises InputError.
    """
    try:
        text = read_bytes(path, "manifest", MANIFEST_MAX).decode("utf-8-sig")
        # A cell in quotes may hold line breaks: each row with the line that it ends on.
        reader = csv.reader(text.splitlines(keepends=True), strict=True)
        table = [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(
            f"The manifest '{path}' is no table of comma-separated values in UTF-8 ({error})."
        ) from error
    rows = [(line, row) for line, row in table if any(row)]
    if not rows:
        raise InputError(f"The manifest '{path}' is empty; its first line names the columns.")
    (_, head), *body = rows
    _check_head(path, head, columns)
    if not body:
        raise InputError(f"The manifest '{path}' has no rows below its first line.")
    if len(body) > ROWS_MAX:
        raise InputError(f"The manifest '{path}' has {len(body)} rows, expected {ROWS_MAX}.")
    return _named([_row(path, line, head, cells) for line, cells in body], path)


def find_photos(given: Sequence[Path]) -> list[ManifestRow]:
    """A row for each photo or video that is named or fits a pattern, and each photo that lies in a
    folder that is named, in that order. Raises InputError where there are none.
    """
    found = [photo for path in given for photo in _photos_of(path)]
    return _named(
        [
            ManifestRow(place, "", (str(photo),), {}, _is_video(photo))
            for place, photo in enumerate(found, 1)
        ]
    )


def _is_video(path: Path) -> bool:
    return path.suffix.lower() in VIDEO_SUFFIXES


def _photos_of(path: Path) -> list[Path]:
    if is_folder(path):
        inside = sorted(one for one in path.iterdir() if one.suffix.lower() in PHOTO_SUFFIXES)
        if not inside:
            raise InputError(
                f"The folder '{path}' holds no photos; expected {', '.join(PHOTO_SUFFIXES)}."
            )
        return inside
    if _PATTERN.search(str(path)) and not path.exists():
        first = next(place for place, part in enumerate(path.parts) if _PATTERN.search(part))
        pattern = str(Path(*path.parts[first:]))
        fitting = sorted(Path(*path.parts[:first]).glob(pattern))
        if not fitting:
            raise InputError(f"No file fits the pattern '{path}'.")
        return fitting
    return [path]


def _check_head(path: Path, head: list[str], columns: Collection[str]) -> None:
    known = [PHOTO, FILM, NAME, *sorted(columns)]
    for name in head:
        if name not in known:
            raise InputError(
                f"The manifest '{path}' has a column {quoted(name)}; expected {', '.join(known)}, "
                "with commas between them."
            )
        if head.count(name) > 1:
            raise InputError(f"The manifest '{path}' has the column '{name}' twice.")
    if not {PHOTO, FILM} & set(head):
        raise InputError(f"The manifest '{path}' has no column '{PHOTO}', and none '{FILM}'.")


def _row(path: Path, line: int, head: list[str], cells: list[str]) -> ManifestRow:
    if len(cells) > len(head):
        raise InputError(
            f"Line {line} of the manifest '{path}' has {len(cells)} cells for {len(head)} columns; "
            "put a cell that holds a comma into quotes."
        )
    found = {name: cell for name, cell in zip(head, cells, strict=False) if cell}
    photos, films = _parts(found.pop(PHOTO, "")), _parts(found.pop(FILM, ""))
    film = all(films)
    if film == all(photos):
        several = "both a photo and a film" if film else "no photo and no film"
        raise InputError(f"Line {line} of the manifest '{path}' names {several}.")
    if len(films) > 1:
        raise InputError(
            f"Line {line} of the manifest '{path}' names {len(films)} films; give each a line."
        )
    videos = [one for one in photos if _is_video(Path(one))]
    if videos:
        raise InputError(
            f"Line {line} of the manifest '{path}' names the video {quoted(videos[0])} as a photo; "
            f"name it in the column '{FILM}'."
        )
    name = found.pop(NAME, "")
    if name and (name != _as_name(name)):
        raise InputError(
            f"Line {line} of the manifest '{path}' has the name {quoted(name)}; expected letters, "
            f"digits, '.', '_' and '-', at most {NAME_LENGTH_MAX}, and a letter or digit first."
        )
    values = {key: _parts(cell) for key, cell in found.items()}
    return ManifestRow(line, name, films if film else photos, values, film)


def _parts(cell: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in cell.split(SEPARATOR))


def _as_name(text: str) -> str:
    """A name of a folder that every system takes."""
    return re.sub(r"^\W+|[^\w.-]", "_", text)[:NAME_LENGTH_MAX]


def _named(rows: list[ManifestRow], path: Path | None = None) -> list[ManifestRow]:
    """The rows, each with a name of its own: what the table says, else the first photo's."""
    given = Counter(row.name.casefold() for row in rows if row.name)
    for row in rows:
        if row.name and given[row.name.casefold()] > 1:
            raise InputError(
                f"The manifest '{path}' has the name '{row.name}' more than once (line {row.line})."
            )
    return list(_distinct(rows, set(given)))


def _distinct(rows: list[ManifestRow], taken: set[str]) -> Iterator[ManifestRow]:
    for row in rows:
        name = row.name
        if not name:
            stem = name = _as_name(Path(row.photos[0]).stem) or "photo"
            count = 1
            while name.casefold() in taken:
                count += 1
                name = f"{stem}-{count}"
            taken.add(name.casefold())
        yield replace(row, name=name)

"""Draw who imports whom, from the imports themselves: docs/images/rooms-*.svg (`make rooms`).

Every room is a box with its purpose (the first sentence of its package), above all that it imports.
An arrow that only shortens a way along others is left out. ``--check`` draws nothing and ends with
exit code 1 where a picture is not what the imports say today.
"""

from __future__ import annotations

import argparse
import ast
import sys
from dataclasses import dataclass
from html import escape
from pathlib import Path
from textwrap import wrap

import grimp

PROJECT = Path(__file__).resolve().parent.parent
IMAGES = PROJECT / "docs" / "images"
SOURCES = {"facestage": PROJECT / "backend", "facestage_blender": PROJECT / "addon"}
# Packages whose sub-packages are rooms of their own.
HOUSES = {"facestage", "facestage.fit", "facestage_blender"}
WIDTH, GAP, LINE, LEVEL = 268, 18, 14, 30
FONT = 'font-family="sans-serif"'
INK, PALE, EDGE = "#1b1d22", "#5d6472", "#8a93a6"
FILL = {"contract": "#fdf3dc", "fit": "#e6f0ea", "other": "#f2f4f8"}


@dataclass(frozen=True)
class Room:
    """A package, and its purpose in one sentence."""

    name: str
    purpose: str

    @property
    def label(self) -> str:
        """The name below its house."""
        return self.name.removeprefix("facestage.").removeprefix("facestage_blender.")

    @property
    def lines(self) -> list[str]:
        """The purpose in lines that fit the box."""
        return wrap(self.purpose, 44)

    @property
    def height(self) -> int:
        """Of the box, in pixels."""
        return 28 + LINE * len(self.lines)


def main() -> int:
    """Draw or check both pictures; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="only say whether they are as today")
    options = parser.parse_args()
    sys.path[:0] = [str(folder) for folder in SOURCES.values()]
    graph = grimp.build_graph(*SOURCES, cache_dir=None)
    stale = []
    for house, file in (
        ("facestage", "rooms-backend.svg"),
        ("facestage_blender", "rooms-addon.svg"),
    ):
        rooms = rooms_of(graph, house)
        picture = drawing(rooms, imports_of(graph, rooms))
        target = IMAGES / file
        if not target.is_file() or target.read_text(encoding="utf-8") != picture:
            stale.append(file)
            if not options.check:
                target.write_text(picture, encoding="utf-8")
    if options.check and stale:
        print(f"{', '.join(stale)}: not what the imports say today; run: make rooms")
    return int(options.check and bool(stale))


def rooms_of(graph: grimp.ImportGraph, house: str) -> list[Room]:
    """The rooms of a house, those of inner houses in their place; single modules are left out."""
    found = []
    for name in sorted(graph.find_children(house)):
        folder = SOURCES[name.split(".")[0]].joinpath(*name.split("."))
        if name in HOUSES:
            found += rooms_of(graph, name)
        elif folder.is_dir():
            document = ast.get_docstring(ast.parse((folder / "__init__.py").read_text("utf-8")))
            purpose = (document or "").split("\n\n")[0].replace("\n", " ").replace("``", "")
            found.append(Room(name, purpose))
    if house == "facestage_blender":
        found.append(Room("facestage.contract", "What both sides say to each other."))
    return found


def imports_of(graph: grimp.ImportGraph, rooms: list[Room]) -> dict[str, set[str]]:
    """What each room imports of the others. Raises SystemExit where they import in a circle."""
    names = [room.name for room in rooms]
    direct = {
        a: {
            b
            for b in names
            if a != b and graph.direct_import_exists(importer=a, imported=b, as_packages=True)
        }
        for a in names
    }
    for name in names:
        if name in reached(direct, direct[name]):
            raise SystemExit(f"{name} is imported by what it imports: mend the circle first.")
    return direct


def reached(direct: dict[str, set[str]], start: set[str]) -> set[str]:
    """Everything that ``start`` imports, directly or not."""
    seen: set[str] = set()
    waiting = set(start)
    while waiting:
        name = waiting.pop()
        if name not in seen:
            seen.add(name)
            waiting |= direct[name]
    return seen


def drawing(rooms: list[Room], direct: dict[str, set[str]]) -> str:
    """The picture as SVG: what imports nothing at the bottom, each room above all it imports."""
    level: dict[str, int] = {}

    def level_of(name: str) -> int:
        if name not in level:
            level[name] = 1 + max((level_of(other) for other in direct[name]), default=-1)
        return level[name]

    rows: dict[int, list[Room]] = {}
    for room in rooms:
        rows.setdefault(level_of(room.name), []).append(room)
    columns = max(len(row) for row in rows.values())
    width = columns * (WIDTH + GAP) + GAP
    place: dict[str, tuple[float, float, Room]] = {}
    y = float(GAP)
    for number in sorted(rows, reverse=True):
        row = rows[number]
        x = (width - len(row) * (WIDTH + GAP) + GAP) / 2
        for room in row:
            place[room.name] = (x, y, room)
            x += WIDTH + GAP
        y += max(room.height for room in row) + LEVEL
    arrows = [
        arrow(place[name], place[other])
        for name in sorted(direct)
        for other in sorted(direct[name])
        if not any(other in reached(direct, direct[way]) for way in direct[name] - {other})
    ]
    boxes = [box(*place[name]) for name in sorted(place)]
    height = f"{y - LEVEL + GAP:g}"
    size = f'viewBox="0 0 {width} {height}" width="{width}" height="{height}"'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" {size}>'
    back = '<rect width="100%" height="100%" fill="#fff"/>'
    return "\n".join([head, back, *arrows, *boxes, "</svg>", ""])


def box(x: float, y: float, room: Room) -> str:
    """One room."""
    kind = "contract" if "contract" in room.name else "fit" if ".fit." in room.name else "other"
    name = f'{FONT} font-size="13" font-weight="600" fill="{INK}"'
    shape = f'width="{WIDTH}" height="{room.height}" rx="5" fill="{FILL[kind]}" stroke="{EDGE}"'
    lines = [
        f'<rect x="{x:g}" y="{y:g}" {shape}/>',
        f'<text x="{x + 9:g}" y="{y + 17:g}" {name}>{escape(room.label)}</text>',
    ]
    for number, line in enumerate(room.lines):
        at = f'x="{x + 9:g}" y="{y + 33 + LINE * number:g}"'
        lines.append(f'<text {at} {FONT} font-size="11" fill="{PALE}">{escape(line)}</text>')
    return "".join(lines)


def arrow(start: tuple[float, float, Room], end: tuple[float, float, Room]) -> str:
    """A curve from the bottom of a room to the top of one that it imports."""
    x0, y0 = start[0] + WIDTH / 2, start[1] + start[2].height
    x1, y1 = end[0] + WIDTH / 2, end[1]
    bend = (y1 - y0) / 2
    curve = f"M{x0:g},{y0:g} C{x0:g},{y0 + bend:g} {x1:g},{y1 - bend:g} {x1:g},{y1:g}"
    return f'<path d="{curve}" fill="none" stroke="{EDGE}" stroke-width="1.2"/>'


if __name__ == "__main__":
    sys.exit(main())

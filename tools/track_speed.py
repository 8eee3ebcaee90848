"""How fast ``facestage track`` follows a film, part by part, and in how much memory.

Frames a second are those of the parts that take longer the more frames there are: not of the
keyframes' fit, nor of reading the model and writing the folder. By landmarks alone, give
``--landmarks-only``: otherwise processes that will look at pictures begin meanwhile.

Options that it does not know are handed on to ``facestage track``. Leave the machine alone
meanwhile, or read the processor time. ``--frames`` makes a longer film of a folder: its frames
forth and back, over and over.

    python tools/track_speed.py frames --out speed --frames 1000 --camera camera.json
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping
from itertools import chain, cycle, islice
from pathlib import Path

from facestage.contract.sequence import Sequence
from facestage.images.film import Film
from facestage.system.child import python_module

LOOKED_AT_EVERY = 0.1  # seconds
MIB = 1 << 20
# Parts of a run that take time for each frame; the keyframes' does not hang on how many there are.
LANDMARKS, PICTURES = ("landmarks", "smoothing"), ("landmarks", "smoothing", "pictures")


def main() -> int:
    """Track, and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("film", type=Path, help="a video or a folder of pictures")
    parser.add_argument("--out", type=Path, required=True, help="the sequence's folder to write")
    parser.add_argument("--frames", type=int, help="how many, of a folder's forth and back")
    options, rest = parser.parse_known_args()
    with tempfile.TemporaryDirectory() as folder:
        film = options.film
        if options.frames is not None:
            film = longer(Film(film), options.frames, Path(folder))
        command = python_module("facestage", "track", str(film), "--out", str(options.out), *rest)
        child = subprocess.Popen(command)
        memory = Memory(child.pid)
        with memory:
            code = child.wait()
    if code:
        return code
    track = Sequence.load(options.out)
    for line in table(track.timings, len(track.frames), memory.peak):
        print(line)
    return 0


def longer(film: Film, frames: int, folder: Path) -> Path:
    """``folder`` with so many pictures, those of ``film`` forth and back."""
    pictures = [film.picture(index) for index in range(film.count or 0)]
    found = [picture for picture in pictures if picture is not None]
    if not found:
        raise SystemExit("--frames wants a folder of pictures.")
    order = cycle(chain(found, found[-2:0:-1]))
    for number, picture in enumerate(islice(order, frames), 1):
        shutil.copyfile(picture, folder / f"{number:06d}{picture.suffix}")
    return folder


class Memory:
    """Watches the memory of a process and of those that it started; Linux alone says."""

    def __init__(self, process: int) -> None:
        self.peak = 0  # bytes
        self._process, self._over = process, threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_error: object) -> None:
        self._over.set()
        self._thread.join()

    def _watch(self) -> None:
        while not self._over.wait(LOOKED_AT_EVERY):
            self.peak = max(self.peak, sum(map(resident, family(self._process))))


def family(process: int) -> Iterator[int]:
    """The number of ``process``, and of all that it started, and they."""
    yield process
    for task in Path(f"/proc/{process}/task").glob("*/children"):
        try:
            children = task.read_text("ascii").split()
        except OSError:
            continue
        for child in children:
            yield from family(int(child))


def resident(process: int) -> int:
    """Bytes in memory; 0 of a process that is gone."""
    try:
        pages = Path(f"/proc/{process}/statm").read_text("ascii").split()[1]
    except OSError:
        return 0
    return int(pages) * os.sysconf("SC_PAGE_SIZE")


def table(timings: Mapping[str, float], frames: int, peak: int) -> Iterator[str]:
    """The lines that are printed."""
    yield f"{frames} frames           seconds  processor  a frame"
    for name in ("keyframes", *PICTURES):
        wall, cpu = timings[name], timings[f"{name}_cpu"]
        share = "" if name == "keyframes" else f"{cpu / frames:9.3f}"
        yield f"{name:20s}{wall:8.1f}{cpu:11.1f}{share}"
    for words, parts in (("landmarks alone", LANDMARKS), ("with pictures", PICTURES)):
        wall = sum(timings[part] for part in parts)
        cpu = sum(timings[f"{part}_cpu"] for part in parts)
        yield (
            f"{words}: {frames / max(wall, 1e-9):.2f} frames a second, {cpu / frames:.3f} s of "
            "processor time each"
        )
    if peak:
        yield f"most memory, all processes: {peak / MIB:.0f} MiB"


if __name__ == "__main__":
    sys.exit(main())

"""What is said of a film's speed and memory."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from facestage.images.film import Film
from facestage.images.image_io import write_png


@pytest.fixture
def speed(tools: None) -> ModuleType:
    """The module tools/track_speed.py."""
    import track_speed

    return track_speed


def test_a_longer_film_goes_forth_and_back(speed: ModuleType, tmp_path: Path):
    short, long = tmp_path / "short", tmp_path / "long"
    short.mkdir()
    long.mkdir()
    for number in range(4):
        write_png(short / f"{number}.png", np.full((8, 8, 3), 10 * number, np.uint8))
    film = Film(speed.longer(Film(short), 9, long))
    shown = [round(float(frame.photograph.color.mean() * 1e4)) for frame in film.frames()]
    assert film.count == 9
    assert shown == [shown[index] for index in (0, 1, 2, 3, 2, 1, 0, 1, 2)]
    assert len(set(shown[:4])) == 4


def test_the_table_leaves_keyframes_apart(speed: ModuleType):
    wall = {"landmarks": 2.0, "keyframes": 100.0, "smoothing": 3.0, "pictures": 20.0}
    timings = wall | {f"{name}_cpu": 2 * seconds for name, seconds in wall.items()}
    text = "\n".join(speed.table(timings, 50, 300 << 20))
    assert "landmarks alone: 10.00 frames a second, 0.200 s" in text
    assert "with pictures: 2.00 frames a second, 1.000 s" in text
    assert "300 MiB" in text and "\nkeyframes              100.0      200.0\n" in text


@pytest.mark.skipif(sys.platform != "linux", reason="Linux alone says")
def test_memory_is_that_of_all_processes(speed: ModuleType):
    child = "import subprocess, sys; subprocess.run([sys.executable, '-c', sys.argv[1]])"
    grandchild = "import time; kept = bytearray(b'1') * 200_000_000; time.sleep(30)"
    process = subprocess.Popen([sys.executable, "-c", child, grandchild])
    memory = speed.Memory(process.pid)
    ends = time.monotonic() + 20
    with memory:
        while memory.peak < 200e6 and time.monotonic() < ends:
            time.sleep(0.05)
    assert 200e6 < memory.peak < 400e6
    for number in reversed(list(speed.family(process.pid))):
        os.kill(number, 9)
    process.wait()
    assert speed.resident(process.pid) == 0

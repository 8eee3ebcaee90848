"""Films in a batch: in pieces, beside films that are no use, and gone on with."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from distributed import Client

from facestage.batch import run as batch_run
from facestage.batch.cluster import Connection, Pool
from facestage.batch.run import run_batch
from facestage.batch.task import Readers, Task
from facestage.cli.film_options import read_request
from facestage.cli.jobs import read_jobs
from facestage.contract.batch import FITS
from facestage.contract.events import Event
from facestage.contract.files.partial import partial_folder
from facestage.contract.files.storage import write_json
from facestage.contract.sequence import Sequence
from facestage.fit.pieces import run as pieces_run
from facestage.fit.sequence import run as run_module
from facestage.fit.sequence.tracking import Tracker
from facestage.render.variant import start_renderer
from reference.small_film import FRAMES, SmallFilm, small_film
from reference.small_fit import QUICK

READERS = Readers(read_jobs, read_request)


@contextmanager
def here(_pool: Pool, _rows: int) -> Iterator[Connection]:
    """A worker that is a thread of this process."""
    with Client(
        processes=False, n_workers=1, threads_per_worker=1, dashboard_address=None
    ) as client:
        yield Connection(client, 1, 1, "none")


def task_of(film: SmallFilm, path: Path, number: int) -> Task:
    camera = path.parent / "camera.json"
    options = {
        "film": path,
        "camera": camera,
        "model": f"npz:{film.model}",
        "chunk": 7,
        "rate": None,
        "focal_px": None,
        "landmark_model": None,
        "landmarks_only": False,
        "dynamic_skin": False,
        "vertices": False,
        "face": None,
        "seed": None,
        "device": "cpu",
        "truth": None,
        "budget": "draft",
        "freeze": [],
    }
    return Task(number, path.stem, (path,), Namespace(**options), film=True)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_films_are_followed_in_pieces_and_bad_ones_get_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    start_renderer("cpu")
    film = small_film(tmp_path)
    write_json(tmp_path / "camera.json", film.scene.state.camera.to_json())
    (tmp_path / "broken.mp4").write_bytes(b"no video")
    paths = [tmp_path / "broken.mp4", film.folder, tmp_path / "gone.mp4"]
    tasks = [task_of(film, path, number) for number, path in enumerate(paths, 1)]
    monkeypatch.setattr(batch_run, "connected", here)
    monkeypatch.setattr(run_module, "look_through", film.looker())
    monkeypatch.setattr(pieces_run, "begin_film", partial(pieces_run.begin_film, fineness=QUICK))
    follow = pieces_run.follow_piece

    def fail(request: Any, out: Path, most: int, number: int) -> None:
        if number == 1:
            raise MemoryError
        follow(request, out, most, number)

    monkeypatch.setattr(pieces_run, "follow_piece", fail)
    events: list[Event] = []
    out = tmp_path / "out"
    rows = run_batch(tasks, READERS, out, Pool(), emit=events.append)
    assert all(row.failed for row in rows)
    for row, words in zip(rows, ("not a video", "memory", "no video or folder"), strict=True):
        assert words in row.sentence and "\n" not in row.sentence
    told = [event.message for event in events]
    assert any("frames: the person is found, 2 pieces" in words for words in told)
    assert any("frames: 1 of 2 pieces" in words for words in told)
    fractions = [event.fraction for event in events]
    assert fractions == sorted(fractions)

    # Gone on with: neither person nor first piece is looked for again.
    monkeypatch.setattr(pieces_run, "follow_piece", follow)
    monkeypatch.setattr(run_module, "fit_person", None)
    begun = []
    by_landmarks = Tracker.by_landmarks

    def begin(tracker: Tracker, *arguments: Any) -> Any:
        begun.append(len(tracker.landmarks))
        return by_landmarks(tracker, *arguments)

    monkeypatch.setattr(Tracker, "by_landmarks", begin)
    rows = run_batch(tasks, READERS, out, Pool(), resume=True)
    assert [row.failed for row in rows] == [True, False, True]
    assert len(begun) == 1
    track = Sequence.load(out / FITS / "frames")
    assert len(track.frames) == FRAMES and rows[1].sentence == track.advice
    assert rows[1].seconds > track.timings["pieces"] > 0
    assert not partial_folder(out / FITS / "frames").exists()
    page = (out / "report.html").read_text(encoding="utf-8")
    assert f'href="{FITS}/frames/report.html"' in page and page.count("data:image/jpeg") == 1
    assert f"{FITS}/frames/film.webp" in (out / "summary.csv").read_text(encoding="utf-8")

    again = run_batch(tasks[1:2], READERS, out, Pool(), resume=True, emit=events.append)
    assert again == rows[1:2] and events[-2].message == "0 of 1 rows to fit"
    # Another picture is another film.
    (film.folder / "001.png").touch()
    assert tasks[1].asked != rows[1].asked

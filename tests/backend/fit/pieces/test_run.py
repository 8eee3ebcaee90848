"""A small film in pieces, beside one process; a piece that is cut off goes on."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from facestage.contract.files.partial import PIECES, partial_folder
from facestage.contract.sequence import Sequence
from facestage.fit.pieces import run as pieces_run
from facestage.fit.pieces.cutting import Piece, cut
from facestage.fit.pieces.run import begin_film, follow_piece, join_film
from facestage.fit.sequence import run as run_module
from facestage.fit.sequence.checkpoint import PassCheckpoint
from facestage.fit.sequence.looking import Answer
from facestage.fit.sequence.tracking import Tracker
from facestage.render.variant import start_renderer
from reference.small_film import FRAMES, small_film
from reference.small_fit import QUICK, StopError

MOST, ALL = 7, 100  # frames of a piece
FINENESS = replace(QUICK, keyframes=4)
ELSEWHERE = """
import json, sys
from pathlib import Path
from facestage.contract.camera import Camera
from facestage.fit.pieces import run
from facestage.fit.pieces.cutting import cut
from facestage.fit.sequence.request import Request
run.cut = lambda count, most: cut(count, most, overlap=3)
camera, film, model, truth, out, most = json.loads(sys.argv[1])
camera = Camera(**camera)
request = Request(film=Path(film), model=model, camera=camera, truth=Path(truth))
run.follow_piece(request, Path(out), most, 1)
"""


def evenly(count: int, most: int, overlap: int = 3) -> list[Piece]:
    return cut(count, most, overlap)


def differences(poses: np.ndarray, others: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """By how much two series of (F, 4, 4) poses are turned (radians) and moved (metres), (F, 3)."""
    between = Rotation.from_matrix(poses[:, :3, :3] @ np.swapaxes(others[:, :3, :3], 1, 2))
    return np.abs(between.as_rotvec()), np.abs(poses[:, :3, 3] - others[:, :3, 3])


@pytest.mark.slow
def test_a_film_in_pieces_is_what_one_process_finds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    start_renderer("cpu")
    film = small_film(tmp_path)
    monkeypatch.setattr(run_module, "look_through", film.looker((4,)))
    monkeypatch.setattr(pieces_run, "cut", evenly)
    request = film.request(truth=film.write_truth(tmp_path / "truth.npz"))
    out = tmp_path / "out"
    assert begin_film(request, out, MOST, fineness=FINENESS) == 2
    for name in ("whole", "single"):
        shutil.copytree(partial_folder(out), partial_folder(tmp_path / name))
    whole = begin_film(request, tmp_path / "whole", ALL, True, fineness=FINENESS)
    assert isinstance(whole, Sequence)

    # The steps of a film of one piece, but for rounding.
    follow_piece(request, tmp_path / "single", ALL, 0)
    single = join_film(request, tmp_path / "single", ALL, {})
    np.testing.assert_allclose(single.expression, whole.expression, atol=1e-10)
    np.testing.assert_allclose(single.model_to_camera, whole.model_to_camera, atol=1e-10)
    for name, deviation in whole.deviations.items():
        np.testing.assert_allclose(single.deviations[name], deviation, atol=1e-10)

    # Two pieces, the later one first, by a process that knows nothing of the others; the other is
    # cut off on its second look.
    assert request.camera is not None
    files = (request.film, request.model, request.truth, out)
    asked = json.dumps([asdict(request.camera), *map(str, files), MOST])
    subprocess.run([sys.executable, "-c", ELSEWHERE, asked], check=True)
    monkeypatch.setattr(run_module, "SAVED_EVERY", 0.0)
    heard, looks = Tracker.heard, []

    def hear(tracker: Tracker, pictures: Any, answer: Answer) -> None:
        looks.append(answer.index)
        heard(tracker, pictures, answer)
        if len(looks) == 14:
            raise StopError

    monkeypatch.setattr(Tracker, "heard", hear)
    with pytest.raises(StopError):
        follow_piece(request, out, MOST, 0)
    first = evenly(FRAMES, MOST)[0]
    folder = partial_folder(out) / PIECES / first.name
    left = PassCheckpoint.load(folder)
    assert left is not None and (left.number, left.done) == (1, 14 - first.stop - 1)
    follow_piece(request, out, MOST, 0)
    assert looks[14] == left.done, "what was looked at is looked at again"
    done = PassCheckpoint.load(folder)
    assert done is not None and (done.number, done.done) == (request.passes - 1, first.stop)
    count = len(looks)
    follow_piece(request, out, MOST, 0)
    assert len(looks) == count, "a piece that is done is followed again"

    shutil.copytree(partial_folder(out), partial_folder(tmp_path / "windows"))
    joined = join_film(request, out, MOST, {"begun": 1.5})
    # Frames of this film differ much, and what its pieces learn of its motion does, too: they agree
    # to a part of what the film itself is sure to.
    apart = np.abs(joined.expression - whole.expression)
    assert np.all(apart <= 0.5 * whole.deviations["expression"])
    turned, moved = differences(joined.model_to_camera, whole.model_to_camera)
    assert np.all(np.hstack([turned, moved]) <= 0.5 * whole.deviations["pose"])
    assert apart.max() < 0.05 and turned.max() < 0.004 and moved.max() < 0.0005
    assert joined.errors["similarity_mm"] < 1.1 * whole.errors["similarity_mm"]
    assert joined.timings["begun"] == 1.5
    assert len(joined.frames) == FRAMES and joined.frames[4].status == "lost"
    assert not partial_folder(out).exists()
    assert np.load(out / "sequence.npz")["expression"].shape == joined.expression.shape

    # Smoothed in windows, as a film is that is too long for memory.
    monkeypatch.setattr(pieces_run, "WINDOW", 7)
    monkeypatch.setattr(pieces_run, "WINDOW_OVERLAP", 4)
    windows = join_film(request, tmp_path / "windows", MOST, {})
    difference = np.abs(windows.expression - joined.expression).max()
    assert 0 < difference < 0.05

"""A small film, tracked, corrected by hand and fitted again: folder to folder."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from facestage.contract.corrections import Correction
from facestage.contract.errors import InputError
from facestage.contract.events import PROGRESS, Event
from facestage.contract.quality import DRAFT
from facestage.contract.sequence import VERTICES, Sequence
from facestage.fit.correction import refit as refit_module
from facestage.fit.correction.refit import RefitRequest, refit
from facestage.fit.correction.rewriting import BY_HAND
from facestage.fit.correction.span import FrameRange
from facestage.fit.sequence import run as run_module
from facestage.fit.sequence.run import track_film
from facestage.render.variant import start_renderer
from reference.small_film import FRAMES, SmallFilm, small_film
from reference.small_fit import QUICK, StopError

FIRST, LAST = 4, 10  # numbers of the range
KEY = 7


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> SmallFilm:
    start_renderer("cpu")
    return small_film(tmp_path_factory.mktemp("film"))


@pytest.fixture(scope="module")
def tracked(film: SmallFilm, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    out = tmp_path_factory.mktemp("tracked") / "track"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run_module, "look_through", film.looker())
        request = film.request(quality=DRAFT, with_vertices=True)
        track_film(request, out, fineness=QUICK)
        yield out


@pytest.fixture
def found(film: SmallFilm, monkeypatch: pytest.MonkeyPatch) -> None:
    """True landmarks in place of a network's."""

    def faces(frames: Any, centre: np.ndarray, _model: Any) -> Iterator[Any]:
        for frame in frames:
            state = film.states[frame.number - 1]
            points = film.scene.landmarks(state, 0.3, frame.number - 1)
            assert frame.number > FIRST or np.abs(points.points.mean(axis=0) - centre).max() < 30
            yield frame, points

    monkeypatch.setattr(refit_module, "faces_of", faces)


def corrected(track: Sequence, change: float) -> tuple[Correction, ...]:
    value = float(track.expression[KEY - 1, 0] + change)
    return (Correction(KEY, {track.expression_names[0]: value}),)


@pytest.mark.slow
def test_frames_beside_a_corrected_one_follow_and_others_stay(
    film: SmallFilm, tracked: Path, found: None, tmp_path: Path
):
    out = tmp_path / "track"
    shutil.copytree(tracked, out)
    (out / "notes.txt").write_text("mine")
    before = Sequence.load(out)
    frames = FrameRange(FIRST, LAST)
    truth = film.write_truth(tmp_path / "truth.npz")

    keys = corrected(before, 0.2)
    request = RefitRequest(film.folder, keys, frames, truth)
    events: list[Event] = []
    refit(request, out, events.append)
    after = Sequence.load(out)
    change = after.expression[:, 0] - before.expression[:, 0]
    assert change[KEY - 1] == pytest.approx(0.2, abs=1e-12)
    assert change[KEY] > 0.05 and change[KEY - 2] > 0.05
    outside = np.r_[: FIRST - 1, LAST:FRAMES]
    np.testing.assert_array_equal(after.expression[outside], before.expression[outside])
    np.testing.assert_array_equal(after.model_to_camera[outside], before.model_to_camera[outside])
    spread = after.deviations["expression"]
    assert spread[KEY - 1, 0] < 1e-3 and (spread <= before.deviations["expression"]).all()
    assert after.frames[KEY - 1].advice == BY_HAND and after.frames[0] == before.frames[0]
    assert "1 frame corrected by hand" in after.advice and after.errors["similarity_mm"] > 0
    fractions = [event.fraction for event in events]
    assert fractions == sorted(fractions) and fractions[-1] == 1.0
    vertices = np.load(out / VERTICES) - np.load(tracked / VERTICES)
    moved = np.flatnonzero(np.abs(vertices).max(axis=(1, 2)) > 0) + 1
    assert KEY in moved and moved.min() >= FIRST and moved.max() <= LAST
    assert (out / "notes.txt").is_file() and (out / "report.html").is_file()
    assert not (tmp_path / "track.partial").exists()

    # Another frame, later: what was corrected before stays so, to the last digit.
    value = float(after.expression[8, 1])
    more = (Correction(9, {after.expression_names[1]: value}),)
    again = refit(replace(request, corrections=more), out)
    assert again.expression[KEY - 1, 0] == after.expression[KEY - 1, 0]
    np.testing.assert_allclose(again.expression, after.expression, atol=2e-3)
    assert [each.frame for each in again.corrected] == [KEY, 9]
    assert again.advice.count("corrected by hand") == 1 and "2 frames" in again.advice


@pytest.mark.slow
def test_a_refit_that_is_cut_off_leaves_all_as_it_was_and_ends_the_same(
    film: SmallFilm, tracked: Path, found: None, tmp_path: Path
):
    out, other = tmp_path / "track", tmp_path / "other"
    for each in (out, other):
        shutil.copytree(tracked, each)
    before = Sequence.load(out)
    request = RefitRequest(film.folder, corrected(before, -0.1), FrameRange(FIRST, LAST))

    def stop(event: Event) -> None:
        if event.kind == PROGRESS and "pass 2" in event.message:
            raise StopError

    with pytest.raises(StopError):
        refit(request, out, stop)
    np.testing.assert_array_equal(Sequence.load(out).expression, before.expression)
    np.testing.assert_array_equal(refit(request, out).expression, refit(request, other).expression)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"corrections": (Correction(99, {"jawOpen": 0.1}),)}, "has the frames 1 to 13"),
        ({"corrections": (Correction(KEY, {"no such": 0.1}),)}, "does not have"),
        ({"corrections": (Correction(KEY),)}, "corrects nothing"),
        ({"frames": FrameRange(20, 30)}, "No frame has a number from 20 to 30"),
        ({"frames": FrameRange(1, 3)}, "not among the frames 1 to 3"),
    ],
)
def test_what_is_not_of_this_sequence_is_refused(
    film: SmallFilm, tracked: Path, found: None, change: dict[str, Any], words: str
):
    request = RefitRequest(film.folder, corrected(Sequence.load(tracked), 0.1))
    with pytest.raises(InputError, match=words):
        refit(replace(request, **change), tracked)


@pytest.mark.slow
def test_another_film_is_refused(
    film: SmallFilm, tracked: Path, found: Callable[..., None], tmp_path: Path
):
    other = tmp_path / "frames"
    other.mkdir()
    for number in range(1, FRAMES + 1):
        shutil.copyfile(film.folder / f"{number:03d}.png", other / f"b{number:03d}.png")
    request = RefitRequest(other, corrected(Sequence.load(tracked), 0.1))
    with pytest.raises(InputError, match="give the film that was tracked"):
        refit(request, tracked)

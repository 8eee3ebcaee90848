"""A small film all the way: what is found, what is written, and that a killed run goes on."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence

from facestage.contract.errors import InputError
from facestage.contract.events import PROGRESS, Event
from facestage.contract.files.partial import partial_folder
from facestage.contract.person import Person
from facestage.contract.sequence import KEYFRAMES, VERTICES, Sequence
from facestage.fit.sequence import crew
from facestage.fit.sequence import run as run_module
from facestage.fit.sequence.run import track_film
from facestage.fit.sequence.skin import haemoglobin
from facestage.fit.sequence.wrinkles import folds, groups, wrinkles
from facestage.images.image_io import read_exr
from facestage.images.opencv import opencv
from facestage.render.variant import start_renderer
from reference.small_film import FRAMES, SmallFilm, small_film
from reference.small_fit import QUICK, StopError


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> SmallFilm:
    start_renderer("cpu")
    return small_film(tmp_path_factory.mktemp("film"))


@pytest.fixture
def found(film: SmallFilm, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Makes landmarks found in all frames but the given ones."""

    def find(*lost: int) -> None:
        monkeypatch.setattr(run_module, "look_through", film.looker(lost))

    return find


@pytest.mark.slow
def test_a_small_film_is_followed_and_a_killed_run_goes_on(
    film: SmallFilm, found: Callable[..., None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    found(4)
    truth = film.write_truth(tmp_path / "truth.npz")
    request = film.request(truth=truth, with_vertices=True, dynamic_skin=True)
    events: list[Event] = []

    def listen(event: Event) -> None:
        if "pass 1" in event.message and not any("pass 1" in one.message for one in events):
            # What a kill would leave once the person is found.
            shutil.copytree(partial_folder(tmp_path / "out"), partial_folder(tmp_path / "again"))
        events.append(event)

    track = track_film(request, tmp_path / "out", emit=listen, fineness=QUICK)

    assert [frame.status for frame in track.frames].count("lost") == 1
    assert track.frames[4].status == "lost" and "No face" in track.frames[4].advice
    assert track.frames[4].photo_rms is None and track.frames[3].photo_rms is not None
    true = np.array([state.expression for state in film.states])
    seen = np.arange(FRAMES) != 4
    # Its landmarks are true, and count as little beside pictures of 80 pixels as a network's do.
    assert np.abs(track.expression - true)[seen].mean() < 0.14
    spread = track.deviations["expression"].sum(axis=1)
    assert spread[4] > spread[3] and spread[4] > spread[5]
    assert track.errors["similarity_mm"] < 4 and track.errors["jitter_ratio"] < 2
    fractions = [event.fraction for event in events]
    assert fractions == sorted(fractions) and events[-1].fraction == 1.0

    loaded = Sequence.load(tmp_path / "out")
    np.testing.assert_array_equal(loaded.model_to_camera, track.model_to_camera)
    Person.load(tmp_path / "out" / KEYFRAMES)
    vertices = np.load(tmp_path / "out" / VERTICES)
    assert vertices.shape == (FRAMES, len(film.scene.model.vertices), 3)
    assert vertices.dtype == np.float32 and (vertices[..., 2] < 0).all()
    assert (tmp_path / "out" / "albedo.exr").is_file()
    # Its skin is the same in all frames.
    assert track.haemoglobin is None and "was left out" in track.advice
    assert loaded.skin == track.skin and set(track.skin) == {"haemoglobin", "haemoglobin_noise"}
    assert not track.wrinkles and "pixels long, wrinkles need 250" in track.advice
    assert "Frames that need a look" in (tmp_path / "out" / "report.html").read_text("utf-8")
    with Image.open(tmp_path / "out" / "film.webp") as shown:
        pictures = [np.asarray(one.convert("RGB")) for one in ImageSequence.Iterator(shown)]
    assert len(pictures) == FRAMES - 1  # none was lost but one
    for picture in pictures:  # the head in the middle, and the fit where the photo has it
        photo, fit = np.split(picture.astype(float), 2, axis=1)
        assert 0.1 < np.abs(photo - fit).mean() < 4
        for axis in (0, 1):
            bright = photo.mean(axis=2).sum(axis=axis)
            middle = np.average(np.arange(len(bright)), weights=bright)
            assert abs(middle - len(bright) / 2) < 0.1 * len(bright)

    def stop(event: Event) -> None:
        if event.kind == PROGRESS and "pass 2 of 3: frame 6" in event.message:
            with Image.open(str(event.preview)) as preview:
                assert preview.width == 2 * preview.height
            raise StopError

    # From now on by two processes: the same answer.
    monkeypatch.setattr(crew, "LOOKS_EACH", 1)
    monkeypatch.setattr(crew, "cores", lambda: 2)
    monkeypatch.setattr(run_module, "SAVED_EVERY", 0.0)
    # Previews change nothing.
    monkeypatch.setattr(run_module, "PREVIEW_EVERY", 0.0)
    with pytest.raises(StopError):
        track_film(request, tmp_path / "again", True, stop, fineness=QUICK)
    assert not (tmp_path / "again").exists()
    # What was left out of the one is written of the other.
    monkeypatch.setattr(haemoglobin, "CLEAR", 0.0)
    monkeypatch.setattr(haemoglobin, "FLOOR", 0.0)
    slider = film.scene.model.expression_names[0]
    monkeypatch.setattr(groups, "GROUPS", {"smile": (slider,)})
    monkeypatch.setattr(groups, "RANGE_MIN", 0.0)
    monkeypatch.setattr(wrinkles, "FACE_MIN", 0.0)
    monkeypatch.setattr(folds, "CLEAR", 0.0)
    monkeypatch.setattr(folds, "FLOOR", -1.0)
    resumed: list[Event] = []
    again = track_film(request, tmp_path / "again", True, resumed.append, fineness=QUICK)
    assert not any("pass 1" in event.message for event in resumed)
    np.testing.assert_array_equal(again.expression, track.expression)
    np.testing.assert_array_equal(again.model_to_camera, track.model_to_camera)
    assert track.skin.items() < again.skin.items()
    assert set(again.skin) - set(track.skin) == {"wrinkles_smile_mm", "wrinkles_smile_noise_mm"}
    written = Sequence.load(tmp_path / "again")
    assert written.haemoglobin is not None and written.haemoglobin_harmonics is not None
    mixtures, vertices = written.haemoglobin_harmonics.shape
    assert vertices == len(film.scene.model.vertices)
    assert written.deviations["haemoglobin"].shape == (FRAMES, mixtures)
    assert (np.abs(written.haemoglobin) < 5 * written.deviations["haemoglobin"] + 0.1).all()
    assert "haemoglobin comes and goes" in again.advice
    page = (tmp_path / "again" / "report.html").read_text("utf-8")
    assert "red is more" in page and "Wrinkles that come with an expression" in page
    (smile,) = written.wrinkles
    assert smile.sliders == (slider,) and "wrinkles come with smile" in again.advice
    normal = read_exr(tmp_path / "again" / smile.normal_file)
    path = str(tmp_path / "again" / smile.height_file)
    height = opencv().imread(path, opencv().IMREAD_UNCHANGED)
    assert normal.shape == (*height.shape, 3)
    flat = np.abs(normal - np.array([0.5, 0.5, 1.0])).max(axis=2) < 1e-3
    assert flat[height == 0].mean() > 0.95
    with Image.open(tmp_path / "again" / "film.webp") as shown:
        assert shown.width == 3 * shown.height
    assert not (tmp_path / "again.partial").exists()


def test_a_film_of_one_still_face_is_refused(
    film: SmallFilm, found: Callable[..., None], tmp_path: Path
):
    found(*range(FRAMES - 1))
    with pytest.raises(InputError, match="all show the same"):
        track_film(film.request(), tmp_path / "out", fineness=QUICK)
    assert not (tmp_path / "out").exists()

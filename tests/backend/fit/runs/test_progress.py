"""The one scale of a run, and the words that go with it."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from facestage.contract.events import DONE, PROGRESS, STARTED, Event
from facestage.fit.face.unknowns import SHAPE
from facestage.fit.runs import teller
from facestage.fit.runs.progress import FITTED, PAINTED, Progress, Scale, drawing, painting
from facestage.fit.runs.teller import Teller
from facestage.fit.stages.phases import SHAPE_HELD, PhaseName, Schedule


def step(name: str, number: int, finished: bool = False, variant: str = "") -> tuple[Any, Any]:
    """A passage through a phase and one of its steps, as far as the scale looks at them."""
    phase = Schedule()[name].varied(variant, SHAPE if variant else ())
    return SimpleNamespace(phase=phase), SimpleNamespace(number=number, finished=finished)


def progress(fraction: float = 0.25, **other: Any) -> Progress:
    values: dict[str, Any] = {
        "phase": "geometry",
        "iteration": 3,
        "fraction": fraction,
        "seconds": 12.0,
        "photo_rms": 0.5,
        "evaluation": None,
        "photo": None,
        "state": None,
    }
    return Progress(**values | other)


def test_the_phases_fill_their_part_of_the_scale():
    scale, schedule = Scale(Schedule()), Schedule()
    found = [
        scale.after(*step(phase.name, number, finished=number == phase.steps))
        for phase in schedule.phases
        for number in range(1, phase.steps + 1)
    ]
    assert found == sorted(found) and found[0] > 0 and found[-1] == pytest.approx(FITTED)
    # A phase has its share, whatever the others do.
    ends = [Scale(schedule).after(*step(phase.name, 1, True)) for phase in schedule.phases]
    shares = [phase.share for phase in schedule.phases]
    np.testing.assert_allclose(np.diff([0.0, *ends]), FITTED * np.array(shares))


def test_half_of_a_phase_is_half_of_its_share():
    schedule = Schedule()
    phase = schedule[PhaseName.GEOMETRY]
    before = Scale(schedule).after(*step(PhaseName.LIGHT, 1, finished=True))
    found = Scale(schedule).after(*step(PhaseName.GEOMETRY, phase.steps // 2))
    assert found == pytest.approx(before + 0.5 * FITTED * phase.share)
    # Held or not, the phase is where it is.
    held = step(PhaseName.GEOMETRY, phase.steps // 2, variant=SHAPE_HELD)
    assert Scale(schedule).after(*held) == found


def test_a_short_schedule_fills_the_scale_too():
    draft = Schedule().until(PhaseName.JOINT)
    assert Scale(draft).after(*step(PhaseName.SPECULAR, 1, True)) == pytest.approx(FITTED)


def test_no_step_goes_back():
    scale = Scale(Schedule(), photos=2)
    once = scale.after(*step(PhaseName.GEOMETRY, 4))
    assert scale.after(*step(PhaseName.GEOMETRY, 1)) == scale.alone(2) == once


def test_photos_alone_share_the_landmarks():
    scale = Scale(Schedule(), photos=2)
    landmarks = Scale(Schedule()).after(*step(PhaseName.LANDMARKS, 1, True))
    assert scale.alone(1) == 0.0
    assert scale.alone(2) == pytest.approx(landmarks / 2)


def test_what_follows_the_fit_goes_on_where_it_ends():
    marks = [painting(1, 2), painting(2, 2), drawing(1, 2), drawing(2, 2)]
    assert marks == sorted(marks)
    assert marks[0] == FITTED and marks[2] == PAINTED and marks[-1] < 1


def test_the_time_left_is_in_proportion():
    assert progress(0.25).seconds_left == pytest.approx(36.0)
    assert progress(1.0).seconds_left == 0.0
    assert np.isfinite(progress(0.0).seconds_left)


def told(photos: int) -> tuple[Teller, list[Event]]:
    heard: list[Event] = []
    return Teller(heard.append, photos), heard


def test_the_words_say_how_many_photos_there_are():
    one, heard = told(1)
    one.step(progress())
    assert heard[0].message == "Fitting: geometry, step 3"
    several, heard = told(3)
    several.step(progress(number=2))
    several.step(progress(number=2, together=False))
    assert [event.message for event in heard] == [
        "Fitting 3 photos together: geometry, step 3 (photo 2 is shown)",
        "Fitting photo 2 of 3: geometry, step 3",
    ]


def test_a_step_is_told_with_its_figures():
    one, heard = told(1)
    one.step(progress(0.4))
    (event,) = heard
    assert (event.kind, event.stage, event.iteration) == (PROGRESS, "geometry", 3)
    assert (event.error, event.fraction, event.preview) == (0.5, 0.4, None)
    assert event.seconds_left == pytest.approx(18.0) and event.seconds > 0


def test_a_run_begins_and_ends():
    one, heard = told(1)
    one.reading("photo.png")
    one.finishing()
    one.done("Well done.")
    assert [event.kind for event in heard] == [STARTED, PROGRESS, DONE]
    assert heard[0].message == "Reading photo.png"
    assert heard[1].fraction == FITTED and heard[1].stage == "pictures"
    assert (heard[2].fraction, heard[2].seconds_left) == (1.0, 0.0)
    assert heard[2].message == "Well done."


def test_textures_and_pictures_name_their_photo():
    several, heard = told(2)
    several.painting(2)
    several.drawing(1)
    assert [event.stage for event in heard] == ["texture", "pictures"]
    assert "photo 2 of 2 shows" in heard[0].message and "photo 1 of 2" in heard[1].message
    assert [event.fraction for event in heard] == [painting(2, 2), drawing(1, 2)]


def test_a_preview_is_drawn_now_and_then(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    drawn: list[tuple[Path, np.ndarray, np.ndarray]] = []
    monkeypatch.setattr(teller, "write_preview", lambda *given: drawn.append(given))
    photo, residual = np.ones((2, 3, 3)), np.full((2, 3, 3), 0.25)
    seen: Any = {"photo": photo, "evaluation": SimpleNamespace(residual=residual)}
    one, heard = told(1)
    one.step(progress(**seen))
    assert not drawn and heard[-1].preview is None, "there is no place for it yet"
    one.previews_into(tmp_path)
    one.step(progress())
    assert not drawn, "landmarks are no picture"
    for _ in range(2):
        one.step(progress(**seen))
    ((file, left, right),) = drawn
    assert file.parent == tmp_path
    assert {event.preview for event in heard[-2:]} == {str(file)}
    np.testing.assert_array_equal(left, photo)
    np.testing.assert_array_equal(right, photo + residual)

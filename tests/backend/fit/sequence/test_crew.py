"""Whoever looks at frames says the same, and nobody is left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from facestage.fit.sequence import crew as crew_module
from facestage.fit.sequence.actor import Actor
from facestage.fit.sequence.crew import LOOKS_EACH, Crew, crew_size
from facestage.fit.sequence.frames import Cut
from facestage.fit.sequence.looking import Answer, Looker, Question
from facestage.images.image_io import Photograph
from facestage.render.variant import start_renderer
from facestage.system import child
from reference.synthetic_scene import Scene, synthetic_scene

Asked = tuple[Looker, list[Question]]


@pytest.fixture(scope="module")
def scene() -> Scene:
    start_renderer("cpu")
    return synthetic_scene(side=64)


@pytest.fixture(scope="module")
def asked(scene: Scene) -> Asked:
    """Five frames, one of them without a face, and some of their pixels."""
    actor = Actor(scene.geometry, scene.forward, scene.stage, np.eye(4), scene.state)
    questions = [Question(3, None)]
    for index in range(4):
        aside = scene.state.translation + np.array([0.002 * index, 0.0, 0.0])
        state = replace(scene.state, translation=aside)
        color = scene.render(state, samples=2)[0].astype(np.float32)
        photo = Photograph(color, np.ones(color.shape[:2], bool), np.zeros(color.shape, bool))
        cut = Cut.of(photo, scene.landmarks(state, 0.2, index))
        quarter = None if index % 2 else 0
        question = Question(index + (index > 2), cut, scene.state, quarter=quarter)
        questions.insert(index, question)
    return Looker(actor, light_held=False), questions


def assert_same(found: list[Answer], wanted: list[Answer]) -> None:
    assert [one.index for one in found] == [one.index for one in wanted]
    for one, other in zip(found, wanted, strict=True):
        assert (one.seen is None) == (other.seen is None)
        if one.seen is None or other.seen is None:
            continue
        assert one.skin is not None and other.skin is not None
        np.testing.assert_array_equal(one.skin, other.skin)
        for part in ("hessian", "gradient", "rms"):
            np.testing.assert_array_equal(
                getattr(one.seen.said, part), getattr(other.seen.said, part)
            )
        for part in ("hessian", "gradient", "cross", "cost"):
            np.testing.assert_array_equal(
                getattr(one.seen.light, part), getattr(other.seen.light, part)
            )


@pytest.mark.slow
def test_processes_say_what_one_says_and_are_ended(asked: Asked):
    looker, questions = asked
    alone = list(looker.answers(questions))
    with Crew(looker, 2) as crew:
        assert_same(list(crew.answers(questions)), alone)
        assert crew.seconds > 0
        # One that is killed leaves its frames to this process.
        first, second = crew.members
        first.process.kill()
        assert_same(list(crew.answers(questions)), alone)
        assert second.process.is_alive()
    assert not any(member.process.is_alive() for member in crew.members)


@pytest.mark.slow
def test_what_a_process_raises_is_raised_here(asked: Asked):
    looker, questions = asked
    assert questions[0].cut is not None
    bad = replace(questions[0], skin=np.zeros((2, 3), np.uint8))
    with pytest.raises(IndexError, match="out of bounds"):
        looker.answer(bad)
    with Crew(looker, 1) as crew:
        with pytest.raises(IndexError, match="out of bounds"):
            list(crew.answers([bad]))
        assert_same(list(crew.answers(questions[1:2])), list(looker.answers(questions[1:2])))


def test_a_crew_is_as_large_as_the_work_the_cores_and_the_memory():
    many, room = 100 * LOOKS_EACH, 64 << 30
    assert crew_size(many, 2, room) == 2
    assert crew_size(many, 1, room) == 1
    assert crew_size(2 * LOOKS_EACH - 1, 8, None) == 1
    assert crew_size(3 * LOOKS_EACH, 8, None) == 3
    assert crew_size(many, 16, 4 << 30) == 3
    assert crew_size(many, 16, 1 << 28) == 1


def test_where_no_process_can_be_started_this_one_looks(
    asked: Asked, monkeypatch: pytest.MonkeyPatch
):
    def refuse(*_args: object, **_kwargs: object) -> None:
        raise OSError("no more processes")

    monkeypatch.setattr(crew_module, "cores", lambda: 4)
    monkeypatch.setattr(crew_module.SPAWN, "Process", refuse)
    assert Crew.of(asked[0], 1000) is None


def test_a_process_that_may_start_none_looks_by_itself(
    asked: Asked, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(crew_module, "cores", lambda: 4)
    monkeypatch.setattr(crew_module, "current_process", lambda: SimpleNamespace(daemon=True))
    assert Crew.of(asked[0], 1000) is None


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc").is_dir(), reason="asks Linux which processes run")
def test_processes_end_when_the_one_that_leads_is_killed():
    code = (
        # What a shell starts in the background has this ignored, and hands that on.
        "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from facestage.fit.sequence.crew import Member\n"
        "members = [Member() for _ in range(2)]\n"
        "for member in members:\n"
        "    member.begin(None)\n"
        "    try:\n"
        "        member.ask(None)\n"
        "    except AttributeError:\n"
        "        print(member.process.pid, flush=True)\n"
        "import time; time.sleep(600)"
    )
    with subprocess.Popen(child.python_code(code), stdout=subprocess.PIPE, text=True) as leader:
        assert leader.stdout is not None
        members = [int(leader.stdout.readline()) for _ in range(2)]
        assert all(running(member) for member in members)
        # Ctrl+C is heard by all processes, and only the one that leads may heed it.
        for member in members:
            os.kill(member, signal.SIGINT)
        time.sleep(1.0)
        assert all(running(member) for member in members)
        leader.kill()
    late = time.monotonic() + 20
    while any(running(member) for member in members) and time.monotonic() < late:
        time.sleep(0.1)
    assert not any(running(member) for member in members)


def running(process: int) -> bool:
    """Neither gone nor waiting for its parent to hear of its end."""
    try:
        return Path(f"/proc/{process}/stat").read_text("ascii").split(") ")[1][0] != "Z"
    except OSError:
        return False

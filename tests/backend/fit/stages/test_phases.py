"""The table of phases, and the schedules that are made of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from facestage.contract.job import Job
from facestage.contract.quality import BEST, DRAFT, GOOD
from facestage.fit.face.unknowns import BLOCKS, GLOSS, RELIEF, SHAPE
from facestage.fit.stages.phases import (
    LENS,
    PHASES,
    SHAPE_HELD,
    TOGETHER,
    PhaseName,
    Schedule,
    default_schedule,
)


def test_every_phase_has_its_row():
    assert {phase.name for phase in (*PHASES, LENS)} == set(PhaseName)
    assert len({phase.seed for phase in PHASES}) == len(PHASES), "light samples of their own"
    assert sum(phase.share for phase in PHASES) == pytest.approx(1.0)
    assert set(PHASES[-1].blocks) == set(BLOCKS) - set(RELIEF), "in the end, all that light tells"
    # A face is known by its landmarks before anybody looks at the photo.
    looks = [phase.with_photo for phase in PHASES]
    assert looks == sorted(looks) and not looks[0]


def test_a_phase_in_another_way_holds_blocks_and_says_so():
    joint = Schedule()[PhaseName.JOINT]
    held = joint.varied(SHAPE_HELD, SHAPE)
    assert (joint.title, held.title, held.name) == ("joint", "joint, shape held", "joint")
    assert set(joint.blocks) - set(held.blocks) == set(SHAPE)
    assert (held.seed, held.steps, held.face_px) == (joint.seed, joint.steps, joint.face_px)
    assert Schedule()[PhaseName.LANDMARKS].varied(TOGETHER).title == "landmarks together"


def test_a_schedule_is_asked_by_name():
    schedule = Schedule()
    assert schedule.last.name == PhaseName.JOINT
    assert schedule.landmark_phases + schedule.photo_phases == PHASES
    for name in PhaseName:
        if name != PhaseName.LENS:
            assert schedule.until(name).phases + schedule.since(name).phases == PHASES
            assert schedule.since(name).phases[0].name == name
    with pytest.raises(KeyError):
        schedule[PhaseName.LENS]


def test_qualities_differ_in_the_last_phase_alone():
    draft, good, best = (Schedule.of(name) for name in (DRAFT, GOOD, BEST))
    assert (*draft.phases, good.last) == good.phases == PHASES
    assert best.phases[:-1] == good.phases[:-1]
    assert best.last.name == PhaseName.JOINT
    assert best.last.face_px == pytest.approx(1.35 * (good.last.face_px or 0.0))
    assert best.last.steps > good.last.steps and best.last.samples > good.last.samples


def test_what_a_run_changes_is_changed_in_phases_with_the_photo():
    for schedule in (Schedule().scaled(0.5, 3.0), Schedule().limited(2)):
        assert schedule.landmark_phases == Schedule().landmark_phases
    for found, plain in zip(
        Schedule().scaled(0.5, 0.1).photo_phases, Schedule().photo_phases, strict=True
    ):
        assert found.face_px == 0.5 * (plain.face_px or 0.0) and found.samples == 1
    assert all(phase.steps <= 2 for phase in Schedule().limited(2).photo_phases)
    assert Schedule().limited(None) == Schedule()
    job = Job(Path("photo.png"))
    assert default_schedule(job, 1) == Schedule().limited(1)
    assert set(GLOSS) <= set(Schedule()[PhaseName.SPECULAR].blocks)

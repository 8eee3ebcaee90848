"""What the plan saves, measured on a tiny scene: both plans end alike, and the tables say what was
measured.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from facestage.bench.cases import Case
from facestage.bench.plan_savings import (
    RuleSaving,
    Saving,
    measure,
    rule_lines,
    scenes,
    table_lines,
)
from facestage.contract.light_stage import OFF, ON
from facestage.fit.energy.plan import Rules
from reference.known import known
from reference.tiny_bench import SHORT


def test_the_scenes_are_what_they_are_called(case: Case, tmp_path: Path):
    jobs = dict(scenes(tmp_path, case.model, 64, specular_size=6))
    little, usual, many = jobs.values()
    stages = [known(job.stage) for job in jobs.values()]
    assert [len(stage) for stage in stages] == [20, 20, 100]
    assert (stages[0].state == ON).sum() == 1 and (stages[0].state == OFF).sum() == 19
    assert (
        set(little.freeze) == {"specular", "roughness", "identity"}
        and not little.initial["specular"].any()
    )
    assert (
        not usual.freeze
        and not many.freeze
        and np.ptp(stages[1].radiance) == 0 == np.ptp(stages[2].radiance)
    ), "the light is not told"


def test_both_plans_end_alike_and_every_rule_is_timed(case: Case, tmp_path: Path):
    name, job = next(scenes(tmp_path, case.model, 64, specular_size=6))
    saving, rules = measure(name, job, tmp_path, rounds=1, fineness=SHORT)
    print(*table_lines([saving]), *rule_lines(rules), sep="\n")
    assert saving.deviation < 0.05
    assert saving.lean_mm == pytest.approx(saving.full_mm, abs=0.01)
    assert min(saving.lean_step_cpu, saving.full_step_cpu, saving.lean_total) > 0
    assert [row.rule for row in rules] == list(vars(Rules()))


def test_tables_show_both_sides_and_the_ratio():
    lines = table_lines([Saving("20 lights", 0.5, 1.5, 0.4, 1.0, 10.0, 30.0, 1.25, 1.26, 0.012)])
    assert len(lines) == 2 and len(lines[0]) == len(lines[1])
    for text in ("0.50 / 1.50", "0.40 / 1.00", "1.250 / 1.260", "0.012 sd", "2.50"):
        assert text in lines[1], text
    lines = rule_lines([RuleSaving("20 lights", "pixels", 0.4, 0.6)])
    assert "pixels" in lines[1] and lines[1].endswith("1.50")

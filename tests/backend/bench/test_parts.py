"""What a part of the light's model costs and gains: fits without it, and the table."""

from __future__ import annotations

from dataclasses import replace

import pytest

from facestage.bench.cases import Case
from facestage.bench.parts import part_gains, part_lines
from facestage.bench.run import open_case
from facestage.bench.settings import DEFAULT, OURS, PARTS, SURROUND, SolverSettings
from facestage.bench.solver import run_solver, without_part
from facestage.bench.table import Final
from facestage.bench.trace import Row
from facestage.contract.job import WITHOUT
from facestage.contract.parameters import PARAMETERS
from reference.tiny_bench import SHORT


def test_every_part_but_the_lights_behind_is_an_unknown():
    assert set(PARTS) - {SURROUND} <= set(PARAMETERS)
    assert len(set(PARTS.values())) == len(PARTS)


def test_a_fit_without_a_part_never_has_it(case: Case):
    problem, truth, _ = open_case(case, fineness=SHORT)
    for part in set(PARTS) - {SURROUND}:
        settings = SolverSettings(PARTS[part], resolution=0.4, samples=0.5, without=part)
        track = run_solver(problem, truth, settings, detail=False)
        assert {float(getattr(each.state, part)) for each in track.snapshots} == {0.0}, part
    job = without_part(problem.job, SURROUND)
    assert job.surround == WITHOUT and job.freeze == problem.job.freeze
    assert without_part(problem.job, "") is problem.job


def test_gains_are_of_the_fit_with_the_part():
    words = PARTS["interreflection"]
    whole = Final("a", OURS, DEFAULT.name, 9.0, 0.5, 1.0, 38.0, 39.0, 0.02, 0.05)
    without = replace(whole, contender=words, similarity_mm=0.8, psnr=36.0, albedo=0.05)
    finals = [whole, without]
    finals += [replace(each, case="b", similarity_mm=0.6, albedo=None) for each in finals]
    rows = [
        Row(case, OURS, name, begin + step * each, "joint", 30.0, 1.0, 1.0)
        for case in ("a", "b")
        for name, begin, each in ((DEFAULT.name, 5.0, 0.3), (words, 4.0, 0.2))
        for step in range(4)
    ]
    (gain,) = part_gains(rows, finals)
    assert (gain.words, gain.cases) == (words, 2)
    assert gain.step_ratio == pytest.approx(1.5)
    assert gain.similarity_mm == pytest.approx(-0.15)
    assert gain.psnr == pytest.approx(2.0)
    assert gain.albedo == pytest.approx(-0.03), "of the one case whose truth says it"
    text = "\n".join(part_lines([gain]))
    assert "1.50x" in text and "-0.150" in text and "+2.0" in text and "-0.0300" in text
    assert part_lines([]) == [] and part_gains(rows, [whole]) == []

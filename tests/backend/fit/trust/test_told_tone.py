"""A fit that is told how light the skin is, and one that has to guess."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from facestage.fit.result.run import fit_job
from reference.small_fit import QUICK
from reference.synthetic_case import Case


@pytest.mark.usefixtures("renderer")
def test_skin_is_as_light_as_somebody_says_and_light_makes_up_for_it(case: Case, tmp_path: Path):
    job = case.job(lights=6)
    guessed = fit_job(job, tmp_path / "guessed", fineness=QUICK)
    told = fit_job(replace(job, skin_tone=-30.0), tmp_path / "told", fineness=QUICK)
    assert guessed.errors["skin_tone"] > 0
    assert told.errors["skin_tone"] == pytest.approx(-30.0, abs=8)
    assert told.stage.radiance.sum() > 1.2 * guessed.stage.radiance.sum()
    assert "which is a guess (--skin-tone" in guessed.advice
    assert "--skin-tone" not in told.advice

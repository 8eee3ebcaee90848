"""Views and fits of a small face, to ask how much of what light does in skin they find."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from facestage.contract.job import Job
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.problem import read_problem
from facestage.fit.result.run import fit_job
from facestage.fit.stages.view import View
from reference.small_fit import QUICK
from reference.synthetic_case import write_case
from reference.synthetic_scene import Scene


def view_of(job: Job) -> View:
    problem = read_problem(job, fineness=QUICK)
    return View(problem, ForwardModel(problem.geometry, problem.lights))


def found_in(scene: Scene, folder: Path, name: str, there: float) -> float:
    """How much of the strength ``name`` a fit finds in a photo of the scene with so much."""
    folder.mkdir()
    changed: dict[str, Any] = {name: there}
    photo = write_case(folder, replace(scene, state=replace(scene.state, **changed)))
    result = fit_job(photo.job(lights=6), folder / "out", fineness=QUICK)
    return float(result.parameters[name])

"""The photo as fine as the textures can show it, where the fit itself had a smaller one."""

from __future__ import annotations

from dataclasses import replace

from facestage.fit.given.problem import Problem, read_problem
from facestage.fit.given.window import WORTH
from facestage.fit.trust.fitted import Fitted


def finer_photo(problem: Problem, fitted: Fitted) -> tuple[Problem, Fitted]:
    """Both with the photo's face as large as the textures can show, read once more; as they are
    where that is no larger.
    """
    wanted = problem.fineness.painted_face_px
    if wanted < WORTH * problem.fineness.face_px or problem.window.factor == 1.0:
        return problem, fitted
    fineness = replace(problem.fineness, face_px=wanted, whole_face_px=wanted)
    finer = read_problem(problem.job, geometry=problem.geometry, fineness=fineness).lit_as(problem)
    focal_px = fitted.state.camera.focal_px * finer.window.factor / problem.window.factor
    state = replace(fitted.state, camera=replace(finer.camera, focal_px=focal_px))
    return finer, fitted.in_size(state, *finer.photograph.size, least=0.5)

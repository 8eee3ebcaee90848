"""What is asked of a fit after its last step: how sure it is, and whether photo and lens may be
believed.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.given.problem import Problem
from facestage.fit.solve.covariance import Posterior, covariance
from facestage.fit.stages.phases import LENS, Phase, PhaseName, Schedule
from facestage.fit.stages.photo_descent import Iteration
from facestage.fit.stages.view import View
from facestage.fit.trust.certainty import Certainty, describe, deviations
from facestage.fit.trust.color_doubt import ColorDoubt, color_doubt
from facestage.fit.trust.directions import find_null_directions
from facestage.fit.trust.fitted import Fitted
from facestage.fit.trust.guard import doubt, informative_share, landmark_statistic, statistic_limit
from facestage.fit.trust.lens_check import LensCheck, check_lens
from facestage.fit.trust.shading_doubt import shading_doubt
from facestage.fit.trust.support import Support, expected_distance
from facestage.fit.trust.vertex_certainty import beyond_the_model, vertex_deviation

CHANNEL_NAMES = ("red", "green", "blue")


@dataclass(frozen=True)
class Ending:
    """How the schedule ended for one photo."""

    phase: Phase  # the last of the schedule
    start: State  # where the landmark phases ended
    state: State
    last: Iteration | None  # the step to ``state``
    trace: list[dict[str, Any]]
    doubt: str = ""  # see photo_doubt
    statistic: float = 0.0


def conclude(view: View, ending: Ending, seconds: float, in_time: bool) -> Fitted:
    """The fit as it ended after ``seconds``, with what is asked of it; whether it came to its end
    ``in_time``.
    """
    began, state, last = time.monotonic(), ending.state, ending.last
    known = None if last is None else _known(view, state, last)
    certainty, shading = _certainty(view, state, known), _shading_doubt(view, last, known)
    size = view.problem.camera.height, view.problem.camera.width
    lens, settled = _lens(view, ending.start), _settled(view, ending.phase, ending.trace)
    return Fitted(
        state,
        ending.start,
        view.anchor(state),
        view.placed_stage(state),
        ending.trace,
        last.energy if last else {},
        last.condition if last else 1.0,
        seconds,
        time.monotonic() - began,
        in_time,
        certainty,
        shading,
        view.visible.unpainted_at(*size, state),
        view.visible.dark_at(*size),
        view.visible.shadowed_at(*size, state),
        ending.doubt,
        settled,
        lens,
        ending.statistic,
        view.plan.ledger,
        view.penumbra,
        surround=view.surround,
        below=view.below,
        between=view.between,
        support=None if ending.doubt else _support(view, ending.start, state, last, known),
        color=_color_doubt(view, state, last, known),
    )


def photo_doubt(
    view: View, start: State, end: State, last: Iteration | None, psnr: float | None
) -> tuple[str, float]:
    """Why the photo is not believed about the shape at ``end``, if so, and the landmark
    statistic.
    """
    free = view.free_shape(Layout(end))
    if last is None or last.evaluation is None or not free:
        return "", 0.0
    descent = view.descent(Schedule()[PhaseName.LANDMARKS], start)
    assert descent is not None
    statistic = landmark_statistic(descent.energy, start, end)
    height, width = last.evaluation.base_weight.shape
    share = informative_share(view.visible.of(width, height), last.evaluation)
    return doubt(statistic, statistic_limit(free), psnr, share), statistic


def _settled(view: View, phase: Phase, trace: Sequence[dict[str, Any]]) -> bool:
    """Whether the last phase converged, rather than stop at its last step, or without a single
    one.
    """
    if (
        not phase.with_photo
        or not Layout(view.start_state()).mask(set(phase.blocks) - view.frozen()).any()
    ):
        return True
    errors = [row["photo_rms"] for row in trace if row["stage"] == phase.title]
    if len(errors) < 2:
        return bool(errors)
    if len(errors) < phase.steps + phase.further or None in errors[-2:]:
        return True
    return bool(errors[-1] > (1 - view.problem.fineness.settled_share) * errors[-2])


def _lens(view: View, start: State) -> LensCheck | None:
    """Whether the landmarks speak against the known lens."""
    weights = view.problem.job.weights
    if view.problem.fit_focal or not weights.landmarks or not weights.prior:
        return None
    return check_lens(lambda state: view.descent(LENS, state), start, view.problem.job.seed)


def _known(view: View, state: State, last: Iteration) -> Posterior:
    """What the last normal equations say of the parameters that were free."""
    return Posterior(last.hessian, last.prior_hessian, ~view.held(state))


def _certainty(view: View, state: State, known: Posterior | None) -> Certainty:
    """What the last normal equations say of each parameter that was free, and of every vertex."""
    if known is None:
        return Certainty({}, {})
    layout, problem, names = Layout(state), view.problem, _names(view.problem)
    found = describe(deviations(known), layout, names)
    vertices = _vertex_deviation(view, state, known.after)
    if known.active[layout.slices["identity"]].any():
        vertices = beyond_the_model(vertices)
    directions = find_null_directions(known, state, problem.geometry, problem.lights, names)
    return replace(found, vertices_mm=vertices, directions=directions.to_json())


def _vertex_deviation(view: View, state: State, known: np.ndarray) -> np.ndarray:
    """(n, 3) in mm by the covariance ``known`` (size, size), see :func:`vertex_deviation`."""
    geometry, shape = view.problem.geometry, Layout(state).shape
    model = geometry.model
    return vertex_deviation(
        model,
        geometry.all_vertices(state),
        state.rotation,
        known[shape, shape],
        model.regions.get("narrow_face", geometry.used),
        geometry.relief_basis[: len(state.relief)],
    )


def _support(
    view: View, start: State, state: State, last: Iteration | None, known: Posterior | None
) -> Support | None:
    """How much surer of the shape the photo makes; None where it was not asked, or nothing of the
    shape is free.
    """
    layout = Layout(state)
    if last is None or last.evaluation is None or known is None:
        return None
    if not (known.active & layout.mask(("identity", "expression"))).any():
        return None
    alone = view.descent(Schedule()[PhaseName.LANDMARKS], start)
    if alone is None:
        return None
    model = view.problem.geometry.model
    shape = slice(layout.slices["identity"].start, layout.slices["expression"].stop)
    region = model.regions.get("narrow_face", view.problem.geometry.used)
    before = alone.energy.at(start).system(start, alone.active).hessian
    found = [
        expected_distance(
            model, view.problem.geometry.all_vertices(at), region, matrix[shape, shape]
        )
        for at, matrix in ((start, covariance(before, alone.active)), (state, known.after))
    ]
    return Support(*found)


def _color_doubt(
    view: View, state: State, last: Iteration | None, known: Posterior | None
) -> ColorDoubt | None:
    if last is None or last.evaluation is None or known is None:
        return None
    return color_doubt(view.problem.geometry, view.problem.lights, state, known.after)


def _shading_doubt(
    view: View, last: Iteration | None, known: Posterior | None
) -> np.ndarray | None:
    if last is None or last.evaluation is None or known is None:
        return None
    # Others may be free where the fit went back from there to its landmarks.
    there = _known(view, last.state, last)
    there = known if np.array_equal(there.active, known.active) else there
    return shading_doubt(view.forward, last.evaluation, Layout(last.state), there.after)


def _names(problem: Problem) -> dict[str, list[str]]:
    """Names of the parameters by block, where they have any."""
    lights = problem.lights
    numbers = np.flatnonzero(problem.lit)[lights.fitted].tolist()
    if lights.uniform:
        light_names = [f"light {number}" for number in numbers] + [
            f"color {channel}" for channel in CHANNEL_NAMES
        ]
    else:
        light_names = [
            f"light {number} {channel}" for number in numbers for channel in CHANNEL_NAMES
        ]
    model = problem.geometry.model
    return {
        "identity": list(model.identity_names),
        "expression": list(model.expression_names),
        "lights": light_names,
    }

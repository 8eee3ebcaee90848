"""What a step writes into the trace."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from facestage.fit.energy.photo_term import PhotoTerm
from facestage.fit.given.metrics import psnr
from facestage.fit.runs.trace import trace_row
from reference.synthetic_scene import Scene, plain_photo


def test_a_step_is_judged_by_what_is_the_face_s_own(scene: Scene):
    """Not by a white hat, whose pixels count a fifth as much as skin."""
    photo = plain_photo(scene.render(samples=4)[0])
    hat = np.broadcast_to(np.arange(96)[:, None] < 40, (96, 96))
    color = np.where(hat[..., None], 1.0, 0.5 * photo.color)
    term = PhotoTerm(
        scene.forward, replace(photo, skin=np.where(hat, 0.2, 1.0), color=color), scene.stage, 2
    )
    evaluation = term.evaluate(scene.state, 1)
    item: Any = SimpleNamespace(
        number=3,
        energy={"photo": 1.0},
        condition=2.0,
        damping=SimpleNamespace(value=0.5),
        evaluation=evaluation,
    )
    passage: Any = SimpleNamespace(
        phase=SimpleNamespace(title="geometry"),
        photo=color,
        view=SimpleNamespace(problem=SimpleNamespace(white=1.0)),
    )
    row = trace_row(passage, item, 1.5, None)
    assert (row["stage"], row["iteration"], row["seconds"], row["damping"]) == (
        "geometry",
        3,
        1.5,
        0.5,
    )
    assert row["photo_rms"] == evaluation.rms
    face = (evaluation.base_weight > 0.5) & ~hat
    assert row["psnr"] == pytest.approx(psnr(color + evaluation.residual, color, face))
    assert row["psnr"] > 2 + psnr(color + evaluation.residual, color, evaluation.base_weight > 0)

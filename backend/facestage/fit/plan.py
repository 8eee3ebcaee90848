"""What a job does not need, left out before and during the fit, and listed in the result."""

from __future__ import annotations

from typing import Any

import numpy as np

from facestage.contract.face_model import OTHER
from facestage.contract.light_stage import OFF
from facestage.fit.driver import Fitted
from facestage.fit.problem import FINE_FACE_PX, Problem
from facestage.fit.shadow_edges import omission


def left_out(problem: Problem, fitted: Fitted) -> list[dict[str, Any]]:
    """One entry per omission: what, why, and what it saved (a count that was not worked on)."""
    entries: list[dict[str, Any]] = []

    def add(what: str, why: str, saved: str) -> None:
        entries.append({"what": what, "why": why, "saved": saved})

    off = int((problem.stage.state == OFF).sum())
    if off:
        add(f"{off} lights", "switched off", f"{off} of {len(problem.stage)} lights never traced")
    dark = int((fitted.stage.radiance.max(axis=1) <= 0).sum())
    if dark:
        add(f"{dark} lights in the final picture", "fitted to exactly zero", "no radiance to add")
    for name in problem.job.freeze:
        add(name, "frozen by the job", "its columns of the Jacobian")
    if problem.job.camera is not None:
        add("focal length", "the camera is known", "one column of the Jacobian")
    camera = fitted.state.camera
    shape = problem.geometry.vertices(fitted.state.identity, fitted.state.expression)
    pixels = camera.project(shape @ fitted.state.rotation.T + fitted.state.translation)
    pixels = pixels[np.isfinite(pixels).all(1)]
    size = np.array([camera.width, camera.height])
    low, high = np.clip(pixels.min(0), 0, size), np.clip(pixels.max(0), 0, size)
    outside = int(size.prod() - (high - low).prod())
    if outside > 0:
        add("pixels outside the head's bounding box", "they cannot show the face", f"{outside} of {size.prod()} pixels")
    factor = problem.scale(FINE_FACE_PX)
    if factor < 1:
        add(
            f"photo resolution beyond a face of {FINE_FACE_PX:.0f} px", "it adds texture, not shape",
            f"a factor of {1 / factor**2:.1f} in pixels while fitting",
        )  # fmt: skip
    hidden = int((problem.geometry.model.triangle_part == OTHER).sum())
    if hidden:
        add("see-through shells of the model (tear film, lashes)", "no opaque surface", f"{hidden} triangles")
    add(
        "gradient of silhouettes", "their pixels are down-weighted; landmarks hold the outline",
        "boundary sampling in every step",
    )  # fmt: skip
    still_shadows = omission(fitted.penumbra)
    if still_shadows is not None:
        add(*still_shadows)
    return entries
